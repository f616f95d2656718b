"""The run-time settings of the accelerator, declared once.

The struct `hdl.streams.FRONT_END_SETTINGS`, the register map, the ports of the simulated front end, the requests to a
board, and the checks of the exported driver and server come from these declarations. Nothing here imports Amaranth:
the host imports this module too, and must start without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from golden_model.config import (
    CELL_SIZES_PX,
    DETECTORS,
    MAX_FRAME_PX,
    MAX_PER_CELL,
    MIN_FRAME_PX,
    Config,
    FrontEndConfig,
)
from golden_model.formats import RESPONSE_CODE, WEIGHT, encode_response

FLAG = range(2)
_CELL_LOG2S = [size_px.bit_length() - 1 for size_px in CELL_SIZES_PX]


@dataclass(frozen=True)
class Setting:
    """A number that software sets.

    Attributes
    ----------
    name : str
        The same in registers, struct, ports and requests.
    values : range
        Valid values. The size is limited further by what was built.
    reset : int
        Value after reset.
    description : str
        For the register map.
    """

    name: str
    values: range
    reset: int
    description: str

    @property
    def bits(self) -> int:
        """Width: what the largest valid value needs."""
        return self.values[-1].bit_length()


FRONT_END = (
    Setting("width_px", range(MIN_FRAME_PX, MAX_FRAME_PX + 1), 640, f"Width, {MIN_FRAME_PX} to the largest built."),
    Setting("height_px", range(MIN_FRAME_PX, MAX_FRAME_PX + 1), 480, f"Height, {MIN_FRAME_PX} to the largest built."),
    Setting(
        "cell_log2",
        range(_CELL_LOG2S[0], _CELL_LOG2S[-1] + 1),
        5,
        f"log2 of the cell's side, {_CELL_LOG2S[0]} to {_CELL_LOG2S[-1]}.",
    ),
    Setting("per_cell", range(1, MAX_PER_CELL + 1), 5, f"Features kept in a cell, 1 to {MAX_PER_CELL}."),
    Setting("detector", range(len(DETECTORS)), 0, f"Index into {', '.join(DETECTORS)}."),
    Setting(
        "threshold_code",
        range(1 << RESPONSE_CODE.bits),
        2,
        "As a response code (FAST: in gray levels); where it starts, if adaptive.",
    ),
    Setting("memory_mode", FLAG, 0, "Frames by SIZE from a plain stream; 0: by TUSER and TLAST (UG934)."),
    Setting("gray_input", FLAG, 0, "A beat carries 8-bit gray in its low byte; 0: colour."),
    Setting("adaptive", FLAG, 0, "The threshold moves towards TARGET between frames."),
    # Wide enough for 4096, the largest bank of features.
    Setting("target_features", range(1 << 13), 1024, "Features a frame."),
)
"""Settings of the front end. Their order is that of the struct and of the ports."""

KEEP_ABOVE = Setting("keep_above", range(1 << WEIGHT.bits), 64, "A match is kept if its weight (UQ0.8) is larger.")

SETTINGS = {
    setting.name: setting
    for setting in (
        *FRONT_END,
        KEEP_ABOVE,
        Setting("enable", FLAG, 0, "Pixels are taken in; 0 lets them wait at the input."),
        Setting("features_enable", FLAG, 0, "Features leave; 0: they are discarded at the output."),
        Setting("matches_enable", FLAG, 0, "Matches leave; 0: they are discarded at the output."),
        Setting("hold_reference", FLAG, 0, "Frames are matched with a held one; 0: each with the last."),
        Setting("frame_done_mask", FLAG, 0, "For frame_done."),
        Setting("matches_done_mask", FLAG, 0, "For matches_done."),
        Setting("frame_bad_mask", FLAG, 0, "For frame_bad."),
    )
}
"""Every setting, by name. `hdl.registers.register_map.REGISTERS` gives each its register and bits."""

WORD_VALUES = range(1 << 32)
RINGS = ("features", "matches")
"""The rings of buffers in memory that a live build writes."""
PAGE_BYTES = 4096
"""Unit of a ring's base and of its slots; no AXI burst crosses a multiple of it."""
FEWEST_SLOTS = 2
TICK_CLOCKS = 1024
"""Unit of the shell's time limits."""


def _ring_settings(ring: str) -> tuple[Setting, ...]:
    return (
        Setting(f"{ring}_base_low", WORD_VALUES, 0, f"Address of the ring, low word: a multiple of {PAGE_BYTES}."),
        Setting(f"{ring}_base_high", WORD_VALUES, 0, "Address of the ring, high word."),
        Setting(f"{ring}_slots", range(257), 0, f"Slots of the ring, {FEWEST_SLOTS} to 256; each holds a packet."),
        Setting(f"{ring}_slot_pages", range(4097), 0, f"Length of a slot in {PAGE_BYTES} bytes."),
        Setting(f"{ring}_read", WORD_VALUES, 0, "Packets that software has read: their slots are free again."),
    )


SHELL = {
    setting.name: setting
    for setting in (
        *(setting for ring in RINGS for setting in _ring_settings(ring)),
        Setting(
            "camera_timeout",
            range(1 << 16),
            15_000,
            f"Pause after which the camera counts as stopped, in {TICK_CLOCKS} clocks; 0: never.",
        ),
        Setting("coalesce_count", range(256), 1, "Frames after which frames_ready is set."),
        Setting(
            "coalesce_timeout",
            range(1 << 16),
            0,
            f"Time after which fewer frames set frames_ready, in {TICK_CLOCKS} clocks; 0: never.",
        ),
        Setting("frames_ready_mask", FLAG, 0, "For frames_ready."),
        Setting("frame_dropped_mask", FLAG, 0, "For frame_dropped."),
        Setting("camera_stops_mask", FLAG, 0, "For camera_stops."),
        Setting("memory_error_mask", FLAG, 0, "For memory_error."),
    )
}
"""The settings of a live build's shell by name; `hdl.registers.live_register_map` gives each its register and bits."""

REQUESTED = ("width_px", "height_px", "cell_log2", "per_cell", "detector", "threshold_code", "keep_above")
"""What a request to a board's server sets. The driver sets the others: ``gray_input`` follows from the frames."""

RUNNING = {"enable": 1, "features_enable": 1, "matches_enable": 1}
"""Settings with which pixels are taken in and both outputs are on."""


def frame_settings(config: FrontEndConfig, width_px: int, height_px: int, *, gray_input: bool) -> dict[str, int]:
    """Values of the `FRONT_END` settings for frames of one size.

    Raises
    ------
    ValueError
        If the configuration cannot take the size.
    """
    config = config.for_size(width_px, height_px)
    return {
        "width_px": width_px,
        "height_px": height_px,
        # Without selection there are no cells; the hardware still gets valid numbers.
        "cell_log2": (config.cell_px or CELL_SIZES_PX[0]).bit_length() - 1,
        "per_cell": config.per_cell or 1,
        "detector": DETECTORS.index(config.detector),
        "threshold_code": int(encode_response(np.array(config.threshold))),
        "memory_mode": 0,
        "gray_input": int(gray_input),
        "adaptive": 0,
        "target_features": config.max_features - 1,
    }


def matched_frame_settings(config: Config, width_px: int, height_px: int, *, gray_input: bool) -> dict[str, int]:
    """As `frame_settings`, with the limit of the fuzzy weight: all that follows from a configuration."""
    values = frame_settings(config.front_end, width_px, height_px, gray_input=gray_input)
    return {**values, KEEP_ABOVE.name: config.matcher.keep_above}
