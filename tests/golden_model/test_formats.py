"""Fixed-point formats and the response code equal Python integers."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from golden_model.formats import RESPONSE_CODE, SQ, UQ, decode_response, encode_response, round_shift

responses = st.one_of(st.integers(0, 5000), st.integers(0, 2**31 - 1), st.integers(0, 30).map(lambda n: 2**n))


@given(st.lists(responses, min_size=1))
def test_code_keeps_eleven_leading_bits(values: Any) -> None:
    codes = encode_response(np.array(values, np.int64))
    dropped = [max(value.bit_length() - 11, 0) for value in values]
    assert decode_response(codes).tolist() == [value >> d << d for value, d in zip(values, dropped, strict=True)]
    assert codes.tolist() == [1024 * d + (value >> d) for value, d in zip(values, dropped, strict=True)]
    assert RESPONSE_CODE.holds(codes)


@given(responses, responses)
def test_codes_compare_as_values_do(first: Any, second: Any) -> None:
    low, high = sorted((first, second))
    assert encode_response(np.array(low)) <= encode_response(np.array(high))


@given(st.integers(-(2**40), 2**40), st.integers(0, 20))
def test_round_shift_rounds_halves_up(value: Any, shift: Any) -> None:
    assert round_shift(np.array(value), shift) == (2 * value + 2**shift) // 2 ** (shift + 1)


def test_ranges_and_quantisation() -> None:
    assert (SQ(11).min_raw, SQ(11).max_raw, UQ(12, 4).max_raw, UQ(1, 8).one) == (-1024, 1023, 65535, 256)
    assert UQ(0, 8).quantise(0.25) == 64
    with pytest.raises(ValueError, match=r"1\.0 does not fit UQ\(0, 8\)"):
        UQ(0, 8).quantise(1.0)
    assert SQ(11).holds(np.array([-1024, 1023]))
    assert SQ(11).holds(np.zeros(0, int))
    assert not any(SQ(11).holds(np.array([0, beyond])) for beyond in (-1025, 1024))
