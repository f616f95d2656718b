"""Explains why a match was kept or rejected: degrees of membership, firing strengths of the rules, and the verdict.

The values are computed again from the records with the golden model's fuzzy systems.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from golden_model.feature.ilbp import PATTERNS
from golden_model.feature.orientation import SECTORS
from golden_model.formats import POSITION, WEIGHT
from golden_model.fuzzy.sugeno import ONE, SugenoSystem, Variable
from golden_model.matching import correlation
from golden_model.matching.matcher import measure
from skymosaic.features.descriptors import WINDOWS_PX
from skymosaic.features.matchers import GOOD_MATCH_ABOVE
from skymosaic.features.positions import match_points
from skymosaic.geometry.homography import transfer_error
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.registration.pair import Pair

_DEGREES_PER_SECTOR = 360 / SECTORS


@dataclass(frozen=True)
class Input:
    """An input of the fuzzy system for one match: its value and its degree of membership in each set, 0 to 1."""

    variable: Variable
    value: int
    degrees: dict[str, float]


@dataclass(frozen=True)
class FiredRule:
    """A rule for one match: its condition in words, output, firing strength, 0 to 1, and whether it is dominant."""

    words: str
    output: float
    strength: float
    dominant: bool


@dataclass(frozen=True)
class Explanation:
    """Why one match was kept or rejected."""

    verdict: str
    """An inlier is kept and on the homography; an outlier is kept, but off it or without one; else "rejected"."""
    reason: str
    """The verdict and its cause in words."""
    facts: dict[str, str]
    """Measured quantities and their values."""
    inputs: tuple[Input, ...] = ()
    rules: tuple[FiredRule, ...] = ()
    """Both empty if no fuzzy system weighed the match."""


def classify_matches(pair: Pair) -> list[str]:
    """The verdict on each match, as in `Explanation`, in the order of the match records."""
    inlier = np.isin(pair.matches["left_index"], pair.inliers["left_index"])
    names = np.where(inlier, "inlier", np.where(pair.matches["verdict"] == 1, "outlier", "rejected"))
    return [str(name) for name in names]


def measure_residuals(pair: Pair) -> Array | None:
    """Distance of each match, also of those rejected, from the homography, working px; None without a homography."""
    homography = pair.working_homography
    return None if homography is None else transfer_error(homography, *match_points(pair.matches))


def explain(pair: Pair, index: int) -> Explanation:
    """Explain one match of a pair."""
    verdict, match, rule_names = classify_matches(pair)[index], pair.matches[index], pair.method.rule_names(pair.config)
    beginning = "Rejected." if verdict == "rejected" else "Kept."
    facts, end = _list_facts(pair, index), _describe_residual(pair, index)
    weighing = _find_weighing(pair, index)
    if weighing is None:
        return Explanation(verdict, f"{beginning} {rule_names[match['rule']].capitalize()}.{end}", facts)
    system, values = weighing
    strengths = system.strengths(*(np.array([value]) for value in values))[0] / system.strength_one
    inputs = (
        # Beyond the end of a table its last degree applies, as in the hardware.
        Input(variable, value, {name: table[min(value, len(table) - 1)] / ONE for name, table in variable.sets.items()})
        for variable, value in zip(system.inputs, values, strict=True)
    )
    weight = int(match["weight"])
    limit = GOOD_MATCH_ABOVE if pair.method.descriptor in WINDOWS_PX else pair.config.matcher.keep_above
    comparison = "above" if weight > limit else "not above"
    reason = (
        f"{beginning} The rules give it the weight {weight / WEIGHT.one:.2f}, {comparison} the limit of "
        f"{limit / WEIGHT.one:.2f}; the dominant rule: {rule_names[match['rule']]}.{end}"
    )
    rules = (
        FiredRule(words, rule.output, float(strength), dominant=number == match["rule"])
        for number, (words, rule, strength) in enumerate(zip(rule_names, system.rules, strengths, strict=True))
    )
    return Explanation(verdict, reason, facts, tuple(inputs), tuple(rules))


def _find_weighing(pair: Pair, index: int) -> tuple[SugenoSystem, tuple[int, ...]] | None:
    """The fuzzy system that weighed a match, and its inputs; None if another check decided."""
    match = pair.matches[index]
    left = pair.features[0][match["left_index"]]
    right = pair.features[1][match["right_index"]]
    system = pair.method.rules(pair.config)
    if system is None:
        return None
    values: Iterable[NDArray[np.integer[Any]]]
    if pair.method.descriptor in WINDOWS_PX:
        values = correlation.fuzzy_inputs(left["descriptor"][np.newaxis], right["descriptor"][np.newaxis])
    else:
        values = measure(pair.matches[index : index + 1], *pair.features, system)
    return system, tuple(int(value[0]) for value in values)


def _list_facts(pair: Pair, index: int) -> dict[str, str]:
    """Measured quantities of a match and their values; positions in working pixels."""
    match, pattern = pair.matches[index], PATTERNS.get(pair.method.descriptor)
    facts = {}
    for side in ("left", "right"):
        facts[f"{side} x, y"] = ", ".join(f"{match[f'{side}_{axis}'] / POSITION.one:.2f}" for axis in "xy")
    if pattern is None:
        facts |= {"distance": str(match["distance"]), "margin": str(match["margin"])}
    else:
        facts["distance"] = f"{match['distance']} of {pattern.bits} bits"
        facts["margin to the second best"] = f"{match['margin']} bits"
        if pattern.oriented:
            angles = (match[name] * _DEGREES_PER_SECTOR for name in ("turn", "peak_turn"))
            facts["orientation, most common"] = ", ".join(f"{angle:.1f}°" for angle in angles)
    return facts | {"weight": f"{match['weight'] / WEIGHT.one:.3f}"}


def _describe_residual(pair: Pair, index: int) -> str:
    """Say how far the match lies from the homography."""
    residual_px = measure_residuals(pair)
    if residual_px is None:
        return " There is no homography to compare it with."
    side = "within" if residual_px[index] <= INLIER_PX else "beyond"
    return f" It lies {residual_px[index]:.1f} px from the homography, {side} the {INLIER_PX:g} px of an inlier."
