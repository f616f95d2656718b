"""The registers of the streaming shell, which follow those of the accelerator in a camera build."""

import enum

from hdl.build import Build
from hdl.registers.painter_register_map import PAINTER_REGISTERS
from hdl.registers.register_map import (
    ESTIMATOR_REGISTERS,
    REGISTERS,
    Access,
    Field,
    Register,
    base_words,
    list_values,
    masks,
    new_setting,
    status_word,
)
from hdl.settings import MIN_SLOTS, PAGE_BYTES, TICK_CLOCKS, WORD_VALUES

_STATUS = Access.STATUS
_TICKS, _IN_TICKS = range(1 << 16), f"in units of {TICK_CLOCKS} clocks"


class Reason(enum.IntEnum):
    """Why the shell dropped a whole frame before the accelerator."""

    OFF = 1
    REFUSED = 2
    NO_BUFFER = 3
    TOO_LARGE = 4
    OUTRUN = 5


class Refusal(enum.IntFlag):
    """Faults of the settings, for which every frame is dropped; those of a ring count only while it is on."""

    FEATURES_MISALIGNED = 1
    FEATURES_TOO_SMALL = 2
    FEATURES_READ_AHEAD = 4
    MATCHES_MISALIGNED = 8
    MATCHES_TOO_SMALL = 16
    MATCHES_READ_AHEAD = 32
    MEMORY_MODE = 64


class RingFault(enum.IntFlag):
    """Faults of the settings of one ring, as `Refusal` has them for two."""

    MISALIGNED = 1
    TOO_SMALL = 2
    READ_AHEAD = 4


def _ring_registers(ring: str, offset: int) -> tuple[Register, ...]:
    upper = ring.upper()
    return (
        *base_words(ring, offset, "the ring", f"the ring of {ring}", f"; change it only while {ring}_enable is 0"),
        Register(
            f"{upper}_SHAPE", offset + 8, f"Shape of the ring of {ring}; change it only while it is off.",
            new_setting(f"{ring}_slots", 0, range(257), f"Slots of the ring, {MIN_SLOTS} to 256; each holds a packet."),
            new_setting(f"{ring}_slot_pages", 16, range(4097), f"Length of a slot in units of {PAGE_BYTES} bytes."),
        ),
        Register(
            f"{upper}_READ", offset + 12, f"Progress of the reader of {ring}.",
            new_setting(f"{ring}_read", 0, WORD_VALUES, "Packets that software has read, whose slots are free again."),
        ),
        status_word(
            f"{upper}_WRITTEN", offset + 16, f"Progress of the writer of {ring}.",
            f"Packets in memory; 0 while {ring}_enable is 0.",
        ),
        Register(
            f"{upper}_ERRORS", offset + 20, f"Failures of the ring of {ring}.",
            Field(f"{ring}_errors", 0, 16, _STATUS, "Write responses other than OKAY; stays at the largest value."),
            Field(f"{ring}_lost", 16, 16, _STATUS, "Packets that found no free slot; stays at the largest value."),
        ),
    )  # fmt: skip


SHELL_REGISTERS = (
    Register(
        "SHELL_STATUS", 0x100, "Whether frames can be taken.",
        Field("refused", 0, 8, _STATUS, f"Every frame is dropped because of: {list_values(Refusal)}."),
        Field("camera_stopped", 8, 1, _STATUS, "No pixel came for longer than camera_timeout."),
        Field("features_active", 9, 1, _STATUS, "The ring of features is on, or still writes a packet."),
        Field("matches_active", 10, 1, _STATUS, "The ring of matches is on, or still writes a packet."),
        Field("dropped_reason", 16, 8, _STATUS, f"For the frame dropped last: {list_values(Reason)}."),
    ),
    status_word(
        "CAMERA_FRAMES", 0x104,
        "Every frame of the camera since reset is admitted or dropped; an admitted one may be cut off.",
        "Frames that have started: the number of the frame in progress.",
    ),
    status_word("DROPPED", 0x108, "Drops since reset.", "Frames dropped whole before the accelerator."),
    status_word(
        "CUT", 0x10C, "Admitted frames that were cut off.",
        "Each ends with a bad FrameStatus when the next frame is admitted.",
    ),
    status_word(
        "DROPPED_NUMBER", 0x110,
        "The last drop. If this has changed after DROPPED_TIME has been read, read all three again.",
        "Number of the frame.",
    ),
    status_word("DROPPED_TIME_LOW", 0x114, "Time of the last drop.", "Clocks, low word."),
    status_word("DROPPED_TIME_HIGH", 0x118, "Time of the last drop.", "Clocks, high word."),
    Register(
        "CAMERA", 0x11C, "The camera's watchdog.",
        # 0.1 s at 150 MHz.
        new_setting(
            "camera_timeout", 0, _TICKS, f"Pause that counts as a stopped camera, {_IN_TICKS}; 0: never.", 15_000
        ),
    ),
    Register(
        "COALESCE", 0x120, "How many frames share an interrupt.",
        new_setting("coalesce_count", 0, range(256), "Frames after which frames_ready is set.", 1),
        new_setting(
            "coalesce_timeout", 16, _TICKS, f"Time after which fewer frames set frames_ready, {_IN_TICKS}; 0: never."
        ),
    ),
    Register(
        "SHELL_IRQ_STATUS", 0x124, "Events of the shell; they share the interrupt with IRQ_STATUS.",
        Field("frames_ready", 0, 1, Access.EVENT, "All packets of frames are in memory."),
        Field("frame_dropped", 1, 1, Access.EVENT, "A frame was dropped or cut, other than by `enable`."),
        Field("camera_stops", 2, 1, Access.EVENT, "The camera has stopped."),
        Field("memory_error", 3, 1, Access.EVENT, "The response to a write was an error."),
    ),
    Register(
        "SHELL_IRQ_MASK", 0x128, "Which events of the shell interrupt.",
        *masks("frames_ready", "frame_dropped", "camera_stops", "memory_error"),
    ),
    *_ring_registers("features", 0x140),
    *_ring_registers("matches", 0x160),
)  # fmt: skip
"""The shell's registers that every camera build has, by offset."""

HOMOGRAPHY_RING = (
    *_ring_registers("homographies", 0x180),
    Register(
        "HOMOGRAPHIES_STATUS", 0x198, "The state of the ring of homographies, as SHELL_STATUS has it of the others.",
        Field("homographies_refused", 0, 3, _STATUS, f"Every frame is dropped because of: {list_values(RingFault)}."),
        Field("homographies_active", 8, 1, _STATUS, "The ring is on, or still writes a record."),
    ),
)  # fmt: skip
"""The registers of a shell behind an estimator, after `SHELL_REGISTERS`."""

ALL_REGISTERS = (*REGISTERS, *ESTIMATOR_REGISTERS, *SHELL_REGISTERS, *HOMOGRAPHY_RING, *PAINTER_REGISTERS)
"""Every register that a build can have."""


def list_registers(build: Build) -> tuple[Register, ...]:
    """The registers of a build."""
    has_shell, estimates = build.shell == "camera", build.config.estimator is not None
    return (
        *REGISTERS,
        *(ESTIMATOR_REGISTERS if estimates else ()),
        *(SHELL_REGISTERS if has_shell else ()),
        *(HOMOGRAPHY_RING if has_shell and estimates else ()),
        *(PAINTER_REGISTERS if build.painter else ()),
    )
