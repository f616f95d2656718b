"""Tiles seen through homographies in double precision: what the corners of the painter are rounded from."""

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Matrix
from golden_model.painting.corners import CELL_PX, CORNER
from golden_model.painting.tiles import TILE_PX
from tests.golden_model.painting.poses import homography


def pose(size: tuple[int, int], *, zoom: float, turn: float, tilt: float = 0.0, tiles: int = 8) -> Matrix:
    """Canvas of ``tiles`` x ``tiles`` to a frame, middle to middle; ``zoom`` is frame px per canvas px."""
    middle = tiles * TILE_PX / 2
    return homography(size, (middle, middle), zoom=zoom, turn=turn, tilt=(tilt, -tilt / 2))


def project(H: Matrix, points: Array) -> Array:
    """Map points (..., 2)."""
    mapped = points @ H[:, :2].T + H[:, 2]
    return np.asarray(mapped[..., :2] / mapped[..., 2:])


def all_tiles(tiles: int = 8) -> NDArray[np.int64]:
    """Column and row of every tile, (N, 2)."""
    return np.stack(np.meshgrid(np.arange(tiles), np.arange(tiles)), axis=-1).reshape(-1, 2)


def corners(H: Matrix, tile: NDArray[np.int64]) -> NDArray[np.int64]:
    """Corners (N, 3, 3, 2) of the cells of tiles (N, 2), limited to the format."""
    grid = np.stack(np.meshgrid(*[np.arange(0, TILE_PX + 1, CELL_PX)] * 2), axis=-1)
    exact = project(H, tile[:, None, None] * TILE_PX + grid.astype(float))
    return np.clip(np.floor(exact * CORNER.one), CORNER.min_raw, CORNER.max_raw).astype(np.int64)
