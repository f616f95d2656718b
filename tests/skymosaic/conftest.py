"""A rendered flight with known homographies."""

import pytest

from sim.scene import Flight, make_lawnmower

IMAGES, SIZE = 9, (480, 360)


@pytest.fixture(scope="session")
def flight() -> Flight:
    return make_lawnmower(seed=5, images=IMAGES, size=SIZE, forward_overlap=0.6, side_overlap=0.4)
