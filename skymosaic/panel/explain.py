"""Explains why a match was kept or rejected: degrees of membership, firing strengths of the rules, and the verdict.

The values are computed again from the records with the golden model's fuzzy systems.
"""

from dataclasses import dataclass

import numpy as np

from golden_model.feature.ilbp import PATTERNS
from golden_model.feature.orientation import SECTORS
from golden_model.formats import POSITION
from golden_model.matching import correlation, rule_bases
from golden_model.matching.fuzzy import ONE, SugenoSystem, Variable
from golden_model.matching.matcher import measure
from skymosaic.features.descriptors import WINDOWS_PX
from skymosaic.geometry.prosac import INLIER_PX
from skymosaic.panel.pair_view import PairView

WEIGHT_SCALE = 256
"""Scale of a match record's ``weight``, UQ0.8."""
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
    """Why one match was kept or rejected.

    Attributes
    ----------
    verdict : {"inlier", "outlier", "rejected"}
        Kept and on the homography; kept, but off it or without one; not kept.
    reason : str
        The verdict and its cause in words.
    facts : tuple of (str, str)
        Measured quantities and their values.
    inputs : tuple of Input
    rules : tuple of FiredRule
        Both empty if no fuzzy system weighed the match.
    """

    verdict: str
    reason: str
    facts: tuple[tuple[str, str], ...]
    inputs: tuple[Input, ...] = ()
    rules: tuple[FiredRule, ...] = ()


def classify_matches(view: PairView) -> list[str]:
    """The verdict on each match, as in `Explanation`, in the order of the match records."""
    names = np.where(view.inlier, "inlier", np.where(view.kept, "outlier", "rejected"))
    return [str(name) for name in names]


def explain(view: PairView, index: int) -> Explanation:
    """Explain one match of a pair."""
    verdict, match = classify_matches(view)[index], view.matches[index]
    beginning = "Rejected." if verdict == "rejected" else "Kept."
    facts = _list_facts(view, index)
    weighing = _find_weighing(view, index)
    if weighing is None:
        reason = f"{beginning} {view.rule_names[match['rule']].capitalize()}."
        return Explanation(verdict, reason + _describe_residual(view, index), facts)
    system, values = weighing
    strengths = system.strengths(*(np.array([value]) for value in values))[0] / system.strength_one
    # Beyond the end of a table its last degree applies, as in the hardware.
    degrees = ({name: table[min(v, len(table) - 1)] / ONE for name, table in variable.sets.items()}
               for variable, v in zip(system.inputs, values, strict=True))  # fmt: skip
    weight, limit = int(match["weight"]), view.keep_above
    comparison = "above" if weight > limit else "not above"
    reason = (
        f"{beginning} The rules give it the weight {weight / WEIGHT_SCALE:.2f}, {comparison} the limit of "
        f"{limit / WEIGHT_SCALE:.2f}; the dominant rule: {view.rule_names[match['rule']]}."
    )
    return Explanation(
        verdict,
        reason + _describe_residual(view, index),
        facts,
        tuple(map(Input, system.inputs, values, degrees)),
        tuple(
            FiredRule(words, rule.output, float(strength), dominant=number == match["rule"])
            for number, (words, rule, strength) in enumerate(zip(view.rule_names, system.rules, strengths, strict=True))
        ),
    )


def _find_weighing(view: PairView, index: int) -> tuple[SugenoSystem, tuple[int, ...]] | None:
    """The fuzzy system that weighed a match, and its inputs; None if another check decided."""
    match = view.matches[index]
    left = view.features[0][match["left_index"]]
    right = view.features[1][match["right_index"]]
    if view.method.descriptor in WINDOWS_PX:
        scores = correlation.fuzzy_inputs(left["descriptor"][np.newaxis], right["descriptor"][np.newaxis])
        return rule_bases.correlation(), tuple(int(score[0]) for score in scores)
    rules = view.config.matcher.rules
    if view.method.descriptor not in PATTERNS or rules is None:
        return None
    tables = rules.tables(PATTERNS[view.method.descriptor].bits)
    values = measure(view.matches[index : index + 1], *view.features, tables)
    return tables, tuple(int(value[0]) for value in values)


def _list_facts(view: PairView, index: int) -> tuple[tuple[str, str], ...]:
    """Measured quantities of a match and their values; positions in working pixels."""
    match = view.matches[index]
    positions = [f"{match[f'{side}_x'] / POSITION.one:.2f}, {match[f'{side}_y'] / POSITION.one:.2f}"
              for side in ("left", "right")]  # fmt: skip
    facts = [("left x, y", positions[0]), ("right x, y", positions[1])]
    pattern = PATTERNS.get(view.method.descriptor)
    if pattern is None:
        facts += [("distance", str(match["distance"])), ("margin", str(match["margin"]))]
    else:
        facts += [
            ("distance", f"{match['distance']} of {pattern.bits} bits"),
            ("margin to the second best", f"{match['margin']} bits"),
        ]
        if pattern.oriented:
            angles = (match[name] * _DEGREES_PER_SECTOR for name in ("turn", "peak_turn"))
            facts.append(("orientation, most common", ", ".join(f"{angle:.1f}°" for angle in angles)))
    return (*facts, ("weight", f"{match['weight'] / WEIGHT_SCALE:.3f}"))


def _describe_residual(view: PairView, index: int) -> str:
    """Say how far the match lies from the homography."""
    if view.residual_px is None:
        return " There is no homography to compare it with."
    distance = view.residual_px[index]
    side = "within" if distance <= INLIER_PX else "beyond"
    return f" It lies {distance:.1f} px from the homography, {side} the {INLIER_PX:g} px of an inlier."
