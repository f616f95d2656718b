"""Orientations equal their definition in real numbers, and sub-pixel positions exact fractions."""

import math
from fractions import Fraction
from math import floor
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from golden_model.feature import orientation
from golden_model.feature.ilbp import ILBP_128
from golden_model.feature.subpixel import refine, vertex
from golden_model.formats import encode_response


def test_sector_equals_atan2_but_at_its_borders_and_on_the_axes() -> None:
    """The integer tangents differ by up to 0.033 %, so angles within 1e-4 rad of a border may differ."""
    mx, my = np.random.default_rng(3).integers(-8_000_000, 8_000_001, (2, 200_000), dtype=np.int32)
    turn = 16 * np.arctan2(my.astype(float), mx) / (2 * np.pi)
    near_border = np.abs(turn - np.floor(turn) - 0.5) < 1e-4 * 16 / (2 * np.pi)
    agrees = orientation.sector_of(mx, my) == np.round(turn).astype(int) % 16
    assert agrees[~near_border].all()
    assert near_border.mean() < 1e-3
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


def exact_vertex(before: int, centre: int, after: int) -> int:
    u, v = centre - after, centre - before
    if u + v == 0:
        return 0
    offset = 16 * Fraction(abs(v - u), 2 * (u + v))
    return (1 if v > u else -1) * floor(offset + Fraction(1, 2)) if v != u else 0


triples = st.tuples(*[st.integers(0, 2**30 - 1)] * 3) | st.tuples(*[st.integers(0, 40)] * 3)


@given(st.lists(triples, min_size=1))
@example([(20, 35, 18), (18, 35, 20)])  # halves, either way
def test_vertex_is_the_exact_parabola_rounded(triples: Any) -> None:
    before, centre, after = (np.array(values, np.int32) for values in zip(*triples, strict=True))
    centre = np.maximum(centre, np.maximum(before, after))
    expected = [exact_vertex(*map(int, triple)) for triple in zip(before, centre, after, strict=True)]
    offset = vertex(before, centre, after)
    assert offset.tolist() == expected
    assert np.abs(offset).max() <= 8


@given(code=arrays(np.uint16, (9, 9), elements=st.integers(1, 15_000)), level=st.integers(0, 1))
def test_axes_are_separate_and_use_decoded_responses(code: Any, level: int) -> None:
    code[4, 4] = 15_000
    fine_x, fine_y = refine(code, np.array([4]), np.array([4]), level)
    flipped_y, flipped_x = refine(np.ascontiguousarray(code.T), np.array([4]), np.array([4]), level)
    assert (fine_x, fine_y) == (flipped_x, flipped_y)
    mirrored_x, _ = refine(np.ascontiguousarray(code[:, ::-1]), np.array([4]), np.array([4]), level)
    assert fine_x.astype(int) + mirrored_x == 2 * (4 * 16 if level == 0 else 2 * 4 * 16 + 8)


def test_offsets_come_from_values_not_from_codes() -> None:
    # Values 4096, 8192, 7168: u = 1024, v = 4096, q = (16 * 3072 + 5120) // 10240 = 5. Codes would give 6.
    code = np.zeros((3, 3), np.uint16)
    code[1] = encode_response(np.array([4096, 8192, 7168]))
    assert refine(code, np.array([1]), np.array([1]), 0)[0] == 16 + 5


@pytest.mark.parametrize("level", [0, 1])
def test_levels_share_one_frame_of_reference(level: int) -> None:
    # The half-size pixel 10 covers the full-size pixels 20 and 21: its centre is at 20.5.
    code = np.zeros((30, 30), np.uint16)
    code[12, 10] = 9000
    fine_x, fine_y = refine(code, np.array([10]), np.array([12]), level)
    assert (fine_x[0] / 16, fine_y[0] / 16) == ((10, 12) if level == 0 else (20.5, 24.5))
