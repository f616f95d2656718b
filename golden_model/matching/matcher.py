"""Matching of two feature sets: mutual nearest neighbours, their common relative orientation, and fuzzy weights."""

from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Records
from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import DescriptorPattern
from golden_model.feature.orientation import SECTORS
from golden_model.formats import WEIGHT
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.matching import correlation, hamming, rule_bases
from golden_model.records import MATCH, Tag

Frame = TypeVar("Frame")


class ReferenceFrame(Generic[Frame]):
    """The frame that other frames are matched with; `hdl.matching.feature_banks.FeatureBanks` follows the same rule.

    The first good frame becomes the reference. A frame that holds the reference is matched with it; for another, the
    good frame before it becomes the reference first. The first good frame and bad frames are not matched.

    Accepted homographies make a chain. Once there is one, a frame whose homography is refused does not become the
    reference. Before, it does: otherwise all would be matched with a dark first frame.
    """

    def __init__(self) -> None:
        self._reference: Frame | None = None
        self._latest: Frame | None = None
        self._is_chained = False

    def for_frame(self, frame: Frame, *, good: bool, held: bool) -> Frame | None:
        """Return the reference to match the next frame with, or None, and update the reference."""
        if not good:
            return None
        reference = self._reference if held else self._latest
        self._reference, self._latest = frame if reference is None else reference, frame
        return reference

    def judge(self, *, accepted: bool) -> None:
        """Take note of whether the last good frame's homography is accepted."""
        self._is_chained |= accepted
        if self._is_chained and not accepted:
            self._latest = self._reference


def match(
    left_features: Records,
    right_features: Records,
    pattern: DescriptorPattern,
    config: MatcherConfig,
    distance: NDArray[np.unsignedinteger] | None = None,
) -> Records:
    """Match two feature sets and give every match a weight.

    Parameters
    ----------
    left_features, right_features : (F1,), (F2,) structured
        Feature records of ``pattern`` in their order of emission, so that a feature's row is its index. Left is the
        reference. Either may be empty.
    pattern : DescriptorPattern
        The pattern both were described with.
    config : MatcherConfig
        Rule base, and smallest weight that is kept.
    distance : (F1, F2) unsigned, optional
        Distances in which the caller has excluded pairs by ``pattern.bits``, the largest; default: Hamming distances.

    Returns
    -------
    (M,) structured
        `golden_model.records.MATCH` records of the mutual matches, in rising left index; ``verdict`` says which are
        kept: those whose weight exceeds ``config.keep_above``, or all with the rule base "none". ``turn`` (relative
        orientation) and ``peak_turn`` are 0 for a pattern without orientation.

    Raises
    ------
    ValueError
        If the descriptors do not have the pattern's length, or the rule base needs a window the pattern does not
        carry.
    """
    _check(left_features, right_features, pattern, config)
    if distance is None:
        distance = hamming.distances(left_features["descriptor"], right_features["descriptor"])
    left_index, right_index, best, margin = hamming.mutual_matches(distance, pattern.bits)
    left, right = left_features[left_index], right_features[right_index]

    matches = pair_features(left_features, right_features, left_index, right_index)
    matches["distance"], matches["margin"] = best, margin
    if pattern.oriented:
        # 8-bit differences wrap around, which is harmless: 256 is a multiple of the sectors.
        matches["turn"] = (right["sector"] - left["sector"]) % SECTORS
        matches["peak_turn"] = common_orientation(matches["turn"], best, margin, pattern.bits)

    return weigh(matches, left_features, right_features, pattern, config)


def weigh(
    matches: Records, left_features: Records, right_features: Records, pattern: DescriptorPattern, config: MatcherConfig
) -> Records:
    """The same matches with the weight, rule and verdict that ``config`` gives them."""
    weighed, rules = matches.copy(), config.rules
    if rules is None:
        weighed["weight"], weighed["rule"], weighed["verdict"] = WEIGHT.max_raw, 0, 1
        return weighed
    tables = rules.tables(pattern.bits)
    weight, rule = tables.evaluate(*measure(matches, left_features, right_features, tables))
    weighed["weight"], weighed["rule"], weighed["verdict"] = weight, rule, weight > config.keep_above
    return weighed


def measure(
    matches: Records, left_features: Records, right_features: Records, tables: SugenoSystem
) -> list[NDArray[np.integer]]:
    """What the inputs of the rules are for each match: (M,) indices into the tables of every input."""
    off_peak = circular_distance(matches["turn"], matches["peak_turn"])
    quantities = {"distance": matches["distance"], "margin": matches["margin"], "orientation": off_peak}
    names = [variable.name for variable in tables.inputs]
    if "SAD_r1" in names:
        left, right = left_features[matches["left_index"]], right_features[matches["right_index"]]
        # The SAD is symmetric, so both belongings of the rules follow from it.
        quantities["SAD_r1"] = quantities["SAD_r2"] = correlation.sad(left["window"], right["window"])
    return [quantities[name] for name in names]


def pair_features(
    left_features: Records, right_features: Records, left_index: NDArray[np.integer], right_index: NDArray[np.integer]
) -> Records:
    """Make match records (M,) of paired features, with indices and positions; all other fields are 0."""
    matches = np.zeros(len(left_index), dtype=MATCH.dtype)
    matches["tag"] = Tag.MATCH
    matches["left_index"], matches["right_index"] = left_index, right_index
    matches["reference"] = left_features["frame"][left_index]
    for axis in ("x", "y"):
        matches[f"left_{axis}"] = left_features[axis][left_index]
        matches[f"right_{axis}"] = right_features[axis][right_index]
    return matches


def rule_names(pattern: DescriptorPattern, config: MatcherConfig) -> list[str]:
    """Describe the rules of the configured rule base; the ``rule`` field of match records is an index into the list."""
    return describe_rules(config.rules.tables(pattern.bits)) if config.rules else ["no rules"]


def describe_rules(system: SugenoSystem) -> list[str]:
    """Describe the conditions of each rule of a system."""
    return [
        ", ".join(
            f"{variable.name} {chosen}" for variable, chosen in zip(system.inputs, rule.sets, strict=True) if chosen
        )
        for rule in system.rules
    ]


def common_orientation(
    orientation: NDArray[np.uint8], distance: NDArray[np.uint16], margin: NDArray[np.uint16], bits: int
) -> int:
    """Peak of the weighted, smoothed histogram of relative orientations.

    A match counts with the square of its weight from `golden_model.matching.rule_bases.aerial_orientation` (16 bits).
    The histogram is smoothed around the circle by 4 h + 3 h₋ + 3 h₊, and the first maximum is taken. Sums of up to
    4096 matches fit 32 bits.

    Parameters
    ----------
    orientation : (M,) uint8
        Relative orientations, 0..15 sixteenths of a full circle.
    distance, margin : (M,) uint16
        As `golden_model.matching.hamming.mutual_matches` returns them.
    bits : int
        Length of the descriptors.
    """
    weight, _ = rule_bases.aerial_orientation(bits).evaluate(distance, margin)
    histogram = np.zeros(SECTORS, dtype=np.int64)
    # Not `histogram[orientation] +=`, which would count a repeated index once.
    np.add.at(histogram, orientation, weight.astype(np.int64) ** 2)
    return int(np.argmax(4 * histogram + 3 * np.roll(histogram, 1) + 3 * np.roll(histogram, -1)))


def circular_distance(orientation: NDArray[np.uint8], peak: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Distance between two relative orientations around the circle, 0..8 sectors."""
    ahead = (orientation - peak) % SECTORS
    distance: NDArray[np.uint8] = np.minimum(ahead, SECTORS - ahead)
    return distance


def _check(left: Records, right: Records, pattern: DescriptorPattern, config: MatcherConfig) -> None:
    for side, features in (("left", left), ("right", right)):
        length = features.dtype["descriptor"].shape[0]
        if length != pattern.descriptor_bytes:
            raise ValueError(
                f"{side} descriptors have {length} bytes, {pattern.name} has {pattern.descriptor_bytes}; "
                "match with the pattern the features were described with"
            )
    check_rule_base(pattern, config)


def check_rule_base(pattern: DescriptorPattern, config: MatcherConfig) -> None:
    """Make the tables of the rules.

    Raises
    ------
    ValueError
        If they cannot be made, or the rules need a gray window that the pattern does not carry.
    """
    rules = config.rules
    if rules is None:
        return
    if rules.compares_windows and not pattern.carries_window:
        raise ValueError(
            f"rule base {config.rules_name!r} needs the gray window around each feature, which {pattern.name} does not "
            "carry; use a thesis-ilbp descriptor or the rule base 'aerial'"
        )
    rules.tables(pattern.bits)
