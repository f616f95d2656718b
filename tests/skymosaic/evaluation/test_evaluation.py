"""Lists of known pairs, and measures worked by hand."""

from pathlib import Path

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.evaluation.known_pairs import COLUMNS, read_pairs
from skymosaic.evaluation.metrics import (
    MISSING_ERROR_PX,
    Confusion,
    confusion,
    correct_matches,
    grid_error,
    repeatability,
    rmse,
)

HEADER = ",".join(COLUMNS)
LINE = "real_copr_0_1,real,a.jpg,b.jpg,1,0,5,0,1,-3,0,0,1"


def test_a_pair_is_read_with_its_files_and_homography(tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text(f"{HEADER}\n{LINE}\n")
    (pair,) = read_pairs(tmp_path)
    assert (pair.name, pair.group) == ("real_copr_0_1", "real")
    assert (pair.left, pair.right) == (tmp_path / "a.jpg", tmp_path / "b.jpg")
    np.testing.assert_array_equal(pair.truth, [[1, 0, 5], [0, 1, -3], [0, 0, 1]])


@pytest.mark.parametrize(("text", "words"), [
    (HEADER.replace("h11", "x"), "lacks h11"),
    (HEADER, "lists no pair"),
    (f"{HEADER}\n{LINE.replace(',5,', ',five,')}", "line 2: h00 to h22 must be nine numbers"),
    (f"{HEADER}\n{LINE.removesuffix(',1')}", "line 2: h00 to h22 must be nine numbers"),
])  # fmt: skip
def test_a_wrong_list_is_named(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "pairs.csv").write_text(text + "\n")
    with pytest.raises(InputError, match=words):
        read_pairs(tmp_path)


SHIFT = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])


def test_confusion_counts_each_case() -> None:
    counts = confusion([1, 1, 1, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 1, 1])
    assert counts == Confusion(true_positives=2, false_positives=1, true_negatives=3, false_negatives=2)
    assert counts.recall == pytest.approx(2 / 4)
    assert counts.precision == pytest.approx(2 / 3)


def test_correct_matches_are_within_the_tolerance() -> None:
    right = [(10, 3), (10, 3.01), (13, 0), (0, 0)]
    np.testing.assert_array_equal(correct_matches(np.zeros((4, 2)), right, SHIFT), [True, False, True, False])


def test_rmse_by_hand() -> None:
    assert rmse(SHIFT, [(0, 0), (5, 5)], [(13, 4), (15, 5)]) == pytest.approx(np.sqrt(25 / 2))


def test_repeatability_counts_each_feature_once_and_only_the_overlap() -> None:
    # Right image 100x100. Found; found but its only partner is taken by a nearer one; missed; outside.
    left = [(20, 20), (20, 21), (60, 60), (95, 50)]
    right = [(30, 20.2), (10, 90)]
    assert repeatability(left, right, SHIFT, (100, 100)) == pytest.approx(1 / 3)


def test_repeatability_without_features_is_zero() -> None:
    assert repeatability(np.zeros((0, 2)), [(1, 1)], SHIFT, (100, 100)) == 0
    assert repeatability([(1, 1)], np.zeros((0, 2)), SHIFT, (100, 100)) == 0
    assert repeatability([(95, 5)], [(1, 1)], SHIFT, (100, 100)) == 0


def test_grid_error_of_a_wrong_shift_is_the_difference() -> None:
    wrong = SHIFT + np.array([[0, 0, 3], [0, 0, -4], [0, 0, 0]])
    assert grid_error(wrong, SHIFT, (640, 480), (640, 480)) == pytest.approx(5)
    assert grid_error(SHIFT, SHIFT, (640, 480), (640, 480)) == 0


def test_grid_error_counts_only_the_overlap() -> None:
    # Half the left image maps into the right one. The error is |x| / 100 there: the grid's right half counts.
    left_of_it = np.array([[1.0, 0, -50], [0, 1, 0], [0, 0, 1]])
    zoomed = left_of_it + np.array([[0.01, 0, 0], [0, 0, 0], [0, 0, 0]])
    columns = np.linspace(0, 99, 20)
    expected = columns[columns >= 50].mean() / 100
    assert grid_error(zoomed, left_of_it, (100, 80), (100, 80)) == pytest.approx(expected)


def test_grid_error_ends_at_the_horizon() -> None:
    # Left columns from 80 on show ground of the right image. Formally, so do the first 19, from behind the camera.
    truth = np.array([[1.0, 0, -80], [0.8, 0.2, -40], [0.02, 0, -1]])
    wider = np.diag([1.01, 1, 1]) @ truth
    columns = np.linspace(0, 99, 20)
    ground = columns[columns >= 80]
    assert grid_error(wider, truth, (100, 80), (100, 80)) == pytest.approx(
        0.01 * ((ground - 80) / (0.02 * ground - 1)).mean()
    )


def test_grid_error_of_nothing_and_without_overlap() -> None:
    assert grid_error(None, SHIFT, (64, 64), (64, 64)) == MISSING_ERROR_PX
    to_infinity = np.array([[1.0, 0, 0], [0, 1, 0], [-1 / 63, 0, 1]])
    assert grid_error(to_infinity, np.eye(3), (64, 64), (64, 64)) == MISSING_ERROR_PX
    far = np.array([[1.0, 0, 1000], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(ValueError, match="do not overlap"):
        grid_error(np.eye(3), far, (64, 64), (64, 64))
