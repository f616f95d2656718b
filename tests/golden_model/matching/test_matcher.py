"""The matcher equals its definition, written as loops over real numbers."""

import numpy as np
import pytest

from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import ILBP_128, ILBP_256, PATTERNS, DescriptorPattern
from golden_model.matching import matcher, rule_bases
from golden_model.records import MATCH, Tag

TOLERANCE = 7 / 512
"""Tolerance: rounding of three degrees, a singleton and the weight to 8 fraction bits, and 1 stored as 255/256."""


def random_features(rng: np.random.Generator, count: int, pattern: DescriptorPattern) -> np.ndarray:
    features = np.zeros(count, dtype=pattern.record.dtype)
    features["index"] = np.arange(count)
    features["x"], features["y"] = rng.integers(20 * 16, 600 * 16, (2, count))
    features["descriptor"] = rng.integers(0, 256, (count, pattern.descriptor_bytes))
    if pattern.oriented:
        features["sector"] = rng.integers(0, 16, count)
    if pattern.carries_window:
        features["window"] = rng.integers(0, 256, (count, 9))
    return features


def seen_again(rng: np.random.Generator, left: np.ndarray, pattern: DescriptorPattern, turn: int) -> np.ndarray:
    """The features, shuffled and rotated, each with its own amount of noise, so that every rule fires."""
    right = left[rng.permutation(len(left))]
    noise = rng.uniform(0, 0.5, (len(left), 1))
    right["descriptor"] ^= np.packbits(rng.random((len(left), pattern.bits)) < noise, axis=1)
    if pattern.oriented:
        scatter = rng.choice([-3, -2, -1, 0, 1, 2, 8], len(left), p=[0.05, 0.1, 0.2, 0.35, 0.2, 0.05, 0.05])
        right["sector"] = (right["sector"] + turn + scatter) % 16
    if pattern.carries_window:
        disturbance = rng.normal(0, rng.uniform(0, 30, (len(left), 1)), (len(left), 9))
        right["window"] = np.clip(right["window"] + disturbance, 0, 255)
    return right


def clip01(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def product_weight(low: float, big: float, outputs: tuple[float, float, float, float]) -> float:
    corners = (low * big, low * (1 - big), (1 - low) * big, (1 - low) * (1 - big))
    return sum(corner * output for corner, output in zip(corners, outputs, strict=True))


def naive_turn(matches: np.ndarray, bits: int) -> int:
    histogram = [0.0] * 16
    for match in matches:
        low = clip01((0.34 - match["distance"] / bits) / 0.24)
        big = clip01((match["margin"] / bits - 0.01) / 0.13)
        histogram[match["turn"]] += product_weight(low, big, (1, 0.35, 0.5, 0)) ** 2
    smooth = [4 * histogram[i] + 3 * histogram[i - 1] + 3 * histogram[(i + 1) % 16] for i in range(16)]
    return smooth.index(max(smooth))


def naive_weight(match: np.void, bits: int) -> float:
    low = clip01((0.34 - match["distance"] / bits) / 0.24)
    big = clip01(match["margin"] / bits / 0.10)
    apart = abs(int(match["turn"]) - int(match["peak_turn"]))
    belongs = {0: 1.0, 1: 1.0, 2: 0.6, 3: 0.2}.get(min(apart, 16 - apart), 0.0)
    common, other = (1, 0.6, 0.6, 0.2), (0.15, 0.05, 0.02, 0)
    first, second, third, fourth = (belongs * c + (1 - belongs) * o for c, o in zip(common, other, strict=True))
    return product_weight(low, big, (first, second, third, fourth))


@pytest.mark.parametrize("pattern", [ILBP_128, ILBP_256, PATTERNS["ilbp-128-upright"]], ids=lambda p: p.name)
@pytest.mark.parametrize("turn", [0, 9])
def test_aerial_matches_equal_loops_over_real_numbers(pattern: DescriptorPattern, turn: int) -> None:
    rng = np.random.default_rng(turn)
    left = random_features(rng, 400, pattern)
    right = seen_again(rng, left, pattern, turn)[:380]
    matches = matcher.match(left, right, pattern, MatcherConfig())

    assert matches.dtype == MATCH.dtype
    assert (matches["tag"] == Tag.MATCH).all()
    assert len(matches) > 200
    assert (np.diff(matches["left_index"].astype(int)) > 0).all()
    if pattern.oriented:
        assert set(matches["peak_turn"]) == {naive_turn(matches, pattern.bits)} == {turn}
    else:
        assert not matches["turn"].any()
        assert not matches["peak_turn"].any()
    for match in matches:
        a, b = left[match["left_index"]], right[match["right_index"]]
        assert [match[name] for name in ("left_x", "left_y", "right_x", "right_y")] == [a["x"], a["y"], b["x"], b["y"]]
        assert match["distance"] == np.unpackbits(a["descriptor"] ^ b["descriptor"]).sum()
        assert match["turn"] == (int(b["sector"]) - int(a["sector"])) % 16
        assert abs(match["weight"] / 256 - naive_weight(match, pattern.bits)) <= TOLERANCE
        assert match["verdict"] == (match["weight"] > 64)
    # Not a matter of chance: both verdicts and most rules occur.
    assert 0 < matches["verdict"].sum() < len(matches)
    assert len(set(matches["rule"])) >= (6 if pattern.oriented else 3)


@pytest.mark.parametrize("rings", [1, 4])
def test_ilbp_rule_base_uses_the_sad_of_the_windows(rings: int) -> None:
    pattern = PATTERNS[f"thesis-ilbp-{rings}"]
    rng = np.random.default_rng(rings)
    left = random_features(rng, 200, pattern)
    matches = matcher.match(
        left, right := seen_again(rng, left, pattern, 0), pattern, MatcherConfig(rule_base="ilbp", keep_above=127)
    )
    system = rule_bases.ilbp(pattern.bits)
    for match in matches:
        a, b = left[match["left_index"]], right[match["right_index"]]
        sad = np.abs(a["window"].astype(int) - b["window"]).sum(keepdims=True)
        weight, rule = system.evaluate(match["distance"][np.newaxis], sad, sad)
        assert (match["weight"], match["rule"]) == (weight.item(), rule.item())
        assert match["verdict"] == (weight.item() > 127)
    assert 0 < matches["verdict"].sum() < len(matches)


def test_none_keeps_all_with_full_weight() -> None:
    rng = np.random.default_rng(2)
    left = random_features(rng, 100, ILBP_128)
    right = seen_again(rng, left, ILBP_128, 3)
    weighed = matcher.match(left, right, ILBP_128, MatcherConfig())
    matches = matcher.match(left, right, ILBP_128, MatcherConfig(rule_base="none", keep_above=255))
    assert (matches["left_index"] == weighed["left_index"]).all()
    assert (matches["weight"] == 255).all()
    assert (matches["verdict"] == 1).all()


@pytest.mark.parametrize("counts", [(0, 0), (0, 7), (7, 0)])
@pytest.mark.parametrize(
    ("rule_base", "name"), [("aerial", "ilbp-128"), ("ilbp", "thesis-ilbp-4"), ("none", "ilbp-256")]
)
def test_without_features_there_are_no_matches(counts: tuple[int, int], rule_base: str, name: str) -> None:
    rng = np.random.default_rng(4)
    left, right = (random_features(rng, count, PATTERNS[name]) for count in counts)
    matches = matcher.match(left, right, PATTERNS[name], MatcherConfig(rule_base=rule_base))
    assert matches.shape == (0,)
    assert matches.dtype == MATCH.dtype


def test_rules_are_named_by_the_index_a_match_carries() -> None:
    names = matcher.rule_names(ILBP_128, MatcherConfig())
    assert names[1] == "distance low, margin big, orientation other"
    assert [
        len(matcher.rule_names(p, MatcherConfig(rule_base=base)))
        for p, base in ((ILBP_128, "aerial"), (PATTERNS["thesis-ilbp-2"], "ilbp"), (ILBP_128, "none"))
    ] == [8, 4, 1]


@pytest.mark.parametrize(
    ("turns", "distances", "common"),
    [
        ([12, 4, 12, 4], [0] * 4, 4),  # Of two with equal support, the smaller one wins.
        ([3, 3, 3, 9], [60, 60, 60, 0], 9),  # Squared weights count: three of 0.5 lose against one of 1.
        ([15, 1], [0, 0], 0),  # Both support the sector between them, around the circle: 3 + 3 beats 4.
    ],
)
def test_the_common_orientation_has_the_largest_support(turns: list[int], distances: list[int], common: int) -> None:
    margin = np.full(len(turns), 30, dtype=np.uint16)
    found = matcher.common_orientation(np.array(turns, np.uint8), np.array(distances, np.uint16), margin, bits=128)
    assert found == common


def test_wrong_pattern_is_refused() -> None:
    rng = np.random.default_rng(5)
    left, right = random_features(rng, 3, ILBP_128), random_features(rng, 3, ILBP_256)
    with pytest.raises(ValueError, match="right descriptors have 32 bytes, ilbp-128 has 16"):
        matcher.match(left, right, ILBP_128, MatcherConfig())
    with pytest.raises(ValueError, match="'ilbp' needs the gray window around each feature, which ilbp-128"):
        matcher.match(left, left, ILBP_128, MatcherConfig(rule_base="ilbp"))


@pytest.mark.parametrize(
    ("held", "references"),
    [
        ([True] * 6, [None, None, "b", None, "b", "b"]),
        ([False] * 6, [None, None, "b", None, "c", "e"]),
        ([True, True, True, True, False, True], [None, None, "b", None, "c", "c"]),
    ],
)
def test_the_reference_is_the_first_good_frame_or_the_one_before(
    held: list[bool], references: list[str | None]
) -> None:
    rule: matcher.ReferenceFrame[str] = matcher.ReferenceFrame()
    frames = zip("abcdef", (False, True, True, False, True, True), held, strict=True)
    assert [rule.for_frame(frame, good=good, held=hold) for frame, good, hold in frames] == references


def test_a_refused_frame_becomes_the_reference_only_before_the_first_accepted_one() -> None:
    rule: matcher.ReferenceFrame[str] = matcher.ReferenceFrame()
    references = []
    for frame in "abcdefgh":
        references.append(rule.for_frame(frame, good=frame != "e", held=False))
        if frame != "e":
            rule.judge(accepted=frame in "cf")
    assert references == [None, "a", "b", "c", None, "c", "f", "f"]
