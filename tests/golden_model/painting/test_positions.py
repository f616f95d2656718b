"""Positions equal bilinear interpolation in exact fractions, and come near the homography that they replace."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from golden_model.painting.corners import CELL_PX, CORNER
from golden_model.painting.positions import POSITION, positions
from golden_model.painting.tiles import TILE_PX
from tests.golden_model.painting import tilted

places = arrays(np.int64, (1, 3, 3, 2), elements=st.integers(CORNER.min_raw, CORNER.max_raw))


@given(corners=places, x=st.integers(0, TILE_PX - 1), y=st.integers(0, TILE_PX - 1), axis=st.integers(0, 1))
def test_positions_are_bilinear_between_the_corners_and_rounded_once(
    corners: np.ndarray, x: int, y: int, axis: int
) -> None:
    (column, right), (row, down) = divmod(x, CELL_PX), divmod(y, CELL_PX)
    (a, b), (c, d) = corners[0, row : row + 2, column : column + 2, axis].tolist()
    across, along = Fraction(right, CELL_PX), Fraction(down, CELL_PX)
    exact = (a * (1 - across) + b * across) * (1 - along) + (c * (1 - across) + d * across) * along
    nearest = exact * POSITION.one / CORNER.one
    assert abs(positions(corners)[0, y, x, axis] - nearest) <= Fraction(1, 2)


@pytest.mark.parametrize(("tilt", "worst_px"), [(0.0, 0.015), (2e-4, 0.1), (8e-4, 1.2)])
@pytest.mark.parametrize("zoom", [0.5, 1.0, 1.9])
def test_positions_are_near_those_of_the_homography(zoom: float, tilt: float, worst_px: float) -> None:
    for turn in (0.0, 0.4, 2.0, 3.9):
        H = tilted.pose((640, 480), zoom=zoom, turn=turn, tilt=tilt)
        tile = tilted.all_tiles()
        exact = tilted.pixels(H, tile)
        inside = ((exact > 0) & (exact < (640, 480))).all(axis=-1)
        error = positions(tilted.corners(H, tile)) / POSITION.one - exact
        assert np.abs(error[inside]).max() < worst_px
