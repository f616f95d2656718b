"""The run-time settings of front end, matcher and estimator, declared once; what else software sets is in the maps.

The struct `hdl.streams.FRONT_END_SETTINGS`, the register map, the ports of the simulated front end, the requests to a
board, and the checks of the exported driver and server come from these declarations. Nothing here imports Amaranth,
because the host imports this module and must start without it.
"""

from dataclasses import dataclass

import numpy as np

from golden_model.config import (
    CELL_SIZES_PX,
    DETECTORS,
    MAX_FRAME_PX,
    MAX_PER_CELL,
    MIN_FRAME_PX,
    Config,
    EstimatorConfig,
    FrontEndConfig,
)
from golden_model.formats import RESPONSE_CODE, WEIGHT, encode_response
from golden_model.geometry.acceptance import CELLS
from golden_model.records import ELEMENTS

FLAG = range(2)
_CELL_LOG2 = range(CELL_SIZES_PX[0].bit_length() - 1, CELL_SIZES_PX[-1].bit_length())


@dataclass(frozen=True)
class Setting:
    """A number that software sets while the accelerator runs."""

    name: str
    """The same in registers, struct, ports and requests."""
    values: range
    """Valid values. Width and height are further limited to the largest built."""
    reset: int
    """Value after reset."""
    description: str
    """For the register map."""

    @property
    def bits(self) -> int:
        """Width: the bits of the largest valid value."""
        return self.values[-1].bit_length()


FRONT_END = (
    Setting("width_px", range(MIN_FRAME_PX, MAX_FRAME_PX + 1), 640, f"Width, {MIN_FRAME_PX} to the largest built."),
    Setting("height_px", range(MIN_FRAME_PX, MAX_FRAME_PX + 1), 480, f"Height, {MIN_FRAME_PX} to the largest built."),
    Setting("cell_log2", _CELL_LOG2, 5, f"log2 of the cell's side, {_CELL_LOG2[0]} to {_CELL_LOG2[-1]}."),
    Setting("per_cell", range(1, MAX_PER_CELL + 1), 5, f"Features kept per cell, 1 to {MAX_PER_CELL}."),
    Setting("detector", range(len(DETECTORS)), 0, f"Index into {', '.join(DETECTORS)}."),
    Setting(
        "threshold_code",
        range(1 << RESPONSE_CODE.bits),
        2,
        "Response code (FAST: gray levels); the first threshold, if adaptive.",
    ),
    Setting("memory_mode", FLAG, 0, "A plain stream, cut into frames by SIZE; 0: video with TUSER and TLAST (UG934)."),
    Setting("gray_input", FLAG, 0, "A beat carries 8-bit gray in its low byte; 0: colour."),
    Setting("adaptive", FLAG, 0, "The threshold moves towards TARGET between frames."),
    # Wide enough for 4096, the largest bank of features.
    Setting("target_features", range(1 << 13), 1024, "Features per frame."),
)
"""Settings of the front end. Their order is that of the struct and of the ports."""


KEEP_ABOVE = Setting("keep_above", range(1 << WEIGHT.bits), 64, "A match is kept if its weight (UQ0.8) is larger.")

WORD_VALUES = range(1 << 32)
ESTIMATION = (
    Setting("passes", range(1 << 8), EstimatorConfig.passes, "Pairs of samples in each of 16 steps, at most; not 0."),
    Setting("seed", WORD_VALUES, EstimatorConfig.seed, "First state of the generator of samples; not 0."),
    Setting("min_inliers", range(1 << 12), EstimatorConfig.min_inliers, "Matches within 2 px that are needed."),
    Setting("min_cells", range(CELLS**2 + 1), EstimatorConfig.min_cells, "Cells of 8x8 in which these must lie."),
)
"""Settings of the estimator, those of `golden_model.config.EstimatorConfig`."""

SETTINGS = {setting.name: setting for setting in (*FRONT_END, KEEP_ABOVE, *ESTIMATION)}
"""By name; `hdl.registers.register_map` gives each its register and bits. Others are declared in the maps alone."""

PAGE_BYTES = 4096
"""Unit of a ring's base and of its slots; no AXI burst crosses a multiple of it."""
MIN_SLOTS = 2
TICK_CLOCKS = 1024
"""Unit of the shell's time limits."""
POSE_ELEMENTS = tuple(f"pose_{name}" for name in ELEMENTS)

REQUESTED = ("width_px", "height_px", "cell_log2", "per_cell", "detector", "threshold_code", "keep_above")
"""Settings that a request to a board's server contains. The driver sets the others, ``gray_input`` from the frames."""

RUNNING = {"enable": 1, "features_enable": 1, "matches_enable": 1}
"""Settings that accept pixels and enable both outputs."""


def frame_settings(config: FrontEndConfig, width_px: int, height_px: int, *, gray_input: bool) -> dict[str, int]:
    """Convert a configuration into `FRONT_END` settings for frames of one size.

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


def estimator_settings(config: Config) -> dict[str, int]:
    """Convert a configuration into `ESTIMATION` settings, and enable the output; nothing without an estimator."""
    return {"homographies_enable": 1, **vars(config.estimator)} if config.estimator else {}


def matched_frame_settings(config: Config, width_px: int, height_px: int, *, gray_input: bool) -> dict[str, int]:
    """Convert a configuration into `FRONT_END` settings and the limit of the fuzzy weight."""
    values = frame_settings(config.front_end, width_px, height_px, gray_input=gray_input)
    return {**values, KEEP_ABOVE.name: config.matcher.keep_above}
