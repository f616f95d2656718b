"""The register map of the accelerator, declared once.

The hardware (`hdl.registers.register_file`), the Markdown, SVD and C descriptions (`hdl.export.register_docs`) and the
exported driver's constants (`hdl.export.host.driver_map`) come from `REGISTERS`; settings that more than a register
needs come from `hdl.settings`. A build that estimates homographies has `ESTIMATOR_REGISTERS` behind them, a camera
build those of its shell (`hdl.registers.shell_register_map`) and of its painter
(`hdl.registers.painter_register_map`).
"""

import enum
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from golden_model.config import DETECTORS, RULE_BASES
from golden_model.records import MATCH, Cause
from golden_model.version import VERSION
from hdl.build import Build
from hdl.settings import FLAG, PAGE_BYTES, SETTINGS, WORD_VALUES

REGISTER_BITS = 32
IDENTITY = int.from_bytes(b"SKYM", "big")


class Access(enum.Enum):
    """Who writes a field, and how."""

    CONSTANT = "constant"
    STATUS = "read only"
    SETTING = "read/write"
    REQUEST = "write 1 to request; reads 1 until obeyed"
    EVENT = "read; write 1 to clear"
    COMMAND = "write 1; reads 0"


@dataclass(frozen=True)
class Field:
    """A bit field of a register."""

    name: str
    """Unique in the map."""
    low: int
    """Lowest bit."""
    bits: int
    access: Access
    description: str
    init: int = 0
    """Value after reset."""
    values: range = FLAG
    """Those that software may write."""

    @property
    def mask(self) -> int:
        """The field's bits in its register."""
        return ((1 << self.bits) - 1) << self.low


class Register:
    """A 32-bit register at a byte ``offset``, with its fields."""

    def __init__(self, name: str, offset: int, description: str, *fields: Field) -> None:
        self.name, self.offset, self.description, self.fields = name, offset, description, fields


_CONSTANT, _STATUS, _SETTING = Access.CONSTANT, Access.STATUS, Access.SETTING


def known_setting(name: str, low: int) -> Field:
    """The field of a setting in `hdl.settings`, from bit ``low`` on."""
    setting = SETTINGS[name]
    return new_setting(name, low, setting.values, setting.description, setting.reset)


def new_setting(name: str, low: int, values: range, description: str, reset: int = 0) -> Field:
    """The field of a setting that only the map declares, from bit ``low`` on."""
    return Field(name, low, values[-1].bit_length(), _SETTING, description, reset, values)


def masks(*events: str) -> Iterator[Field]:
    """The fields that let events interrupt, from bit 0 on."""
    return (Field(f"{event}_mask", n, 1, _SETTING, f"The event {event} interrupts.") for n, event in enumerate(events))


def status_word(name: str, offset: int, description: str, meaning: str) -> Register:
    """A register with one field, of the register's name and whole width, that the hardware writes."""
    return Register(name, offset, description, Field(name.lower(), 0, REGISTER_BITS, _STATUS, meaning))


def base_words(area: str, offset: int, named: str, whole: str, note: str = "") -> tuple[Register, Register]:
    """The registers of an address in memory: that of what is ``named``, the position of the ``whole``."""
    low = new_setting(f"{area}_base_low", 0, WORD_VALUES, f"Address of {named}, low word: a multiple of {PAGE_BYTES}.")
    high = new_setting(f"{area}_base_high", 0, WORD_VALUES, f"Address of {named}, high word.")
    return (
        Register(low.name.upper(), offset, f"Position of {whole}{note}.", low),
        Register(high.name.upper(), offset + 4, f"Position of {whole}.", high),
    )


def list_values(members: Iterable[enum.IntEnum]) -> str:
    """The values and names of an enumeration, for a description."""
    return ", ".join(f"{int(member)} {member.name.lower().replace('_', ' ')}" for member in members)


# Gaps leave room for more registers of a kind: the build from 0x00, settings from 0x20, status from 0x40, events
# from 0x60; then the estimator's from 0x80. Released offsets stay.
REGISTERS = (
    Register("ID", 0x00, "Identifies the accelerator.", Field("identity", 0, 32, _CONSTANT, '"SKYM" in ASCII.')),
    Register(
        "VERSION", 0x04,
        "Version of skymosaic that wrote the hardware. Software for one version works with every patch version, and, "
        "from 1.0.0 on, with every later minor version.",
        Field("version_patch", 0, 8, _CONSTANT, "Registers and records have not changed."),
        Field("version_minor", 8, 8, _CONSTANT, "Registers or fields may have been added; before 1.0.0, changed."),
        Field("version_major", 16, 8, _CONSTANT, "Registers, fields or records may have changed."),
    ),
    Register(
        "BUILD", 0x08, "What was built.",
        Field("built_levels", 0, 2, _CONSTANT, "Pyramid levels."),
        Field("built_detectors", 2, 2, _CONSTANT, f"Available detectors, a bit each: {', '.join(DETECTORS)}."),
        Field("built_rule_base", 4, 2, _CONSTANT, "Index into " + ", ".join(RULE_BASES) + "; 3: own."),
        Field("built_selection", 6, 1, _CONSTANT, "Whether corners are selected by cells."),
        Field("built_shell", 7, 1, _CONSTANT, "Whether a streaming shell and the registers from 0x100 on exist."),
        Field("built_descriptor_bytes", 8, 8, _CONSTANT, "Length of a descriptor."),
        Field("built_lanes", 16, 8, _CONSTANT, "Left descriptors compared at a time."),
        Field("built_video_bits", 24, 8, _CONSTANT, "Width of the video input; 48 and 16 hold two pixels per clock."),
    ),
    Register(
        "BUILD_SIZE", 0x0C, "Largest frame.",
        Field("built_width_px", 0, 16, _CONSTANT, "Width."),
        Field("built_height_px", 16, 16, _CONSTANT, "Height."),
    ),
    Register(
        "BUILD_RECORDS", 0x10, "Capacity and lengths of records.",
        Field("built_max_features", 0, 16, _CONSTANT, "Maximum number of features per frame."),
        Field("built_feature_bytes", 16, 8, _CONSTANT, "Bytes of a Feature record and of its packet's FrameStatus."),
        Field("built_match_bytes", 24, 8, _CONSTANT, "Bytes of a Match record and of its packet's FrameStatus."),
    ),
    Register(
        "BUILD_RULES", 0x14, "The fuzzy rules that decide matches.",
        Field("built_rules_digest", 0, 32, _CONSTANT, "Digest of their tables, as in every report; 0 without rules."),
    ),
    Register(
        "BUILD_OPTIONS", 0x18, "What else was built.",
        Field("built_homographies", 0, 1, _CONSTANT, "Whether an estimator and the registers from 0x80 on exist."),
        Field("built_painter", 1, 1, _CONSTANT, "Whether a painter and the registers from 0x1A0 on exist."),
    ),
    Register(
        "CONTROL", 0x20,
        "What is switched on. A frame keeps the settings with which it started, those below included, until it has "
        "been matched; `enable` takes effect at once, `features_enable` and `matches_enable` with the next "
        "packet. A frame whose settings are out of range, or larger than what was built, is refused: its pixels are "
        "dropped, and its status is bad.",
        Field("enable", 0, 1, _SETTING, "Pixels are accepted; 0: they wait at the input."),
        known_setting("memory_mode", 1),
        known_setting("gray_input", 2),
        Field("features_enable", 3, 1, _SETTING, "Features leave; 0: they are discarded at the output."),
        Field("matches_enable", 4, 1, _SETTING, "Matches leave; 0: they are discarded at the output."),
        Field(
            "hold_reference", 5, 1, _SETTING,
            "Frames are matched with the reference; 0: with the last good, accepted one.",
        ),
        known_setting("adaptive", 6),
        Field(
            "clear", 8, 1, Access.COMMAND,
            "Drop frames and reference; settings stay. A packet in progress ends as bad: `clearing` says when.",
        ),
    ),
    Register(
        "REFERENCE", 0x24, "The reference frame.",
        Field("take_reference", 0, 1, Access.REQUEST, "The next good frame to start becomes the reference, unmatched."),
    ),
    Register("SIZE", 0x28, "Size of the frames.", known_setting("width_px", 0), known_setting("height_px", 16)),
    Register("SELECTION", 0x2C, "Selection by cells.", known_setting("cell_log2", 0), known_setting("per_cell", 8)),
    Register(
        "THRESHOLD", 0x30, "Detector and its threshold.",
        known_setting("threshold_code", 0),
        known_setting("detector", 16),
    ),
    Register("TARGET", 0x34, "Target of the adaptive threshold.", known_setting("target_features", 0)),
    Register("KEEP", 0x38, "Limit of the fuzzy weight.", known_setting("keep_above", 0)),
    Register(
        "STATUS", 0x40, "What waits at the moment.",
        Field("video_waiting", 0, 1, _STATUS, "A pixel waits at the input."),
        Field("features_waiting", 1, 1, _STATUS, "A word waits for its DMA on the features' stream."),
        Field("matches_waiting", 2, 1, _STATUS, "A word waits for its DMA on the matches' stream."),
        Field(
            "clearing", 3, 1, _STATUS,
            "A packet that `clear` broke off has not ended, or, in a camera build, has not been written to memory. "
            "Once this is 0, and while `enable` is, no packet and no burst is open: `aresetn` may be asserted.",
        ),
    ),
    status_word("FRAMES", 0x44, "Frames since clear.", "Good and bad ones."),
    status_word("BAD_FRAMES", 0x48, "Bad frames since clear.", "Their features and matches are not valid."),
    Register(
        "CAUSES", 0x4C, "Why the last bad frame was bad.",
        Field("causes", 0, 16, _STATUS, f"Sum of: {list_values(Cause)}."),
    ),
    Register(
        "LAST_FEATURES", 0x50, "Features and threshold of the last frame.",
        Field("last_features", 0, 16, _STATUS, "Number of features."),
        Field("last_threshold", 16, 15, _STATUS, "Threshold code with which they were detected."),
    ),
    Register(
        "LAST_MATCHES", 0x54, "Matches of the frame matched last.",
        Field("last_matches", 0, 16, _STATUS, "Number of mutual matches."),
        Field("last_kept", 16, 16, _STATUS, "Number of matches that the fuzzy weight kept."),
    ),
    status_word(
        "LAST_CYCLES", 0x58, "Duration of the last frame.", "Clock cycles from the first pixel to the last feature."
    ),
    Register(
        "IRQ_STATUS", 0x60, "Events; the interrupt is high while any event is set that IRQ_MASK enables.",
        Field("frame_done", 0, 1, Access.EVENT, "A frame's features have left."),
        Field("matches_done", 1, 1, Access.EVENT, "A frame's matches have left."),
        Field("frame_bad", 2, 1, Access.EVENT, "A frame was bad."),
    ),
    Register("IRQ_MASK", 0x64, "Which events interrupt.", *masks("frame_done", "matches_done", "frame_bad")),
)  # fmt: skip
"""Every register that all builds have, in rising offset."""

ESTIMATOR_REGISTERS = (
    Register(
        "ESTIMATOR", 0x80,
        "The estimator of homographies. It takes its settings when a frame's matches are complete. With passes or seed "
        "0, its records have a cause instead of a homography.",
        Field("homographies_enable", 0, 1, _SETTING, "Homographies leave; 0: they are discarded at the output."),
        known_setting("passes", 8),
    ),
    Register("SEED", 0x84, "Seed of the samples.", known_setting("seed", 0)),
    Register(
        "ACCEPTANCE", 0x88, "What a homography needs to be accepted.",
        known_setting("min_inliers", 0),
        known_setting("min_cells", 16),
    ),
    Register(
        "ESTIMATOR_STATUS", 0x8C, "What waits at the moment.",
        Field(
            "homographies_waiting", 0, 1, _STATUS,
            "A word waits for its DMA on the homographies' stream; `aresetn` would cut its record.",
        ),
    ),
    status_word(
        "LOST_HOMOGRAPHIES", 0x90, "Records lost since clear.", "Dropped because the record before was not taken."
    ),
    Register(
        "ESTIMATOR_IRQ_STATUS", 0x94, "Events of the estimator; they share the interrupt with IRQ_STATUS.",
        Field("homography_done", 0, 1, Access.EVENT, "A record has left."),
    ),
    Register("ESTIMATOR_IRQ_MASK", 0x98, "Which events of the estimator interrupt.", *masks("homography_done")),
)  # fmt: skip
"""The registers of a build that estimates homographies, behind `REGISTERS`."""


def fields(*accesses: Access, registers: Sequence[Register] = REGISTERS) -> Iterator[Field]:
    """Every field with one of ``accesses``, in the order of the map."""
    return (field for register in registers for field in register.fields if field.access in accesses)


def built_constants(build: Build) -> dict[str, int]:
    """The values of the constant fields for one build."""
    front_end, matcher = build.config.front_end, build.config.matcher
    pattern = front_end.pattern
    return {
        "identity": IDENTITY,
        **dict(zip(("version_major", "version_minor", "version_patch"), map(int, VERSION.split(".")), strict=True)),
        "built_levels": front_end.levels,
        "built_detectors": (1 << len(DETECTORS)) - 1,
        "built_rule_base": (*RULE_BASES, matcher.rule_base).index(matcher.rule_base),
        "built_rules_digest": matcher.rules_digest(pattern),
        "built_selection": int(front_end.selection),
        "built_shell": int(build.shell == "camera"),
        "built_homographies": int(build.config.estimator is not None),
        "built_painter": int(build.painter),
        "built_descriptor_bytes": pattern.descriptor_bytes,
        "built_lanes": build.lanes,
        "built_video_bits": build.video_bits,
        "built_width_px": build.max_width_px,
        "built_height_px": build.max_height_px,
        "built_max_features": front_end.max_features,
        "built_feature_bytes": pattern.record.record_bytes,
        "built_match_bytes": MATCH.record_bytes,
    }


def register_writes(values: Mapping[str, int], *, registers: Sequence[Register] = REGISTERS) -> list[tuple[int, int]]:
    """Addresses and words that set fields of ``registers``; the other fields of a register written are reset.

    Raises
    ------
    ValueError
        For a field that does not exist.
    """
    unknown = values.keys() - {field.name for register in registers for field in register.fields}
    if unknown:
        raise ValueError(f"no register field {', '.join(sorted(unknown))}")
    return [
        # Whole words: nobody has to read a register before writing one of its fields.
        (register.offset, sum(values.get(field.name, field.init) << field.low for field in register.fields))
        for register in registers
        if any(field.name in values for field in register.fields)
    ]
