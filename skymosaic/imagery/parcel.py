"""Pixels that are compressed, without loss, on their way from one process to another."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEVEL = 1
"""zlib's level: higher ones take twice the time for a twentieth less."""


@dataclass(frozen=True, eq=False)
class Parcel:
    """An array of integers or booleans of any shape; threads share it, and only its pickle is compressed."""

    pixels: NDArray[Any]

    def __reduce__(self) -> tuple[Callable[..., Parcel], tuple[bytes, str, tuple[int, ...]]]:
        numbers = self.pixels.view(np.uint8) if self.pixels.dtype == np.bool_ else self.pixels
        # Rows of a photograph resemble those above them, so differences, which wrap around, take half as much.
        above = np.concatenate([np.zeros_like(numbers[:1]), numbers[:-1]])
        return _unpack, (zlib.compress(numbers - above, LEVEL), self.pixels.dtype.str, self.pixels.shape)


def _unpack(data: bytes, kind: str, shape: tuple[int, ...]) -> Parcel:
    dtype = np.dtype(kind)
    numbers = np.frombuffer(bytearray(zlib.decompress(data)), np.uint8 if dtype == np.bool_ else dtype).reshape(shape)
    # numpy's own accumulation along the first axis takes eight times as long. The last axis makes rows of numbers, too.
    for above, row in pairwise(numbers[..., None]):
        np.add(above, row, out=row)
    return Parcel(numbers.view(dtype))
