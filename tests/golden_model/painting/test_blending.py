"""The blend equals its formula in real numbers, fades without a step, and forgets nothing that it should keep."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.painting.blending import FADE, blend

byte = st.integers(0, 255)


def pixels(*rows: list[int]) -> np.ndarray:
    return np.array(rows, np.uint8)


@given(old=st.lists(byte, min_size=4, max_size=4), colour=st.lists(byte, min_size=3, max_size=3), weight=byte)
def test_shares_follow_the_difference_of_weights(old: list[int], colour: list[int], weight: int) -> None:
    share = min(max((weight - old[3]) / FADE + 0.5, 0), 1) if old[3] else 1
    share *= weight > 0
    expected = [np.floor(under * (1 - share) + over * share + 0.5) for under, over in zip(old[:3], colour, strict=True)]
    new = blend(pixels(old), np.array([colour]), np.array([weight]))
    assert new[0].tolist() == [*expected, max(old[3], weight)]


@given(old=st.lists(byte, min_size=4, max_size=4), colour=st.lists(byte, min_size=3, max_size=3), weight=byte)
def test_replacing_forgets_the_canvas(old: list[int], colour: list[int], weight: int) -> None:
    new = blend(pixels(old), np.array([colour]), np.array([weight]), replace=True)
    assert new[0].tolist() == ([*colour, weight] if weight else [0, 0, 0, 0])


def test_a_frame_fades_into_another_without_a_step() -> None:
    """Two frames side by side: black, whose border is on the right, and white, whose border is on the left."""
    x = np.arange(60)
    old = np.zeros((60, 4), np.uint8)
    old[:, 3] = 60 - x
    new = blend(old, np.full((60, 3), 255), x + 1)
    steps = np.diff(new[:, 0].astype(int))
    assert new[0, 0] == 0
    assert new[-1, 0] == 255
    assert steps.min() == 0
    # The difference of the weights changes by 2 per pixel, and is odd.
    assert steps.max() <= 2 * 256 // FADE
    assert np.flatnonzero(steps).size == FADE // 2 + 1


@pytest.mark.parametrize("weight", [0, 1, 40, 255])
def test_equal_weights_share_and_lesser_ones_by_half_the_fade_change_nothing(weight: int) -> None:
    before = np.arange(1, 256)
    old = np.column_stack([np.full((255, 3), 10), before]).astype(np.uint8)
    new = blend(old, np.full((255, 3), 210), np.full(255, weight))
    kept = (new == old).all(axis=1)
    np.testing.assert_array_equal(kept, (weight == 0) | (before - weight >= FADE // 2))
    assert all(new[before == weight, 0] == 110)
