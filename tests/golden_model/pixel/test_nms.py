"""Suppression equals a loop over pixels."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from golden_model.pixel.nms import suppress

# Few values, so that ties and plateaus are common.
codes = st.tuples(st.integers(1, 13), st.integers(1, 13)).flatmap(
    lambda shape: arrays(np.uint16, shape, elements=st.sampled_from([0, 0, 1, 2, 3, 32767]))
)


def naive(code: NDArray[np.uint16], radius_px: int, ties: str) -> NDArray[np.uint16]:
    kept = np.zeros_like(code)
    height, width = code.shape
    for y in range(height):
        for x in range(width):
            others = [
                (int(code[v, u]), (v, u))
                for v in range(max(y - radius_px, 0), min(y + radius_px + 1, height))
                for u in range(max(x - radius_px, 0), min(x + radius_px + 1, width))
                if (u, v) != (x, y)
            ]
            beaten = any(value > code[y, x] for value, _ in others)
            tied = [place for value, place in others if value == code[y, x]]
            loses_tie = bool(tied) if ties == "lose" else any(place < (y, x) for place in tied)
            if code[y, x] and not beaten and not loses_tie:
                kept[y, x] = code[y, x]
    return kept


@pytest.mark.parametrize("ties", ["first", "lose"])
@pytest.mark.parametrize("radius_px", [1, 3])
@given(code=codes)
def test_suppression_equals_the_loop(code: Any, radius_px: int, ties: str) -> None:
    np.testing.assert_array_equal(suppress(code, radius_px, ties), naive(code, radius_px, ties))


@pytest.mark.parametrize(("ties", "kept"), [("first", [[7, 0, 0, 0, 0]]), ("lose", [[0, 0, 0, 0, 0]])])
def test_a_suppressed_response_still_suppresses(ties: str, kept: list[list[int]]) -> None:
    np.testing.assert_array_equal(suppress(np.array([[7, 7, 7, 7, 7]], np.uint16), 3, ties), kept)


def test_an_unknown_tie_rule_is_refused() -> None:
    with pytest.raises(ValueError, match="ties is 'last'; valid: first, lose"):
        suppress(np.zeros((4, 4), np.uint16), 1, "last")
