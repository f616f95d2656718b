"""The floating-point arithmetic of the estimator: one operation, c + ab or c - ab; `hdl.geometry.floating` builds it.

A number is (-1)^sign M 2^(E - 32) with a mantissa M of 32 bits and a signed exponent E of 10 bits. M has its leading
bit set, unless the number is zero or was loaded from an integer. Magnitudes are truncated, never rounded, so that no
carry follows the normalisation; with 32 bits a sum over 512 matches still keeps the 22 bits or more that matter.

The product keeps its 33 leading bits. The term with the smaller exponent is shifted to the larger one; their sum has
at most 34 bits, and is shifted left until its leading bit is set. A zero gets the smallest exponent, so that it never
shifts the other term. An exponent beyond the format becomes the largest, or the number 0: nothing is ever infinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

MANTISSA_BITS = 32
EXPONENT_BITS = 10
MIN_EXPONENT, MAX_EXPONENT = -(1 << EXPONENT_BITS - 1), (1 << EXPONENT_BITS - 1) - 1
SUM_BITS = MANTISSA_BITS + 2
"""Magnitude of the sum of two terms of `MANTISSA_BITS` + 1 bits."""
SEED_INDEX_BITS = 7
"""Bits of the mantissa, after the leading one, that select the first approximation of a reciprocal."""
SEED_BITS = SEED_INDEX_BITS + 1
SEEDS = tuple(
    round((1 << SEED_INDEX_BITS + SEED_BITS) / ((1 << SEED_INDEX_BITS) + n + 0.5)) for n in range(1 << SEED_INDEX_BITS)
)
"""Reciprocals of the middle of each interval, 128 to 255; the relative error is below 2^-7."""


class Number(Protocol):
    """What formulas are written for: arrays of numbers (`Floats`), or the tracer of `golden_model.geometry.program`."""

    def plus(self, a: Self, b: Self) -> Self:
        """This + ``a`` ``b``."""
        ...

    def minus(self, a: Self, b: Self) -> Self:
        """This - ``a`` ``b``."""
        ...

    def seed(self) -> Self:
        """Approximate the reciprocal to 7 bits."""
        ...


@dataclass(frozen=True, eq=False)
class Floats:
    """Numbers of any shape."""

    mantissa: NDArray[np.int64]
    """0 to 2^32 - 1."""
    exponent: NDArray[np.int64]
    negative: NDArray[np.bool_]

    @classmethod
    def from_integers(cls, values: NDArray[np.integer], bits: int) -> Floats:
        """Read unsigned integers of ``bits`` bits as fractions, as the hardware loads them; they are not normalised."""
        mantissa = np.asarray(values, dtype=np.int64) << MANTISSA_BITS - bits
        return cls(mantissa, np.zeros_like(mantissa), np.zeros(mantissa.shape, dtype=bool))

    @classmethod
    def from_real(cls, values: NDArray[np.float64]) -> Floats:
        """Truncate real numbers."""
        fraction, exponent = np.frexp(np.abs(values))
        mantissa = np.floor(fraction * float(1 << MANTISSA_BITS)).astype(np.int64)
        return cls(mantissa, np.where(mantissa, exponent, MIN_EXPONENT).astype(np.int64), np.asarray(values) < 0)

    @classmethod
    def stack(cls, numbers: Sequence[Floats]) -> Floats:
        """Join numbers along a new last axis, after broadcasting."""
        parts = ([getattr(each, name) for each in numbers] for name in ("mantissa", "exponent", "negative"))
        return cls(*(np.stack(np.broadcast_arrays(*part), axis=-1) for part in parts))

    def __getitem__(self, index: int | slice) -> Floats:
        mantissa, exponent, negative = (np.asarray(part)[index] for part in vars(self).values())
        return Floats(np.asarray(mantissa), np.asarray(exponent), np.asarray(negative))

    def plus(self, a: Floats, b: Floats) -> Floats:
        """This + ``a`` ``b``."""
        return self._add(a, b, a.negative ^ b.negative)

    def minus(self, a: Floats, b: Floats) -> Floats:
        """This - ``a`` ``b``."""
        return self._add(a, b, ~(a.negative ^ b.negative))

    def seed(self) -> Floats:
        """Approximate the reciprocal to 7 bits, of normalised numbers."""
        index = self.mantissa >> MANTISSA_BITS - 1 - SEED_INDEX_BITS & (1 << SEED_INDEX_BITS) - 1
        mantissa = np.array(SEEDS, dtype=np.int64)[index] << MANTISSA_BITS - SEED_BITS
        return Floats(mantissa, np.minimum(1 - self.exponent, MAX_EXPONENT), self.negative)

    def _add(self, a: Floats, b: Floats, negative: NDArray[np.bool_]) -> Floats:
        product = (a.mantissa.astype(np.uint64) * b.mantissa.astype(np.uint64) >> np.uint64(MANTISSA_BITS - 1)).astype(
            np.int64
        )
        exponent = a.exponent + b.exponent
        distance = exponent - self.exponent
        product = product >> np.clip(-distance, 0, MANTISSA_BITS + 1)
        addend = (self.mantissa << 1) >> np.clip(distance, 0, MANTISSA_BITS + 1)
        total = np.where(negative, -product, product) + np.where(self.negative, -addend, addend)
        magnitude = np.abs(total)
        zeros = SUM_BITS - np.frexp(magnitude.astype(np.float64))[1].astype(np.int64)
        exponent = np.maximum(exponent, self.exponent) + 1 - zeros
        is_zero = (magnitude == 0) | (exponent < MIN_EXPONENT)
        return Floats(
            np.where(is_zero, 0, magnitude << zeros >> SUM_BITS - MANTISSA_BITS),
            np.where(is_zero, MIN_EXPONENT, np.minimum(exponent, MAX_EXPONENT)),
            # A zero keeps the sign of the product: a reciprocal takes it over.
            np.where(total == 0, negative, total < 0),
        )
