"""A rendered flight, as pictures in memory and as files in a folder; the panel, and a browser."""

from pathlib import Path

import cv2
import pytest

from sim.scene import Flight, make_lawnmower
from tests.skymosaic.panel.conftest import browser, panel

__all__ = ["browser", "panel"]

IMAGES, SIZE = 9, (480, 360)


@pytest.fixture(scope="session")
def flight() -> Flight:
    return make_lawnmower(seed=5, images=IMAGES, size=SIZE, forward_overlap=0.6, side_overlap=0.4)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    for index, image in enumerate(flight.images):
        cv2.imwrite(str(folder / f"{index}.png"), image)
    return folder
