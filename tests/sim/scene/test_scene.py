"""Noise of the ground, and its kinds of relief."""

import numpy as np
import pytest

from sim.scene.noise import make_noise
from sim.scene.terrain import SLOPE, TERRACE_PX, TERRAINS, render_terrain


def test_noise_is_a_function_of_position() -> None:
    wide = make_noise(5, -40, 1000, 500, 400)
    inner = make_noise(5, 60, 1057, 111, 77)
    assert np.array_equal(inner, wide[:, 57 : 57 + 77, 100 : 100 + 111])
    assert np.abs(wide[:4].mean(axis=(1, 2))).max() < 0.05
    assert np.all((wide[:6].std(axis=(1, 2)) > 0.6) & (wide[:6].std(axis=(1, 2)) < 1.1))
    neighbours = wide[0][:, 1:] * wide[0][:, :-1]
    assert abs(neighbours.mean()) < 4 / np.sqrt(neighbours.size)


@pytest.mark.parametrize("name", TERRAINS)
def test_land_is_continuous_never_below_the_plane_and_the_same_in_every_part(name: str) -> None:
    whole = render_terrain(name, 1500, 1200, (-700, -300))
    assert whole.min() >= 0
    assert whole.max() > 20
    assert max(np.abs(np.diff(whole, axis=axis)).max() for axis in (0, 1)) < 1
    assert np.array_equal(render_terrain(name, 300, 200, (100, 50)), whole[350:550, 800:1100])


def test_a_terrace_is_level_and_a_slope_rises_by_a_fifth() -> None:
    step = np.abs(np.diff(render_terrain("terraces", 2000, 1, (0, 0))[0]))
    assert np.median(step) == 0
    assert step.sum() > 6 * TERRACE_PX
    rise = np.abs(np.diff(render_terrain("slope", 2800, 1, (0, 0))[0]))
    assert set(np.unique(rise.astype(float).round(2)).tolist()) >= {0.0, SLOPE}
