"""Blocks that are found in another picture."""

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.scene import render_ground
from skymosaic.tracking.blocks import BORDER_PX, match_blocks

SIDE_PX, SHIFT_PX = 200, (20, -12)


@pytest.fixture(scope="module")
def ground() -> Pixels:
    return render_ground(5, SIDE_PX + 100, SIDE_PX + 100)


def cut(ground: Pixels, x: int, y: int) -> Pixels:
    return ground[y : y + SIDE_PX, x : x + SIDE_PX]


MIDDLES = np.stack(np.meshgrid(*2 * [np.arange(BORDER_PX, SIDE_PX - BORDER_PX, 8.0)]), axis=-1).reshape(-1, 2)


def test_blocks_are_found_where_they_went_in_other_light(ground: Pixels) -> None:
    x, y = 50 - SHIFT_PX[0], 50 - SHIFT_PX[1]
    before, now = match_blocks(cut(ground, 50, 50), (0.6 * cut(ground, x, y) + 30).astype(np.uint8), MIDDLES)
    assert len(before) > 0.9 * len(MIDDLES)
    np.testing.assert_allclose(now - before, np.broadcast_to(SHIFT_PX, now.shape), atol=2)
    # Their middles lie between pixels of the reduced picture, so a pixel of this one beside an even place.
    off_px = (before[:, None] - MIDDLES).reshape(-1, 2)
    assert {-1} == set(off_px[np.abs(off_px).max(axis=1) < 4].ravel())


def test_other_ground_and_flat_blocks_are_not_found(ground: Pixels) -> None:
    before, _ = match_blocks(cut(ground, 0, 0), cut(render_ground(8, SIDE_PX, SIDE_PX), 0, 0), MIDDLES)
    assert len(before) < len(MIDDLES) / 2
    flat = cv2.rectangle(cut(ground, 0, 0).copy(), (0, 0), (SIDE_PX, SIDE_PX // 2), (90, 90, 90), cv2.FILLED)
    before, _ = match_blocks(flat, flat, MIDDLES)
    assert before[:, 1].min() > SIDE_PX // 2 - 8
