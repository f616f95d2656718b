"""How each fuzzy system is plotted: names, units of the inputs, and the surface that shows its rules best."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from golden_model.feature.ilbp import PATTERNS
from golden_model.formats import POSITION
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.matching import correlation, rule_bases
from skymosaic.fuzzy.quantised import QuantisedSystem
from skymosaic.geometry import fuzzy_ransac


@dataclass(frozen=True)
class Axis:
    """Axis of an input: label with its unit, table entries per unit, and the value of entry 0."""

    label: str
    entries_per_unit: float = 1.0
    first: float = 0.0

    def units(self, entries: NDArray[np.integer]) -> Array:
        """Values of the input at table entries."""
        return np.asarray(self.first + entries / self.entries_per_unit)


@dataclass(frozen=True)
class PlottedSystem:
    """A fuzzy system and how it is plotted."""

    title: str
    system: Callable[[], SugenoSystem]
    """Creates the system."""
    axes: tuple[Axis, ...]
    """One for each input."""
    surface: tuple[int, int]
    """The two inputs of the rule surface."""
    sections: tuple[tuple[str, int], ...] = (("", 0),)
    """Title and table entry of the third input, if there is one, for each surface."""
    output: str = "weight of the match"
    """Name of the output."""
    span: tuple[float, float] = (0.0, 1.0)
    """Values of the output for weights of 0 and 1."""


def plan_plot(quantised: QuantisedSystem) -> PlottedSystem:
    """Plan the plot of a system from a file: a surface over the first two inputs, a third at its ends and its middle.

    Raises
    ------
    ValueError
        For fewer than two or more than three inputs.
    """
    system = quantised.real
    if not 2 <= len(system.inputs) <= 3:
        raise ValueError(f"has {len(system.inputs)} inputs; a picture shows two or three")
    last = quantised.entries - 1
    axes = tuple(Axis(i.name, last / (i.high - i.low), i.low) for i in system.inputs)
    third = axes[-1] if len(axes) == 3 else None
    sections = (
        [(f"{third.label} {third.units(np.array(e)):g}", e) for e in (0, last // 2, last)] if third else [("", 0)]
    )
    output = system.output
    return PlottedSystem(
        title=system.description or system.name,
        system=lambda: quantised.model,
        axes=axes,
        surface=(0, 1),
        sections=tuple(sections),
        output=output.name,
        span=(output.low, output.high),
    )


_BITS = PATTERNS["ilbp-128"].bits
_THESIS_BITS = PATTERNS["thesis-ilbp-4"].bits
_DISTANCE = Axis("Hamming distance, share of bits", _BITS)
_SAD, _ZSSD, _NCC = correlation.SAD_PER_PIXEL.one, correlation.ZSSD_PER_PIXEL.one, correlation.NCC.one

PLOTTED_SYSTEMS = {
    "correlation": PlottedSystem(
        "Fuzzy correlation (Tables III-1 and III-2)",
        rule_bases.correlation,
        (
            Axis("SAD, gray levels per pixel", _SAD),
            Axis("ZSSD, squared gray levels per pixel", _ZSSD),
            Axis("NCC", _NCC),
        ),
        surface=(0, 2),
        sections=(("ZSSD good", 0), ("ZSSD medium", 38 * _ZSSD), ("ZSSD bad", 60 * _ZSSD)),
    ),
    "ilbp": PlottedSystem(
        "Fuzzy ILBP",
        lambda: rule_bases.ilbp(_THESIS_BITS),
        (
            Axis("Hamming distance, share of bits", _THESIS_BITS),
            Axis("SAD of region 1, gray levels per pixel", 9),
            Axis("SAD of region 2, gray levels per pixel", 9),
        ),
        surface=(0, 1),
        sections=(("region 2 belongs", 0), ("region 2 in doubt", 86), ("region 2 does not belong", 153)),
    ),
    "ransac": PlottedSystem(
        "Fuzzy RANSAC (Table III-3)",
        fuzzy_ransac.rule_base,
        (Axis("bidirectional check (1: verified)"), Axis("error, px", POSITION.one)),
        surface=(1, 0),
    ),
    "aerial": PlottedSystem(
        "The aerial preset's rules",
        lambda: rule_bases.aerial(_BITS),
        (
            _DISTANCE,
            Axis("margin to the second best, share of bits", _BITS),
            Axis("deviation from the common relative orientation, sectors"),
        ),
        surface=(0, 1),
        sections=(("common orientation", 0), ("two sectors off", 2), ("four sectors off", 4)),
    ),
    "aerial-turn": PlottedSystem(
        "The aerial preset's votes for a common relative orientation",
        lambda: rule_bases.aerial_orientation(_BITS),
        (_DISTANCE, Axis("margin to the second best, share of bits", _BITS)),
        surface=(0, 1),
    ),
}
"""Every fuzzy system by name."""
