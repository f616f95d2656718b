"""Corners lie within a step of double precision, and tiles at the horizon are told apart."""

import numpy as np
from numpy.typing import NDArray

from golden_model.painting.corners import CELL_PX, CORNER, SIDE, project
from golden_model.painting.tiles import MAX_TILES, TILE_PX, touched
from tests.golden_model.painting.poses import homography, in_pixels, pose

SIZE = (1920, 1080)


def see(H: NDArray[np.float64], points: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions in the frame, and depths."""
    mapped = points @ H[:, :2].T + H[:, 2]
    return mapped[..., :2] / mapped[..., 2:], mapped[..., 2]


def test_corners_are_within_a_step_of_double_precision() -> None:
    rng = np.random.default_rng(5)
    count = 0
    for n in range(30):
        tilt = rng.normal(0, (0, 2e-4, 8e-4)[n % 3], 2)
        centre = rng.uniform(0, MAX_TILES * TILE_PX, 2)
        H = homography(SIZE, centre, zoom=2.0 ** rng.uniform(-1, 1), turn=rng.uniform(0, 7), tilt=tilt)
        tiles = touched(pose(H), SIZE, (MAX_TILES, MAX_TILES))
        corners, behind = project(pose(H), tiles)
        grid = np.stack(np.meshgrid(*[np.arange(SIDE) * CELL_PX] * 2), axis=-1)
        points = tiles[:, None, None] * TILE_PX + grid
        exact, w = see(H, points)
        # No tile that is wholly in front is lost, but for corners beyond the format.
        beyond = (np.abs(exact) > CORNER.max_raw / CORNER.one - 1).any(axis=(1, 2, 3))
        np.testing.assert_array_equal(behind & ~beyond, (w <= 0).any(axis=(1, 2)) & ~beyond)
        near = ~behind & (np.abs(exact) < 4096).all(axis=(1, 2, 3))
        count += near.sum()
        step = 1 / CORNER.one
        # Rounded down. The host's rounding of a pose adds as much again.
        for reference, error_px in ((see(in_pixels(pose(H)), points)[0], 0.001), (exact, step)):
            error = (corners * step - reference)[near]
            assert -step - error_px < error.min() < error.max() < error_px
    assert count > 50_000


def test_the_horizon_and_the_format_put_a_tile_behind() -> None:
    """With w = 1 - X / 64 the horizon is at 64 px; at 32 px, 256 X / w is 16,384 px, the format's limit."""
    for factor, wanted in ((257, [True, True, True]), (255, [False, True, True])):
        each = pose(np.array([[factor, 0, 0], [0, 1, 0], [-1 / 64, 0, 1]]))
        corners, behind = project(each, np.array([[0, 0], [1, 0], [2, 0]]))
        assert behind.tolist() == wanted
        assert not corners[behind].any()
    np.testing.assert_allclose(corners[0, 0, :, 0] / CORNER.one, [0, 16 * 255 / 0.75, 32 * 255 / 0.5], atol=0.1)
