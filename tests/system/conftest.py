"""A rendered flight, as pictures in memory and as files in a folder; the panel, and a browser."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from golden_model.arrays import Array
from sim.scene import Flight
from skymosaic import Mosaic, mosaic
from skymosaic.geometry.homography import apply, estimate_similarity
from tests.made import write_pictures
from tests.skymosaic.conftest import IMAGES, SIZE, default_cache, flight, surveyed
from tests.skymosaic.flight.picture.conftest import band_folder
from tests.skymosaic.panel.conftest import browser, kept, opened, owner_address, panel, root, silent_board
from tests.skymosaic.tracking.conftest import film, roi

__all__ = [
    "IMAGES", "SIZE", "band_folder", "browser", "default_cache", "film", "flight", "kept", "opened", "owner_address",
    "panel", "roi", "root", "silent_board", "surveyed",
]  # fmt: skip


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    write_pictures(folder, flight.images)
    return folder


@pytest.fixture(scope="session")
def whole(folder: Path, surveyed: Path) -> Mosaic:
    return mosaic([folder], cache=surveyed)


def position_errors_px(transforms: Mapping[int, Array], flight: Flight) -> Array:
    """Mean error of each image on the ground after the best similarity alignment of all."""
    sides = (np.linspace(0, side - 1, 4) for side in flight.images[0].shape[1::-1])
    grid = np.stack(np.meshgrid(*sides), -1).reshape(-1, 2)
    found = np.array([apply(transforms[index], grid) for index in sorted(transforms)])
    inverse = [np.asarray(np.linalg.inv(flight.homographies[index]), np.float64) for index in sorted(transforms)]
    true = np.array([apply(each, grid) for each in inverse])
    alignment = estimate_similarity(found.reshape(-1, 2), true.reshape(-1, 2))
    return np.asarray(np.linalg.norm(apply(alignment, found) - true, axis=-1).mean(axis=1))
