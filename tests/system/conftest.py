"""A rendered flight, as pictures in memory and as files in a folder; the panel, and a browser."""

from pathlib import Path

import cv2
import pytest

from sim.scene import Flight
from skymosaic import Mosaic, mosaic
from tests.skymosaic.conftest import IMAGES, SIZE, default_cache, flight, surveyed
from tests.skymosaic.flight.picture.conftest import band_folder
from tests.skymosaic.panel.conftest import browser, kept, opened, owner_address, panel, root, silent_board
from tests.skymosaic.tracking.conftest import film, roi

__all__ = [
    "IMAGES",
    "SIZE",
    "band_folder",
    "browser",
    "default_cache",
    "film",
    "flight",
    "kept",
    "opened",
    "owner_address",
    "panel",
    "roi",
    "root",
    "silent_board",
    "surveyed",
]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    for index, image in enumerate(flight.images):
        cv2.imwrite(str(folder / f"{index}.png"), image)
    return folder


@pytest.fixture(scope="session")
def whole(folder: Path, surveyed: Path) -> Mosaic:
    return mosaic([folder], cache=surveyed)
