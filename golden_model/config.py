"""Configurations: immutable, validated, with named presets."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from golden_model.feature.ilbp import PATTERNS, DescriptorPattern
from golden_model.fuzzy.rules import MatchRules, shipped_rules

DETECTORS = ("harris", "fast")
Preset = Literal["aerial", "thesis"]
RuleBase = Literal["aerial", "ilbp", "none"]
RULE_BASES: tuple[RuleBase, ...] = get_args(RuleBase)
MIN_FRAME_PX = 64
MAX_FRAME_PX = 4096
MIN_LEVEL_PX = MIN_FRAME_PX // 2
# Powers of two, so that hardware finds the cell of a pixel by a shift.
CELL_SIZES_PX = (32, 64, 128, 256)
MAX_PER_CELL = 8
SUPPRESSION_MARGIN_PX = 3
# Harris responses stay below 2**30; the score of FAST is at most 254.
MAX_THRESHOLD = {"harris": (1 << 30) - 1, "fast": 254}


def check_choice(what: str, value: object, allowed: tuple[object, ...]) -> None:
    """Raise ValueError unless ``value`` is one of ``allowed``."""
    if not any(type(value) is type(choice) and value == choice for choice in allowed):  # True == 1 == 1.0
        raise ValueError(f"{what} is {value!r}; valid: {', '.join(str(choice).lower() for choice in allowed)}")


def check_range(what: str, value: object, low: int, high: int | None = None) -> None:
    """Raise ValueError unless ``value`` is an int from ``low`` to ``high``, or to any without ``high``."""
    if type(value) is not int or value < low or (high is not None and value > high):
        allowed = f"from {low} on" if high is None else f"from {low} to {high}"
        raise ValueError(f"{what} is {value!r}; it must be a whole number {allowed}")


@dataclass(frozen=True, kw_only=True)
class FrontEndConfig:
    """Configuration of the front end: corners and descriptors of a frame.

    Parameters
    ----------
    detector : {"harris", "fast"}
        Corner measure; FAST is the 9-of-16 segment test.
    levels : {1, 2}
        1: full size only; 2: full and half size.
    smoothed_gradients : bool
        Apply a 3x3 binomial before Sobel.
    tensor_window_px : {3, 5}
        Box of the structure tensor; 5 only with smoothed gradients, otherwise R would not fit 32 bits.
    harris_k_numerator, harris_k_shift : int
        k = numerator / 2**shift of R = AB - C**2 - k (A + B)**2, below 1/4.
    threshold : int
        Smallest response that survives, in units of R (Harris; cut to its 11 leading bits) or gray levels (FAST).
    suppression_radius_px : {1, 3}
        Harris: suppression in a window of (2 r + 1) squared. FAST always uses 3x3 (`suppression`).
    border_px : int
        Features keep this distance from the border, in their level's own pixels.
    selection : bool
        Keep only the best ``per_cell`` corners of each cell; otherwise keep every corner, in raster order.
    cell_px, per_cell : int or None
        Cell side and corners kept per cell; None: chosen from the size of the frame (`for_size`).
    max_features : int
        Capacity of a feature bank; a frame with more features is bad.
    descriptor : str
        A name of `golden_model.feature.ilbp.PATTERNS`.

    Raises
    ------
    ValueError
        For an impossible value; the message names the valid ones.
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
        check_choice("detector", self.detector, DETECTORS)
        check_choice("levels", self.levels, (1, 2))
        self._check_harris()
        check_range("threshold", self.threshold, 1, MAX_THRESHOLD[self.detector])
        check_choice("suppression_radius_px", self.suppression_radius_px, (1, 3))
        check_choice("descriptor", self.descriptor, tuple(PATTERNS))
        check_range("border_px", self.border_px, self.min_border_px, 255)
        self._check_selection()

    def _check_harris(self) -> None:
        check_choice("smoothed_gradients", self.smoothed_gradients, (True, False))
        if self.smoothed_gradients:
            check_choice("tensor_window_px", self.tensor_window_px, (3, 5))
        else:
            check_choice("tensor_window_px without smoothed_gradients", self.tensor_window_px, (3,))
        check_range("harris_k_shift", self.harris_k_shift, 0, 15)
        # With k >= 1/4 no response is positive: AB - C**2 is at most (A + B)**2 / 4.
        check_range("harris_k_numerator", self.harris_k_numerator, 0, min(((1 << self.harris_k_shift) - 1) // 4, 31))

    def _check_selection(self) -> None:
        check_choice("selection", self.selection, (True, False))
        if not self.selection and self.levels == 2:
            raise ValueError("selection is False, but two levels are ordered by cells; set levels = 1")
        if not self.selection and (self.cell_px or self.per_cell):
            raise ValueError("selection is False, but cell_px or per_cell is set; leave them out")
        check_range("max_features", self.max_features, 16, 4096)
        if self.cell_px is not None:
            check_choice("cell_px", self.cell_px, CELL_SIZES_PX)
        if self.per_cell is not None:
            check_range("per_cell", self.per_cell, 1, MAX_PER_CELL)

    @property
    def pattern(self) -> DescriptorPattern:
        """Pattern of the descriptor."""
        return PATTERNS[self.descriptor]

    @property
    def suppression(self) -> tuple[int, str]:
        """Radius of the suppression in pixels and its rule for ties: arguments of `golden_model.pixel.nms.suppress`."""
        return (1, "lose") if self.detector == "fast" else (self.suppression_radius_px, "first")

    @property
    def response_support_px(self) -> int:
        """Largest distance in x or y of a gray pixel that a response depends on."""
        return 3 if self.detector == "fast" else int(self.smoothed_gradients) + 1 + self.tensor_window_px // 2

    @property
    def min_border_px(self) -> int:
        """Smallest border that keeps every pixel a feature depends on, suppression included, inside the frame."""
        return max(self.pattern.support_px, self.response_support_px) + SUPPRESSION_MARGIN_PX

    @property
    def lag_px(self) -> int:
        """Pixels from the scan position, left and up, to the pixel whose corner and descriptor hardware has then.

        Alike for both detectors, since it is built in: that of smoothing, Sobel, tensor (5 px, also where only 3 are
        summed) and suppression, or that of the descriptor's rings, whichever is larger.
        """
        return max(self.pattern.support_px, int(self.smoothed_gradients) + 1 + 2 + self.suppression_radius_px)

    def min_hardware_border_px(self, pixels_per_clock: int) -> int:
        """Smallest border with which hardware counts a frame's last features before the next frame starts.

        That takes two lines; two pixels per clock make lines short, but at most by half.
        """
        return self.lag_px + 2 + pixels_per_clock - 1

    def for_size(self, width_px: int, height_px: int) -> FrontEndConfig:
        """This configuration with cell size and features per cell chosen for frames of one size.

        The cell is the smallest power of two from 32 px for which at least 3 features in each cell of all levels fit in
        ``max_features``. As many per cell are kept as fit, at most 5 with 32 px and at most 8 with larger cells. Values
        that are already set do not change.

        Raises
        ------
        ValueError
            If the size is outside 64..4096 px, or no cell fits.
        """
        check_range("frame width", width_px, MIN_FRAME_PX, MAX_FRAME_PX)
        check_range("frame height", height_px, MIN_FRAME_PX, MAX_FRAME_PX)
        if not self.selection:
            return self
        # The rule asks for 3 per cell; a cell size or a count that the user sets takes precedence.
        min_per_cell = self.per_cell or (1 if self.cell_px else 3)
        for cell_px in (self.cell_px,) if self.cell_px else CELL_SIZES_PX:
            fitting = self.max_features // self.count_cells(width_px, height_px, cell_px)
            if fitting >= min_per_cell:
                max_per_cell = self.per_cell or (5 if cell_px == CELL_SIZES_PX[0] else MAX_PER_CELL)
                return replace(self, cell_px=cell_px, per_cell=min(fitting, max_per_cell))
        raise ValueError(
            f"{width_px}x{height_px}: no cell size keeps the features within {self.max_features}; "
            "use a larger cell_px or fewer per_cell"
        )

    def count_cells(self, width_px: int, height_px: int, cell_px: int) -> int:
        """Number of cells, over all levels, that can hold a feature."""
        total = 0
        for level in range(self.levels):
            last_x = (width_px >> level) - 1 - self.border_px
            last_y = (height_px >> level) - 1 - self.border_px
            # The grid starts at pixel 0, so cells that lie in the border alone are included.
            if last_x >= self.border_px and last_y >= self.border_px:
                total += (last_x // cell_px + 1) * (last_y // cell_px + 1)
        # A frame that is too small for its border has none, but `for_size` divides by the number.
        return max(total, 1)


@dataclass(frozen=True, kw_only=True)
class MatcherConfig:
    """Configuration of matching and fuzzy filtering.

    Parameters
    ----------
    rule_base : {"aerial", "ilbp", "none"} or MatchRules
        Fuzzy system that gives the mutual matches their weights; a file of the configuration names it, names an
        ``.fll`` or ``.fis`` file beside itself, or holds FLL.
    keep_above : int
        A match is kept if its weight (UQ0.8) is larger than this: 64 represents 0.25.
    """

    rule_base: str | MatchRules = "aerial"
    keep_above: int = 64

    def __post_init__(self) -> None:
        if not isinstance(self.rule_base, MatchRules):
            check_choice("rule_base", self.rule_base, RULE_BASES)
        check_range("keep_above", self.keep_above, 0, 255)

    @property
    def rules(self) -> MatchRules | None:
        """The rules that decide matches; None for "none"."""
        if isinstance(self.rule_base, MatchRules):
            return self.rule_base
        return None if self.rule_base == "none" else shipped_rules(self.rule_base)

    @property
    def rules_name(self) -> str:
        """The name of the rules in reports."""
        return self.rule_base.name if isinstance(self.rule_base, MatchRules) else self.rule_base

    def rules_digest(self, pattern: DescriptorPattern) -> int:
        """The digest of the rules for a descriptor, 32 bits; 0 for "none"."""
        return self.rules.tables(pattern.bits).digest if self.rules else 0


@dataclass(frozen=True, kw_only=True)
class EstimatorConfig:
    """Configuration of the estimator of homographies (`golden_model.geometry.estimator`), all set by registers."""

    passes: int = 32
    """Most passes, of two samples each, in each of the 16 steps of the search; 8 bits, not 0."""
    seed: int = 0x9E3779B9
    """First state of the generator of random numbers; 32 bits, not 0."""
    min_inliers: int = 12
    """Fewest matches within 2 px of an accepted homography; 12 bits."""
    min_cells: int = 5
    """Fewest of the frame's 8 x 8 cells in which these lie."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """A complete configuration: front end and matcher, and the name of the preset that it is based on.

    With ``estimator``, every frame has a homography as well.
    """

    preset: str = "aerial"
    front_end: FrontEndConfig = field(default_factory=FrontEndConfig)
    matcher: MatcherConfig = field(default_factory=MatcherConfig)
    estimator: EstimatorConfig | None = None

    def rules_summary(self) -> dict[str, str]:
        """Name and digest of the rules that decide matches, for reports."""
        return {
            "rules": self.matcher.rules_name,
            "rules_digest": f"{self.matcher.rules_digest(self.front_end.pattern):08x}",
        }


PRESETS = {
    "aerial": Config(),
    "thesis": Config(
        preset="thesis",
        front_end=FrontEndConfig(
            levels=1,
            smoothed_gradients=False,
            tensor_window_px=3,
            # 5/128 is the thesis's 0.04.
            harris_k_numerator=5,
            harris_k_shift=7,
            # Not the published value, which belongs to another scale of responses.
            threshold=1000,
            suppression_radius_px=1,
            border_px=7,
            selection=False,
            descriptor="thesis-ilbp-4",
        ),
        # Weights from 1/2 on.
        matcher=MatcherConfig(rule_base="ilbp", keep_above=127),
    ),
}
"""The named configurations: `aerial` is the default, `thesis` follows the thesis."""


def preset_config(name: str) -> Config:
    """Return the preset with that name.

    Raises
    ------
    ValueError
        For an unknown name; the message lists the valid ones.
    """
    check_choice("preset", name, tuple(PRESETS))
    return PRESETS[name]
