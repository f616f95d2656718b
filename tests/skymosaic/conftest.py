"""A rendered flight with known homographies, what was found out about it, and a default cache that is no user's."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import pytest

from golden_model.arrays import Pixels
from sim.scene import Flight, make_lawnmower

IMAGES, SIZE = 9, (480, 360)


class Kept(Flight):
    """A flight whose pictures are rendered once; they cannot be changed."""

    @cached_property
    def images(self) -> list[Pixels]:
        rendered = list(super().images)
        for image in rendered:
            image.flags.writeable = False
        return rendered


@pytest.fixture(scope="session")
def flight() -> Flight:
    made = make_lawnmower(seed=5, images=IMAGES, size=SIZE, forward_overlap=0.6, side_overlap=0.4)
    return Kept(**vars(made))


@pytest.fixture(scope="session")
def surveyed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache: who has it surveys no photograph of the flight again, whatever its name."""
    return tmp_path_factory.mktemp("surveyed")


@pytest.fixture(scope="session", autouse=True)
def default_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("user_cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skymosaic.running.cache.cache_folder", lambda: folder)
        yield
