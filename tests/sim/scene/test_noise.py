"""Noise of the landscape: a function of seed and position."""

import numpy as np

from sim.scene.noise import make_noise


def test_noise_is_a_function_of_position() -> None:
    wide = make_noise(5, -40, 1000, 500, 400)
    inner = make_noise(5, 60, 1057, 111, 77)
    assert np.array_equal(inner, wide[:, 57 : 57 + 77, 100 : 100 + 111])
    assert np.abs(wide[:4].mean(axis=(1, 2))).max() < 0.05
    assert np.all((wide[:6].std(axis=(1, 2)) > 0.6) & (wide[:6].std(axis=(1, 2)) < 1.1))
    neighbours = wide[0][:, 1:] * wide[0][:, :-1]
    assert abs(neighbours.mean()) < 4 / np.sqrt(neighbours.size)
