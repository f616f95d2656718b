"""A rendered film of a car whose corners are known."""

import numpy as np
import pytest

from sim.scene import Pursuit, make_pursuit
from skymosaic.geometry.homography import apply
from skymosaic.tracking.template import Roi

IMAGES = 36


@pytest.fixture(scope="session")
def film() -> Pursuit:
    return make_pursuit(seed=1, images=IMAGES, size=(480, 360), bridge=True)


@pytest.fixture(scope="session")
def film_frames(film: Pursuit) -> list[np.ndarray]:
    return list(film.images)


@pytest.fixture(scope="session")
def roi(film: Pursuit) -> Roi:
    """The car's bounding box in the first frame."""
    first, last = np.floor(film.corners[0].min(axis=0)), np.ceil(film.corners[0].max(axis=0))
    return Roi(*map(int, first), *map(int, last - first + 1))


def true_corners(film: Pursuit, roi: Roi) -> np.ndarray:
    """Where the rectangle of the first frame moves with the car, (N, 4, 2)."""
    x, y = roi.x_px - 0.5, roi.y_px - 0.5
    outline = np.array([(x, y), (x + roi.width_px, y), (x + roi.width_px, y + roi.height_px), (x, y + roi.height_px)])
    from_first = np.linalg.inv(film.car_to_images[0])
    return np.stack([apply(to_image @ from_first, outline) for to_image in film.car_to_images])
