"""Randomness of the scene's tests, and caches that a test empties to have the landscape painted again."""

import numpy as np
import pytest

from sim.scene import ground, layout


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


def clear_caches() -> None:
    """Forget all painted tiles and planned sections."""
    ground._paint_tile.cache_clear()
    layout._plan_section.cache_clear()
    layout._make_waves.cache_clear()
