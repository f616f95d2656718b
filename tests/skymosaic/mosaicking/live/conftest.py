"""The frames of a rendered flight, and how far a live mosaic of them is off."""

import itertools

import numpy as np
import pytest

from golden_model.arrays import Matrix, Pixels
from golden_model.config import preset_config
from sim.scene import Flight
from skymosaic.flight.linking.view import Settings, View, make_view
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.photographs import Source
from tests.skymosaic.conftest import SIZE


@pytest.fixture(scope="session")
def frames(flight: Flight) -> list[np.ndarray]:
    return list(flight.images)


def shift(x: float, y: float) -> Matrix:
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def view_of(pixels: Pixels) -> View:
    """A view of these pixels without a feature."""
    settings = Settings(preset_config("aerial"))
    none = np.zeros(0, settings.config.front_end.pattern.record.dtype)
    photograph, source = Photograph("", pixels), Source(0, "", pixels)
    return make_view(source, photograph, settings, working=pixels, to_original=np.eye(3), features=none)


def pair_errors_px(transforms: dict[int, np.ndarray], flight: Flight, least_overlap: float = 0.2) -> np.ndarray:
    """Mean error of every two frames that overlap, in pixels of the second, over what it shows of the first."""
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 9), np.linspace(0, SIZE[1] - 1, 7)), -1).reshape(-1, 2)
    errors = []
    for left, right in itertools.combinations(sorted(transforms), 2):
        if flight.overlap_between(left, right) >= least_overlap:
            true = apply(flight.homography_between(left, right), grid)
            found = apply(np.linalg.inv(transforms[right]) @ transforms[left], grid)
            common = ((true >= 0) & (true < SIZE)).all(axis=1)
            errors.append(np.linalg.norm(found - true, axis=1)[common].mean())
    return np.array(errors)
