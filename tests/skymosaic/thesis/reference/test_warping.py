from typing import Any

import cv2
import numpy as np
import pytest

from skymosaic.compositing.warp import Canvas, footprint, warp_backward
from tests.skymosaic.thesis.reference.warping import project_to_cylinder, warp_forward


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "bgr"])
def test_forward_whole_pixel_shift_is_exact(channels: tuple[Any, ...]) -> None:
    image = np.random.default_rng(0).integers(0, 256, (40, 60, *channels), dtype=np.uint8)
    shift = np.array([[1.0, 0, 7], [0, 1, -5], [0, 0, 1]])
    warped = warp_forward(image, shift, Canvas(0, -10, 80, 60))
    expected = np.zeros((60, 80, *channels), dtype=np.uint8)
    expected[5:45, 7:67] = image
    np.testing.assert_array_equal(warped, expected)


def test_forward_leaves_holes_where_it_enlarges_and_backward_none() -> None:
    image = np.full((20, 20), 9, np.uint8)
    zoom, canvas = np.diag([2.0, 2, 1]), Canvas(0, 0, 39, 39)
    warped = warp_forward(image, zoom, canvas)
    assert (warped[::2, ::2] == 9).all()
    assert np.count_nonzero(warped) == 400
    assert (warp_backward(image, zoom, canvas) == 9).all()


def test_forward_agrees_with_backward_on_a_smooth_image() -> None:
    # The nearest pixel is at most half a pixel off along x and y, turned here; the ramp rises by 1 along both.
    ramp = np.add.outer(np.arange(100), np.arange(120)).astype(np.uint8)
    turn = np.array([[0.8, -0.6, 60], [0.6, 0.8, 0], [0, 0, 1]])
    canvas = footprint((120, 100), turn)
    there, back = warp_forward(ramp, turn, canvas), warp_backward(ramp, turn, canvas, border=cv2.BORDER_REPLICATE)
    hit = there > 0
    assert hit.sum() > 0.9 * ramp.size
    assert np.abs(there[hit].astype(int) - back[hit]).max() <= 2


def test_cylinder_turns_a_pan_into_a_shift() -> None:
    # A dot seen under 0.2 rad lands f * 0.2 px beside the centre, at its elevation's tangent times f.
    focal_px = 500.0
    image = np.zeros((201, 601), dtype=np.uint8)
    x, y = 300 + focal_px * np.tan(0.2), 100 + 50 / np.cos(0.2)
    cv2.circle(image, (round(x * 16), round(y * 16)), 6 * 16, 255, -1, cv2.LINE_AA, 4)
    warped = project_to_cylinder(image, focal_px)
    assert warped.shape == (201, 2 * int(focal_px * np.arctan(0.6)) + 1)
    rows, columns = np.nonzero(warped > 127)
    assert columns.mean() - (warped.shape[1] - 1) / 2 == pytest.approx(100, abs=0.3)
    assert rows.mean() == pytest.approx(150, abs=0.3)


def test_cylinder_of_a_long_lens_is_the_plane() -> None:
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (60, 80), dtype=np.uint8), (0, 0), 4)
    warped = project_to_cylinder(image, 1e6)
    # The arc of 79 px spans 78 whole ones: an even number about the centre.
    assert warped.shape == (60, 79)
    middle = (image[:, :-1].astype(float) + image[:, 1:]) / 2
    np.testing.assert_allclose(warped, middle, atol=0.6)
