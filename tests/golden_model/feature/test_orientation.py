"""Moments equal their definition in real numbers, and sectors equal atan2."""

import math

import numpy as np

from golden_model.feature import orientation
from golden_model.feature.ilbp import ILBP_128


def test_sector_equals_atan2_but_at_its_borders() -> None:
    """The integer tangents differ by up to 0.033 %, so angles within 1e-4 rad of a border may differ."""
    mx, my = np.random.default_rng(3).integers(-8_000_000, 8_000_001, (2, 200_000), dtype=np.int32)
    turn = 16 * np.arctan2(my.astype(float), mx) / (2 * np.pi)
    near_border = np.abs(turn - np.floor(turn) - 0.5) < 1e-4 * 16 / (2 * np.pi)
    agrees = orientation.sector_of(mx, my) == np.round(turn).astype(int) % 16
    assert agrees[~near_border].all()
    assert near_border.mean() < 1e-3


def test_sector_on_axes_and_diagonals() -> None:
    mx = np.array([0, 5, 5, 0, -5, -5, -5, 0, 5])
    my = np.array([0, 0, 5, 5, 5, 0, -5, -5, -5])
    assert orientation.sector_of(mx, my).tolist() == [0, 0, 2, 4, 6, 8, 10, 12, 14]


def test_moments_equal_their_definition_and_fit_24_bits() -> None:
    radii = ILBP_128.radii_px
    rng = np.random.default_rng(4)
    samples = rng.integers(0, 256, (len(radii), 16, 50), dtype=np.uint8)
    mx, my = orientation.moments(samples, radii)
    for n in range(50):
        for moment, wave in ((mx, math.cos), (my, math.sin)):
            expected = sum(
                r * int(samples[ring, a, n]) * round(64 * wave(2 * math.pi * a / 16))
                for ring, r in enumerate(radii)
                for a in range(16)
            )
            assert moment[n] == expected
    bright_half = np.broadcast_to(np.where(np.cos(2 * np.pi * np.arange(16) / 16) > 0, 255, 0), (len(radii), 16))
    extreme, _ = orientation.moments(bright_half[..., np.newaxis].astype(np.uint8), radii)
    assert 0 < extreme[0] < 1 << 23
