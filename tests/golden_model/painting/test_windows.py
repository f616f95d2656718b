"""Windows hold every pixel that their tiles need, and no tile is skipped that would have changed the canvas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from golden_model.painting.blending import blend
from golden_model.painting.corners import CORNER
from golden_model.painting.positions import POSITION, positions
from golden_model.painting.sampling import sample
from golden_model.painting.windows import WINDOW_PX, are_too_large, are_wide, bounding_boxes, can_win, cut_to_frame
from tests.golden_model.painting import tilted

SIZES = ((64, 48), (153, 101), (640, 480), (1100, 1031))
angles, zooms = st.floats(0, 6.3), st.floats(0.4, 3)


@settings(max_examples=40)
@given(size=st.sampled_from(SIZES), zoom=zooms, turn=angles, tilt=st.sampled_from([0, 3e-4, -8e-4]))
def test_windows_hold_what_tiles_need_and_hardly_more(
    size: tuple[int, int], zoom: float, turn: float, tilt: float
) -> None:
    corners = tilted.corners(tilted.pose(size, zoom=zoom, turn=turn, tilt=tilt), tilted.all_tiles())
    boxes = bounding_boxes(corners)
    cut = cut_to_frame(boxes, *size)
    at = positions(corners)
    _, weights = sample(np.zeros((size[1], size[0], 3), np.uint8), at)
    inside = (weights > 0)[..., None]
    whole = at >> POSITION.fraction_bits
    assert (np.where(inside, whole, cut[:, None, None, :2]) >= cut[:, None, None, :2]).all()
    assert (np.where(inside, whole + 1, cut[:, None, None, 2:]) <= cut[:, None, None, 2:]).all()
    # All around, the box has no more than the step to the next tile's first pixel.
    used = np.concatenate([whole.min(axis=(1, 2)), whole.max(axis=(1, 2)) + 1], axis=1)
    step = np.abs(np.diff(corners, axis=2)).max() / 16 / CORNER.one + np.abs(np.diff(corners, axis=1)).max() / 16 / 256
    assert (np.abs(used - boxes) <= step + 1).all()


def box(left: int, top: int, right: int, bottom: int) -> np.ndarray:
    """The box of a tile with two corners at the given pixels, and the others between."""
    corners = np.empty((1, 3, 3, 2), np.int64)
    corners[:] = CORNER.one * np.array([(left + right - 1) // 2, (top + bottom - 1) // 2])
    corners[0, 0, 2] = np.array([left, bottom - 1]) * CORNER.one
    corners[0, 1, 0] = np.array([right - 1, top]) * CORNER.one
    return bounding_boxes(corners)


def test_limits_of_boxes_and_windows() -> None:
    corners = np.zeros((1, 3, 3, 2), np.int64)
    corners[0, 2, 2] = 10 * CORNER.one - 3, 10 * CORNER.one - 2
    assert bounding_boxes(corners).tolist() == [[0, 0, 10, 11]]
    for large, right, bottom in ((False, 227, 327), (True, 228, 327), (True, 227, 328)):
        boxes = box(100, 200, right, bottom)
        assert boxes.tolist() == [[100, 200, right, bottom]]
        assert are_too_large(boxes) == [large]
    assert WINDOW_PX == 128
    for wide, left, right in ((False, 80, 143), (True, 80, 144), (False, -40, 63), (True, -40, 64), (False, 90, 200)):
        boxes = cut_to_frame(box(left, 0, right, 100), 150, 100)
        assert are_wide(boxes) == [wide]


@pytest.mark.parametrize(("turn", "zoom"), [(0, 3.93), (np.pi / 4, 2.77)])
def test_windows_suffice_up_to_the_zoom_that_is_documented(turn: float, zoom: float) -> None:
    for factor, some in ((1, False), (1.05, True)):
        H = tilted.pose((640, 480), zoom=zoom * factor, turn=turn)
        assert are_too_large(bounding_boxes(tilted.corners(H, tilted.all_tiles()))).any() == some


def test_limited_corners_are_too_large_even_where_the_rest_is_inside_the_frame() -> None:
    corners = np.full((1, 3, 3, 2), 20 * CORNER.one)
    corners[0, 2, :, 0] = CORNER.max_raw
    assert are_too_large(bounding_boxes(corners)).all()


@pytest.mark.parametrize("size", SIZES)
def test_tiles_that_cannot_win_are_those_that_painting_would_not_change(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(size)
    skipped = needed = 0
    for zoom, turn in ((0.6, 0.1), (1.0, 2.5), (1.3, 4.0), (0.45, 5.5)):
        H = tilted.pose(size, zoom=zoom * max(1, size[0] / 400), turn=turn)
        corners = tilted.corners(H, tilted.all_tiles())
        colours, weights = sample(np.full((size[1], size[0], 3), 255, np.uint8), positions(corners))
        most = weights.max(axis=(1, 2))
        # Just what decides: smallest weights around the largest that the tile has in the frame.
        for offset in range(6, 12):
            least = np.clip(most + offset, 0, 255) * (rng.random(len(most)) < 0.9)
            old = np.zeros((*weights.shape, 4), np.uint8)
            old[..., 3] = least[:, None, None]
            changes = (blend(old, colours, weights) != old).any(axis=(1, 2, 3))
            wins = can_win(bounding_boxes(corners), *size, least)
            assert not (changes & ~wins).any()
            skipped += int((~wins).sum())
            needed += int(changes.sum())
    assert skipped > needed / 4
    assert needed > 100


def test_what_cannot_win_and_what_just_does() -> None:
    for left, right, wins in ((-60, 0, False), (-60, 1, True), (62, 120, True), (63, 120, False)):
        assert can_win(box(left, 10, right, 40), 64, 48, np.zeros(1, int)) == [wins]
        assert can_win(box(10, left, 40, right), 48, 64, np.zeros(1, int)) == [wins]
    # One pixel from the border of a frame with 1031 lines: distance 1, shifted by 2 and still weight 1.
    boxes = box(-50, 500, 1, 520)
    assert can_win(boxes, 1100, 1031, np.array([8])) == [True]
    assert can_win(boxes, 1100, 1031, np.array([9])) == [False]
