"""The adaptive threshold has the defined steps and limits, and settles near its target."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.formats import decode_response, encode_response
from golden_model.pixel.threshold import STEPS, next_code


@pytest.mark.parametrize(
    ("code", "count", "following"),
    [(5000, 1000, 5000), (5000, 1001, 5000), (5000, 1002, 5001), (5000, 999, 4999), (5000, 2024, 5512),
     (5000, 9000, 5512), (5000, 0, 4500), (3, 0, 1), (21_400, 2000, 21_503)],
)  # fmt: skip
def test_step_is_half_the_excess_within_limits(code: int, count: int, following: int) -> None:
    assert next_code(code, count, 1000) == following


@given(st.sampled_from(["harris", "fast"]), st.integers(1, 254), st.integers(0, 65_535), st.integers(0, 4096))
def test_code_stays_valid_and_moves_towards_the_target(detector: Any, code: Any, count: Any, target: Any) -> None:
    following = next_code(code, count, target, detector)
    assert 1 <= following <= STEPS[detector].max_code
    assert (following - code) * np.sign(count - target) >= 0


def test_a_code_survives_the_way_through_a_configuration() -> None:
    codes = np.arange(1, STEPS["harris"].max_code + 1)
    np.testing.assert_array_equal(encode_response(decode_response(codes)), codes)


@pytest.mark.parametrize(("detector", "start"), [("harris", 2), ("harris", 20_000), ("fast", 5), ("fast", 200)])
def test_count_settles_near_the_target(detector: str, start: int) -> None:
    rng = np.random.default_rng(0)
    codes = rng.normal(11_000, 2500, 6000) if detector == "harris" else rng.exponential(15, 6000)
    code = start
    for _ in range(60):
        count = int((codes >= code).sum())
        code = next_code(code, count, 1000, detector)
    assert abs(count - 1000) <= 150
