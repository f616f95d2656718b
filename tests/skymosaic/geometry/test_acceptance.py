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
    # A column, and a row: neither coordinate alone tells places apart.
    line = np.column_stack([np.full(5, 8.0), np.arange(5) * 4.0])
    assert acceptance.count_places(line, line) == acceptance.count_places(line[:, ::-1], line) == 5


def test_the_overlap_of_a_shift_is_the_common_half() -> None:
    assert acceptance.hull_area(acceptance.overlap(SHIFT, SIZE, SIZE)) == pytest.approx(320 * 480)
    assert acceptance.hull_area(acceptance.overlap(np.eye(3), SIZE, SIZE)) == pytest.approx(640 * 480)


@pytest.mark.parametrize(
    "homography",
    [
        np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]]),
        np.array([[1e9, 0, 0], [0, 1e9, 0], [0, 0, 1]]),
    ],
    ids=["no overlap", "magnified beyond measure"],
)
def test_without_an_overlap_nothing_is_spread(homography: NDArray[np.float64]) -> None:
    assert len(acceptance.overlap(homography, SIZE, SIZE)) == 0
    points = np.array([[0.0, 0], [600, 0], [600, 400]])
    assert acceptance.hull_share(homography, points, SIZE, SIZE) == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_the_overlap_ends_at_the_horizon_of_either_image(sign: int) -> None:
    tilted = np.array([[1.0, 0, 0], [0, 1, 0], [0.002, -0.004, 1]]) @ SHIFT
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    for homography in (tilted, np.linalg.inv(tilted)):
        u, v, w = np.moveaxis(np.stack((x, y, np.ones_like(x)), axis=-1) @ homography.T, -1, 0)
        assert w.min() < 0 < w.max()
        low, high = -0.5 * w, (np.array(SIZE) - 0.5)[:, None, None] * w
        # Beyond the horizon, where w < 0, pixels come from behind the camera.
        shown = (w > 0) & (u >= low) & (v >= low) & (u <= high[0]) & (v <= high[1])
        mask = acceptance.overlap_mask(sign * homography, SIZE, SIZE)
        assert 1000 < np.count_nonzero(shown) == pytest.approx(np.count_nonzero(mask), rel=0.02)
        assert np.count_nonzero(shown != (mask == 255)) < 0.02 * np.count_nonzero(shown)
        area = acceptance.hull_area(acceptance.overlap(sign * homography, SIZE, SIZE))
        assert area == pytest.approx(np.count_nonzero(shown), rel=0.02)


def square(side_px: int, corner: tuple[float, float] = (330.0, 10.0)) -> NDArray[np.float64]:
    return np.array([[0.0, 0], [side_px, 0], [side_px, side_px], [0, side_px]]) + corner


@pytest.mark.parametrize(("height_px", "enough"), [(119, False), (120, True)])
def test_inliers_must_cover_a_tenth_of_the_overlap(height_px: int, enough: bool) -> None:
    left = square(128) * (1, height_px / 128)
    assert acceptance.spread_enough(SHIFT, left, left - [320, 0], SIZE, SIZE) is enough
    assert acceptance.hull_area(left[:3]) == 128 * height_px / 2
    assert acceptance.hull_share(SHIFT, 9 * left, SIZE, SIZE) == 1


def test_eight_percent_of_the_smaller_image_also_suffice() -> None:
    """A small photograph inside a large one: its own pixels count."""
    small, enlarge = (100, 100), np.diag([4.0, 4.0, 1.0])
    left = square(20, (0.0, 0.0)) * (2, 1)
    right = 4 * left
    assert acceptance.hull_share(enlarge, left, small, SIZE) < acceptance.MIN_SHARE_OF_OVERLAP
    assert acceptance.spread_enough(enlarge, left, right, small, SIZE)
    assert not acceptance.spread_enough(enlarge, left * (0.99, 1), right * (0.99, 1), small, SIZE)
    assert acceptance.spread_enough(np.linalg.inv(enlarge), right, left, SIZE, small)
