"""Views of one rendered ground for the tests of registration."""

import numpy as np

from golden_model.arrays import Pixels
from sim.scene import Camera, CameraPose, Photometry, render_ground, render_view
from sim.scene.camera import find_visible_box

CAMERA = Camera(width_px=480, height_px=360, focal_px=384)


def view(pose: CameraPose, seed: int) -> Pixels:
    """What the camera sees, in gray; ``seed`` is that of the noise."""
    left, top, width, height = find_visible_box(pose, CAMERA)
    ground = render_ground(1, width, height, (left, top))
    photometry = Photometry(blur_sigma_px=0.4, noise_sigma=1.5)
    image = render_view(ground, pose, CAMERA, photometry, np.random.default_rng(seed), origin=(left, top))
    return image[..., 1].copy()
