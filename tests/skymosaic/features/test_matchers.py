import cv2
import numpy as np
import pytest

from golden_model.records import feature_record
from skymosaic.features.matchers import match_by_correlation, match_by_ratio, track_features

NORMS = (cv2.NORM_L2, cv2.NORM_HAMMING)


def records(descriptors: np.ndarray) -> np.ndarray:
    features = np.zeros(len(descriptors), feature_record(descriptors.shape[1]).dtype)
    features["descriptor"] = descriptors
    features["x"] = np.arange(len(features))
    return features


def noisy_pair(seed: int, count: int = 150, length: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """Descriptors of which two thirds recur, shuffled and disturbed, among others that do not."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, 256, (count, length), dtype=np.uint8)
    right = rng.integers(0, 256, (count, length), dtype=np.uint8)
    recurring = rng.permutation(count)[: 2 * count // 3]
    right[: len(recurring)] = left[recurring] ^ rng.integers(0, 2, (len(recurring), length), dtype=np.uint8)
    return records(left), records(right)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("seed", range(3))
def test_kept_matches_are_those_of_opencvs_matcher(norm: int, seed: int) -> None:
    left, right = noisy_pair(seed)
    kind = np.float32 if norm == cv2.NORM_L2 else np.uint8
    first, second = (np.ascontiguousarray(side["descriptor"]).astype(kind) for side in (left, right))
    matcher = cv2.BFMatcher(norm)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(second, first)}
    expected = [
        (best.queryIdx, best.trainIdx)
        for best, other in matcher.knnMatch(first, second, k=2)
        if best.distance < 0.8 * other.distance and back[best.trainIdx] == best.queryIdx
    ]
    matches = match_by_ratio(left, right, norm)
    kept = matches[matches["verdict"] == 1]
    assert len(expected) > 50
    assert list(zip(kept["left_index"], kept["right_index"], strict=True)) == expected
    if norm == cv2.NORM_HAMMING:
        best = [round(matcher.match(first[one : one + 1], second)[0].distance) for one in kept["left_index"]]
        np.testing.assert_array_equal(kept["distance"], best)


def test_one_match_for_each_feature_of_image_2_and_the_closest() -> None:
    left = np.zeros((3, 8), np.uint8)
    left[0, 0], left[1, 0], left[2] = 0b11, 0b1, 0xFF
    right = np.zeros((2, 8), np.uint8)
    right[1] = 0xFF
    matches = match_by_ratio(records(left), records(right), cv2.NORM_HAMMING)
    np.testing.assert_array_equal(matches["left_index"], [1, 2])
    np.testing.assert_array_equal(matches["distance"], [1, 0])
    np.testing.assert_array_equal(matches["margin"], [62, 64])


@pytest.mark.parametrize("sizes", [(0, 5), (5, 0), (1, 5), (5, 1)])
def test_without_a_second_nearest_there_is_no_ratio(sizes: tuple[int, int]) -> None:
    left, right = (records(np.zeros((count, 8), np.uint8)) for count in sizes)
    assert len(match_by_ratio(left, right, cv2.NORM_HAMMING)) == 0
    both = np.zeros((40, 40), np.uint8)
    assert len(match_by_correlation(left, right)) == min(sizes)
    assert len(track_features(both, both, left[:0], right)[1]) == 0


def test_good_matches_only_are_kept() -> None:
    # The same window; one with SAD and ZSSD medium and NCC good: a medium match; one far off: a bad one.
    rng = np.random.default_rng(0)
    left = rng.integers(60, 190, (3, 9), dtype=np.uint8)
    signs = np.array([1, -1, 1, -1, 0, 1, -1, 1, -1])
    right = np.stack([left[0], left[1] + 7 * signs, left[2] + 30 * signs]).astype(np.uint8)
    matches = match_by_correlation(records(left), records(right))
    np.testing.assert_array_equal(matches["weight"], [255, 128, 0])
    np.testing.assert_array_equal(matches["verdict"], [1, 0, 0])


def test_tracked_features_follow_a_shift_and_come_back() -> None:
    rng = np.random.default_rng(1)
    scene = cv2.GaussianBlur(rng.integers(0, 256, (200, 240), dtype=np.uint8), (0, 0), 2)
    scene = cv2.normalize(scene, None, 0, 255, cv2.NORM_MINMAX)
    left_gray, right_gray = scene[20:180, 20:220], scene[17:177, 15:215]
    left = records(np.empty((5, 0), np.uint8))
    # The last one leaves the image below.
    left["x"], left["y"] = [640, 960, 1280, 1600, 1600], [640, 960, 1280, 1600, 157 * 16]
    features, matches = track_features(left_gray, right_gray, left, left[:2])
    kept = matches[matches["verdict"] == 1]
    assert len(kept) == 4
    np.testing.assert_allclose(kept["right_x"].astype(int) - kept["left_x"], 5 * 16, atol=1)
    np.testing.assert_allclose(kept["right_y"].astype(int) - kept["left_y"], 3 * 16, atol=1)
    np.testing.assert_array_equal(matches["right_index"], np.arange(2, 6))
    np.testing.assert_array_equal(features["index"], np.arange(6))
