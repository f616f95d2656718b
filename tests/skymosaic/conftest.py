"""A rendered flight with known homographies, and a default cache that is no user's."""

from collections.abc import Iterator

import pytest

from sim.scene import Flight, make_lawnmower

IMAGES, SIZE = 9, (480, 360)


@pytest.fixture(scope="session")
def flight() -> Flight:
    return make_lawnmower(seed=5, images=IMAGES, size=SIZE, forward_overlap=0.6, side_overlap=0.4)


@pytest.fixture(scope="session", autouse=True)
def default_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("user_cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skymosaic.running.cache.cache_folder", lambda: folder)
        yield
