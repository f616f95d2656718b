import cv2
import numpy as np
import pytest

from skymosaic.compositing.blend import blend
from skymosaic.compositing.exposure import exposure_gains
from skymosaic.compositing.warp import canvas_of


def shift(x, y):
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def smooth_image(height, width, *channels, seed=0):
    noise = np.random.default_rng(seed).integers(0, 256, (height, width, *channels), dtype=np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 5), None, 20, 180, cv2.NORM_MINMAX)


def two_views(*channels):
    """Two crops of one scene, 60 px apart, with the canvas that holds both: the scene itself."""
    scene = smooth_image(120, 260, *channels)
    images, transforms = [scene[:, :200], scene[:, 60:]], [np.eye(3), shift(60, 0)]
    return scene, images, transforms, canvas_of([(200, 120), (200, 120)], transforms)


def test_gains_equalise_the_overlap():
    scene, images, transforms, canvas = two_views(3)
    darker = (images[1] * 0.7).astype(np.uint8)
    gains = exposure_gains([images[0], darker], transforms, canvas)
    assert gains[1] / gains[0] == pytest.approx(1 / 0.7, rel=0.03)
    assert gains[0] < 1 < gains[1]
    mosaic = blend([images[0], darker], transforms, canvas, gains=gains)
    np.testing.assert_allclose(mosaic / mosaic.mean(), scene / scene.mean(), rtol=0.07)


def test_gains_of_equal_and_of_separate_images_are_one():
    _, images, transforms, canvas = two_views()
    np.testing.assert_allclose(exposure_gains(images, transforms, canvas), 1, atol=1e-6)
    apart = [np.eye(3), shift(500, 0)]
    bright_and_dark = [np.full((64, 64), value, np.uint8) for value in (40, 200)]
    np.testing.assert_allclose(exposure_gains(bright_and_dark, apart, canvas_of([(64, 64)] * 2, apart)), 1)


def test_gains_come_from_a_reduced_canvas():
    rng = np.random.default_rng(3)
    scene = cv2.resize(rng.integers(60, 160, (40, 100), dtype=np.uint8), (5000, 2000), interpolation=cv2.INTER_LINEAR)
    images, transforms = [scene[:, :3500], (scene[:, 1500:] * 0.8).astype(np.uint8)], [np.eye(3), shift(1500, 0)]
    canvas = canvas_of([(3500, 2000)] * 2, transforms)
    gains = exposure_gains(images, transforms, canvas)
    assert gains[1] / gains[0] == pytest.approx(1.25, rel=0.02)
