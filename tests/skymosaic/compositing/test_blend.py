from typing import Any, get_args

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Array, Pixels
from skymosaic.compositing.blend import Blending, blend_layers
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.warp import TILE_PX, Canvas, enclosing_canvas, shrink

TURNED = np.array([[0.96, 0.17, 90.0], [-0.17, 0.98, 70.0], [1e-5, -2e-5, 1]])


def blend(images: Any, transforms: Any, canvas: Canvas, method: Blending = "distance") -> NDArray[Any]:
    layers = [Layer(*shrink(image, transform)) for image, transform in zip(images, transforms, strict=True)]
    return blend_layers(layers, canvas, method=method)[0]


def shift(x: float, y: float) -> Array:
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def smooth_image(height: int, width: int, *channels: int, seed: int = 0) -> Pixels:
    noise = np.random.default_rng(seed).integers(0, 256, (height, width, *channels), dtype=np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 5), None, 20, 180, cv2.NORM_MINMAX)


def test_average_and_distance_by_hand() -> None:
    # Two flat 5x5 images, 2 columns apart: columns 2 to 4 overlap.
    images = [np.full((5, 5), value, np.uint8) for value in (100, 200)]
    transforms, canvas = [np.eye(3), shift(2, 0)], Canvas(0, 0, 7, 5)
    average = blend(images, transforms, canvas, method="average")
    np.testing.assert_array_equal(average[2], [100, 100, 150, 150, 150, 200, 200])
    # Middle row, distances to the own border: 2, 1, 0 of the left image and 0, 1, 2 of the right one.
    distance = blend(images, transforms, canvas, method="distance")
    np.testing.assert_array_equal(distance[2], [100, 100, 100, 150, 200, 200, 200])
    # One pixel from the top both are at most 1 away: 1, 1, 0 and 0, 1, 1.
    np.testing.assert_array_equal(distance[1], [100, 100, 100, 150, 200, 200, 200])


@pytest.mark.parametrize("method", get_args(Blending))
def test_tiles_leave_no_trace(method: Blending) -> None:
    # Very different images, and a window on the coarsest band's grid that crosses two tiles and the seam.
    images = [smooth_image(700, 1300, seed=1) // 4, smooth_image(700, 1300, seed=2) // 2 + 150]
    transforms = [np.eye(3), TURNED @ shift(600, 300)]
    canvas = enclosing_canvas([(1300, 700)] * 2, transforms)
    window = Canvas(canvas.x_px + TILE_PX - 384, canvas.y_px + 320, 512, 320)
    mosaic, part = (blend(images, transforms, whole, method=method) for whole in (canvas, window))
    assert np.ptp(part) > 100
    assert np.abs(mosaic[window.within(canvas)].astype(int) - part).max() <= 1


def test_a_tile_that_shows_one_photograph_takes_no_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    image = smooth_image(700, 800, 3)
    part = Canvas(250, 250, 200, 120)
    by_bands = blend([image, image[:300, :300]], [np.eye(3)] * 2, part, method="multiband")
    monkeypatch.setattr("skymosaic.compositing.blend._split_bands", lambda _image: pytest.fail("bands"))
    alone = blend([image], [np.eye(3)], part, method="multiband")
    np.testing.assert_array_equal(alone, image[250:370, 250:450])
    np.testing.assert_array_equal(alone, by_bands)


def test_images_off_the_canvas_are_skipped() -> None:
    image = np.full((64, 64), 77, np.uint8)
    for method in get_args(Blending):
        mosaic = blend([image, image], [np.eye(3), shift(500, 0)], Canvas(0, 0, 64, 64), method=method)
        np.testing.assert_array_equal(mosaic, image)
