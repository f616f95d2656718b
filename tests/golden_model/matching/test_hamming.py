"""Distances and mutual matches equal naive loops and OpenCV's brute-force matcher with cross-check."""

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from golden_model.matching import hamming


def naive_mutual(distance: list[list[int]], bits: int) -> list[tuple[int, int, int, int]]:
    columns = [list(column) for column in zip(*distance, strict=True)]
    matches = []
    for i, row in enumerate(distance):
        j = row.index(min(row))
        if columns[j].index(min(columns[j])) != i:
            continue
        others = row[:j] + row[j + 1 :] + columns[j][:i] + columns[j][i + 1 :]
        matches.append((i, j, row[j], min([*others, bits]) - row[j]))
    return matches


@given(
    left_count=st.integers(0, 70),
    right_count=st.integers(0, 70),
    descriptor_bytes=st.integers(1, 33),
    seed=st.integers(0, 2**32 - 1),
)
def test_distance_counts_differing_bits(left_count: int, right_count: int, descriptor_bytes: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    left = rng.integers(0, 256, (left_count, descriptor_bytes), dtype=np.uint8)
    right = rng.integers(0, 256, (right_count, descriptor_bytes), dtype=np.uint8)
    distance = hamming.distances(left, right)
    expected = (np.unpackbits(left, axis=1)[:, np.newaxis] != np.unpackbits(right, axis=1)).sum(axis=2)
    assert distance.dtype == (np.uint8 if descriptor_bytes < 32 else np.uint16)
    assert (distance == expected).all()


# Few distinct values: ties everywhere.
@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 4)))
def test_matches_ties_and_margins_equal_naive_loops(distance: Any) -> None:
    left, right, best, margin = hamming.mutual_matches(distance, bits=8)
    pairs = list(zip(left.tolist(), right.tolist(), best.tolist(), margin.tolist(), strict=True))
    assert pairs == naive_mutual(distance.tolist(), 8)
    assert best.dtype == margin.dtype == np.uint16


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
def test_empty_side_gives_no_match(shape: tuple[int, int]) -> None:
    result = hamming.mutual_matches(np.zeros(shape, dtype=np.uint8), bits=128)
    assert [len(part) for part in result] == [0, 0, 0, 0]


def test_equals_opencv_cross_check_where_the_nearest_is_unique() -> None:
    rng = np.random.default_rng(6)
    left = rng.integers(0, 256, (300, 16), dtype=np.uint8)
    flips = np.packbits(rng.random((300, 128)) < 0.25, axis=1)
    right = (left ^ flips)[rng.permutation(300)[:250]]
    distance = hamming.distances(left, right)
    rows, columns, best, _ = hamming.mutual_matches(distance, bits=128)

    # Where another is as near, either may be taken.
    rows_tied = (distance == distance.min(axis=1, keepdims=True)).sum(axis=1) > 1
    columns_tied = (distance == distance.min(axis=0)).sum(axis=0) > 1
    ours = set(zip(rows.tolist(), columns.tolist(), best.tolist(), strict=True))
    theirs = {
        (match.queryIdx, match.trainIdx, int(match.distance))
        for match in cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(left, right)
    }
    assert not [(row, column) for row, column, _ in ours ^ theirs if not (rows_tied[row] or columns_tied[column])]
    assert len(ours & theirs) > 200
