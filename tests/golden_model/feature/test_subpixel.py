"""Sub-pixel positions equal exact fractions, a parabola in floating point, and the geometry of the levels."""

from fractions import Fraction
from math import floor
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from golden_model.feature.subpixel import refine, vertex
from golden_model.formats import encode_response


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


@given(st.floats(-0.5, 0.5), st.integers(10_000, 1 << 28))
def test_vertex_finds_the_top_of_a_parabola(top: Any, height: Any) -> None:
    samples = np.rint(height * (1 - 0.3 * (np.array([-1, 0, 1]) - top) ** 2)).astype(np.int32)
    # Half a step, and the rounding of the samples: three of 1/2 each against a curvature of 0.6 height.
    offset = vertex(*(samples[i : i + 1] for i in range(3)))[0]
    assert abs(offset / 16 - top) <= 1 / 32 + 1.5 / (0.6 * height)


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


def test_farthest_position_of_the_largest_frame_fits() -> None:
    code = np.zeros((3, 2048), np.uint16)
    code[1, 2046:] = (9000, 9000)
    fine_x, _ = refine(np.pad(code, ((0, 0), (0, 1))), np.array([2047]), np.array([1]), 1)
    assert fine_x[0] == 2 * (16 * 2047 - 8) + 8
