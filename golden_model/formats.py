"""Fixed-point formats of the data path: range, rounding and saturation, defined in one place.

Rounding everywhere is "add half, then arithmetic shift right" (ties toward plus infinity);
every plain ``>>`` is an arithmetic shift (floor).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class FixedPoint:
    """A fixed-point format of ``integer_bits`` (sign included) and ``fraction_bits``."""

    integer_bits: int
    fraction_bits: int
    signed: bool

    @property
    def bits(self) -> int:
        """Total width in bits."""
        return self.integer_bits + self.fraction_bits

    @property
    def min_raw(self) -> int:
        """Smallest raw integer."""
        return -(1 << (self.bits - 1)) if self.signed else 0

    @property
    def max_raw(self) -> int:
        """Largest raw integer."""
        return (1 << (self.bits - 1)) - 1 if self.signed else (1 << self.bits) - 1

    @property
    def one(self) -> int:
        """The raw integer that represents 1.0, e.g. positions per pixel for `POSITION`."""
        return 1 << self.fraction_bits

    def quantise(self, value: float) -> int:
        """The raw integer nearest to a real ``value`` (halves round up).

        Raises
        ------
        ValueError
            If the rounded value does not fit the format.
        """
        raw = int(np.floor(value * self.one + 0.5))
        if not self.min_raw <= raw <= self.max_raw:
            raise ValueError(f"{value} does not fit {self}")
        return raw

    def holds(self, raw: NDArray[np.integer]) -> bool:
        """Whether the format can represent every element of ``raw``."""
        return bool(raw.size == 0 or (raw.min() >= self.min_raw and raw.max() <= self.max_raw))

    def __str__(self) -> str:
        return f"{'SQ' if self.signed else 'UQ'}({self.integer_bits}, {self.fraction_bits})"


def UQ(integer_bits: int, fraction_bits: int = 0) -> FixedPoint:
    """Unsigned fixed-point format."""
    return FixedPoint(integer_bits, fraction_bits, signed=False)


def SQ(integer_bits: int, fraction_bits: int = 0) -> FixedPoint:
    """Signed fixed-point format; ``integer_bits`` includes the sign."""
    return FixedPoint(integer_bits, fraction_bits, signed=True)


PIXEL = UQ(8)
GRADIENT = SQ(11)
"""Sobel output: |g| <= 4 * 255."""
TENSOR_DIAGONAL = UQ(17)
"""A and B, the windowed sums of squared gradients after the shift."""
TENSOR_TRACE = UQ(17)
"""A + B: one 17x17 unsigned multiplier squares it."""
TENSOR_MIXED = SQ(17)
"""C, the windowed sum of gradient products after the shift."""
RAW_RESPONSE = SQ(32)
"""The Harris measure before threshold and compression; it never saturates (bounds in `pixel.harris`)."""
RESPONSE_FRACTION_BITS = 10
RESPONSE_CODE = UQ(15)
"""The response as stored: 5-bit exponent field, 10-bit fraction, hidden one, denormal below 1024."""
POSITION = UQ(12, 4)
"""Pixel position in full-resolution coordinates, in 1/16 px (`POSITION.one` per pixel); pixel centres are integers."""
MEMBERSHIP = UQ(1, 8)
"""Degrees of membership and output singletons of fuzzy rules: 256 represents 1."""
WEIGHT = UQ(0, 8)
"""Weight that the fuzzy rules give to a match, 0 to 255."""


def round_shift(raw: NDArray[np.int64], shift: int) -> NDArray[np.int64]:
    """Divide by ``2**shift`` and round to the nearest integer, halves up."""
    if shift == 0:
        return raw
    rounded: NDArray[np.int64] = (raw + (1 << (shift - 1))) >> shift
    return rounded


def encode_response(value: NDArray[np.integer]) -> NDArray[np.uint16]:
    """Compress non-negative responses to a 15-bit code that keeps their 11 leading bits.

    Codes have the same order as the values. The compression loses no registrations and halves the line memory of the
    suppression (measured).

    Parameters
    ----------
    value : ndarray of int
        0 to 2**31 - 1.

    Returns
    -------
    ndarray of uint16
        `RESPONSE_CODE`, of the same shape.
    """
    magnitude = np.asarray(value, dtype=np.int32)
    # The code equals the upper part of the value as a float32: 10 of the 23 fraction bits, and the exponent with
    # another bias, so that 2**10 has field 1. Converting to float32 rounds. The mask clears the bit 13 places below the
    # leading one (and some further down), which stops the carry of that rounding before it reaches the kept bits.
    code = (magnitude & ~(magnitude >> 13)).astype(np.float32).view(np.int32)
    code >>= 13
    code -= (127 + 9) << RESPONSE_FRACTION_BITS
    # Below 2**10 the code is the value itself, which is larger there; from 2**10 on, no code is below 2**10.
    return np.asarray(np.maximum(code, np.minimum(magnitude, 1 << RESPONSE_FRACTION_BITS)), dtype=np.uint16)


def decode_response(code: NDArray[np.integer]) -> NDArray[np.int32]:
    """Decode 15-bit response codes; the low bits that the code dropped are zero."""
    wide = np.asarray(code, dtype=np.int32)
    field = wide >> RESPONSE_FRACTION_BITS
    hidden = (field > 0).astype(np.int32) << RESPONSE_FRACTION_BITS
    mantissa = (wide & ((1 << RESPONSE_FRACTION_BITS) - 1)) + hidden
    value: NDArray[np.int32] = mantissa << np.maximum(field - 1, 0)
    return value
