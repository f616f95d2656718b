"""Configurations: what is computed, not how fast. Frozen, validated, with presets and TOML in and out."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from golden_model.ilbp import PATTERNS, DescriptorPattern

DETECTORS = ("harris", "fast")
RULE_BASES = ("aerial", "ilbp", "none")
MIN_FRAME_PX = 64
MAX_FRAME_PX = 4096
SELECTION_MARGIN_PX = 3


def _one_of(what: str, value: object, allowed: tuple[object, ...]) -> None:
    if value not in allowed:
        raise ValueError(f"{what} is {value!r}; valid: {', '.join(map(str, allowed))}")


def _in_range(what: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise ValueError(f"{what} is {value}; it must be {low} to {high}")


@dataclass(frozen=True, kw_only=True)
class FrontEndConfig:
    """Corners and descriptors: one frame in, features out.

    Parameters
    ----------
    detector : {"harris", "fast"}
        Corner measure; FAST is the 9-of-16 segment test.
    levels : {1, 2}
        Full size, or full and half size.
    smoothed_gradients : bool
        3x3 binomial before Sobel.
    tensor_window_px : {3, 5}
        Box of the structure tensor.
    harris_k_numerator, harris_k_shift : int
        k = numerator / 2**shift of R = AB - C**2 - k (A + B)**2.
    threshold : int
        Smallest response that survives, in units of R (Harris; cut to its 11 leading bits) or gray levels (FAST).
    suppression_radius_px : {1, 3}
        Suppression in (2 r + 1) squared.
    border_px : int
        Features keep this distance from the border, in their level's own pixels.
    selection : bool
        Keep only the best ``per_cell`` of each cell; otherwise every corner leaves in raster order.
    cell_px, per_cell : int or None
        Grid of the selection; None: by the size of the frame (`for_size`).
    max_features : int
        Capacity of a feature bank; a frame with more is bad.
    descriptor : str
        A name of `golden_model.ilbp.PATTERNS`.

    Raises
    ------
    ValueError
        For an impossible value, with the valid ones.
    """

    detector: str = "harris"
    levels: int = 2
    smoothed_gradients: bool = True
    tensor_window_px: int = 5
    harris_k_numerator: int = 1
    harris_k_shift: int = 4
    threshold: int = 2
    suppression_radius_px: int = 3
    border_px: int = 20
    selection: bool = True
    cell_px: int | None = None
    per_cell: int | None = None
    max_features: int = 2048
    descriptor: str = "ilbp-128"

    def __post_init__(self) -> None:
        _one_of("detector", self.detector, DETECTORS)
        _one_of("levels", self.levels, (1, 2))
        _one_of("tensor_window_px", self.tensor_window_px, (3, 5))
        _in_range("harris_k_numerator", self.harris_k_numerator, 0, 31)
        _in_range("harris_k_shift", self.harris_k_shift, 0, 15)
        _in_range("threshold", self.threshold, 1, (1 << 30) - 1)
        _one_of("suppression_radius_px", self.suppression_radius_px, (1, 3))
        _one_of("descriptor", self.descriptor, tuple(PATTERNS))
        _in_range("border_px", self.border_px, self.smallest_border_px, 255)
        _in_range("max_features", self.max_features, 16, 4096)
        if self.cell_px is not None:
            _one_of("cell_px", self.cell_px, (32, 64, 128, 256))
        if self.per_cell is not None:
            _in_range("per_cell", self.per_cell, 1, 8)

    @property
    def pattern(self) -> DescriptorPattern:
        """The descriptor's pattern."""
        return PATTERNS[self.descriptor]

    @property
    def response_support_px(self) -> int:
        """Distance in x or y of the farthest gray pixel a response depends on."""
        if self.detector == "fast":
            return 3
        return int(self.smoothed_gradients) + 1 + self.tensor_window_px // 2

    @property
    def smallest_border_px(self) -> int:
        """The border that keeps every feature's support inside the frame (DESIGN rule: support + 3)."""
        return max(self.pattern.support_px, self.response_support_px) + SELECTION_MARGIN_PX

    def for_size(self, width_px: int, height_px: int) -> FrontEndConfig:
        """This configuration with cell and per-cell count fixed for frames of one size.

        The cell is the smallest power of two from 32 px whose count over all levels lets at least 3 features
        a cell fit in ``max_features``; values that are set already stay.

        Raises
        ------
        ValueError
            If the size is outside 64..4096 px, or no cell fits.
        """
        _in_range("frame width", width_px, MIN_FRAME_PX, MAX_FRAME_PX)
        _in_range("frame height", height_px, MIN_FRAME_PX, MAX_FRAME_PX)
        if not self.selection:
            return self
        for cell_px in (self.cell_px,) if self.cell_px else (32, 64, 128, 256):
            fitting = self.max_features // self.cells(width_px, height_px, cell_px)
            per_cell = self.per_cell or min(fitting, 5 if cell_px == 32 else 8)
            if per_cell <= fitting and (self.cell_px or self.per_cell or fitting >= 3) and per_cell > 0:
                return dataclasses.replace(self, cell_px=cell_px, per_cell=per_cell)
        raise ValueError(
            f"{width_px}x{height_px}: no cell size keeps the features within {self.max_features}; "
            "use a larger cell_px or fewer per_cell"
        )

    def cells(self, width_px: int, height_px: int, cell_px: int) -> int:
        """How many cells of all levels can hold a feature."""
        total = 0
        for level in range(self.levels):
            last_x = (width_px >> level) - 1 - self.border_px
            last_y = (height_px >> level) - 1 - self.border_px
            if last_x >= self.border_px and last_y >= self.border_px:
                total += (last_x // cell_px + 1) * (last_y // cell_px + 1)
        return max(total, 1)


@dataclass(frozen=True, kw_only=True)
class MatcherConfig:
    """Matching and fuzzy filtering of two feature sets.

    Parameters
    ----------
    rule_base : {"aerial", "ilbp", "none"}
        Fuzzy system that weighs the mutual matches.
    keep_above : int
        A match is kept if its weight (UQ0.8) is larger: 64 stands for 0.25.
    """

    rule_base: str = "aerial"
    keep_above: int = 64

    def __post_init__(self) -> None:
        _one_of("rule_base", self.rule_base, RULE_BASES)
        _in_range("keep_above", self.keep_above, 0, 255)


@dataclass(frozen=True, kw_only=True)
class Config:
    """A whole configuration: front end and matcher, with the name of the preset it came from."""

    preset: str = "aerial"
    front_end: FrontEndConfig = field(default_factory=FrontEndConfig)
    matcher: MatcherConfig = field(default_factory=MatcherConfig)


PRESETS = {
    "aerial": Config(),
    "thesis": Config(
        preset="thesis",
        front_end=FrontEndConfig(
            levels=1,
            smoothed_gradients=False,
            tensor_window_px=3,
            harris_k_numerator=5,
            harris_k_shift=7,
            threshold=200_000,
            suppression_radius_px=1,
            border_px=7,
            selection=False,
            descriptor="thesis-ilbp-4",
        ),
        matcher=MatcherConfig(rule_base="ilbp", keep_above=127),
    ),
}
"""The named configurations: `aerial` is ours, `thesis` is as the thesis has it."""
