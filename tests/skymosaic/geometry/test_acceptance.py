import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.geometry import acceptance

SIZE = (640, 480)
SHIFT = np.array([[1.0, 0, -320], [0, 1, 0], [0, 0, 1]])


def test_matches_at_one_place_count_once() -> None:
    points = np.array([[10.0, 10], [10.5, 10.2], [100, 100], [101, 101]])
    assert acceptance.count_places(points, points) == 2
    assert acceptance.count_places(points, np.full((4, 2), 50.0)) == 1
    assert acceptance.count_places(points[:0], points[:0]) == 0


def test_the_overlap_of_a_shift_is_the_common_half() -> None:
    assert acceptance.hull_area(acceptance.overlap(SHIFT, SIZE, SIZE)) == pytest.approx(320 * 480)
    assert acceptance.hull_area(acceptance.overlap(np.eye(3), SIZE, SIZE)) == pytest.approx(640 * 480)


@pytest.mark.parametrize(
    "homography",
    [
        np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]]),
        np.array([[1.0, 0, 0], [0, 1, 0], [-0.01, 0, 1]]),
        np.array([[1e9, 0, 0], [0, 1e9, 0], [0, 0, 1]]),
    ],
    ids=["no overlap", "over the horizon", "magnified beyond measure"],
)
def test_without_an_overlap_nothing_is_spread(homography: NDArray[np.float64]) -> None:
    assert len(acceptance.overlap(homography, SIZE, SIZE)) == 0
    points = np.array([[0.0, 0], [600, 0], [600, 400]])
    assert acceptance.hull_share(homography, points, SIZE, SIZE) == 0


def square(side_px: int, corner: tuple[float, float] = (330.0, 10.0)) -> NDArray[np.float64]:
    return np.array([[0.0, 0], [side_px, 0], [side_px, side_px], [0, side_px]]) + corner


@pytest.mark.parametrize(("side_px", "enough"), [(115, False), (130, True)])
def test_inliers_must_cover_a_tenth_of_the_overlap(side_px: int, enough: bool) -> None:
    left = square(side_px)
    assert acceptance.spread_enough(SHIFT, left, left - [320, 0], SIZE, SIZE) is enough


def test_eight_percent_of_the_smaller_image_also_suffice() -> None:
    """A small photograph inside a large one: its own pixels count."""
    small, enlarge = (100, 100), np.diag([4.0, 4.0, 1.0])
    left, right = square(29, (10.0, 10.0)), 4 * square(29, (10.0, 10.0))
    assert acceptance.hull_share(enlarge, left, small, SIZE) < acceptance.MIN_SHARE_OF_OVERLAP
    assert acceptance.spread_enough(enlarge, left, right, small, SIZE)
    assert not acceptance.spread_enough(enlarge, left / 4, right / 4, small, SIZE)
