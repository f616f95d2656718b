"""Maps pixels of more than 8 bits to 8 bits, with one range for a whole flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Intensities, Pixels
from skymosaic.common.errors import InputError

TAIL_PERCENT = 0.1
"""Share of values that saturate at each end when pixels are mapped to 8 bits."""
SAMPLES_PER_SIDE = 128
"""The range of a flight is measured on this many rows and columns per photograph, enough for tails of 0.1 %."""
NEARLY_BLACK, NEARLY_WHITE = 1, 254
CLIPPED_CELLS = 80
"""Cells along a photograph's width, in which clipped pixels are counted."""
_BAND_VALUES = 1 << 22
"""Values that are mapped to 8 bits at a time."""


@dataclass(frozen=True)
class ValueRange:
    """The range of values that 8 bits show."""

    low: float
    high: float
    """Shown as 0 and 255; values beyond them saturate."""
    deep: bool = False
    """The pixels keep their 16-bit numbers; the range only says how to show them."""

    @property
    def description(self) -> str:
        """One phrase for the report."""
        kept = "; .tif keeps 16 bits" if self.deep else ""
        return f"{self.low:.6g}..{self.high:.6g} of all photographs shown as 0..255{kept}"

    def to_8_bit(self, values: NDArray[np.generic]) -> Pixels:
        """Map uint16 or float32 linearly to uint8; NaN becomes 0."""
        # A picture of one value has no range.
        scale = 255.0 / max(self.high - self.low, 1e-12)
        pixels = np.empty(values.shape, np.uint8)
        # A few rows at a time, because each step makes a copy of four bytes per value: gigabytes for a photograph.
        for rows in _bands(values):
            levels = (values[rows].astype(np.float32) - np.float32(self.low)) * np.float32(scale)
            np.nan_to_num(levels, copy=False)
            pixels[rows] = np.clip(np.rint(levels), 0, 255)
        return pixels

    def to_16_bit(self, pixels: Pixels) -> NDArray[np.uint16]:
        """Convert 8-bit pixels of this range back to numbers of 16 bits."""
        return np.asarray(np.clip(np.rint(self._levels), 0, np.iinfo(np.uint16).max), dtype=np.uint16)[pixels]

    def show_as(self, pixels: Pixels, other: ValueRange) -> Pixels:
        """Convert 8-bit pixels of this range to those of another range."""
        return other.to_8_bit(self._levels.astype(np.float32)[:, None])[:, 0][pixels]

    @property
    def _levels(self) -> Array:
        """The values that 0 to 255 show, (256,)."""
        return np.asarray(self.low + np.arange(256) * (self.high - self.low) / 255)


def measure_range(decoded: NDArray[Any], name: str) -> ValueRange:
    """Measure the range of one photograph, uint16 or float32: all its values but the tails, as ``np.percentile`` does.

    Raises
    ------
    InputError
        For other types, or an image without a finite value.
    """
    if decoded.dtype not in (np.uint16, np.float32):
        raise InputError(f"{name}: pixels of {decoded.dtype} are not supported; convert them to unsigned 8 or 16 bits")
    tails = np.array((TAIL_PERCENT, 100 - TAIL_PERCENT))
    if decoded.dtype == np.uint16:
        # By a histogram, because sorting would need further copies of the photograph.
        counts = np.zeros(1 << 16, np.int64)
        for rows in _bands(decoded):
            counts += np.bincount(decoded[rows].ravel(), minlength=1 << 16)
        positions = tails / 100 * (decoded.size - 1)
        lower = np.searchsorted(counts.cumsum(), np.floor(positions), side="right").astype(np.float64)
        upper = np.searchsorted(counts.cumsum(), np.ceil(positions), side="right")
        share = positions % 1
        # NumPy interpolates from the nearer side.
        low, high = np.where(share < 0.5, lower + (upper - lower) * share, upper - (upper - lower) * (1 - share))
        return ValueRange(float(low), float(high))
    finite = decoded[np.isfinite(decoded)]
    if finite.size == 0:
        raise InputError(f"{name}: no pixel has a finite value; export it again")
    low, high = np.percentile(finite, tails, overwrite_input=True)
    return ValueRange(float(low), float(high))


def sample_values(decoded: NDArray[np.generic]) -> NDArray[np.generic]:
    """Sample the finite values of a photograph, evenly spread over it: (N,), or (N, 3) for colours of 16 bits."""
    down, across = (max(side // SAMPLES_PER_SIDE, 1) for side in decoded.shape[:2])
    sample = decoded[down // 2 :: down, across // 2 :: across]
    if sample.dtype == np.uint16:
        # Each channel has its own gain in a mosaic.
        return np.asarray(sample.reshape(-1, *sample.shape[2:]))
    return np.asarray(sample[np.isfinite(sample)])


def measure_common_range(samples: Sequence[NDArray[np.generic]]) -> ValueRange | None:
    """Measure the common range of photographs that are shown together: deep if all have 16 bits, None if all have 8.

    The samples are from `sample_values`; empty for a photograph of 8 bits.
    """
    given = [sample.ravel() for sample in samples if sample.size]
    if not given:
        return None
    low, high = np.percentile(np.concatenate(given), (TAIL_PERCENT, 100 - TAIL_PERCENT))
    return ValueRange(float(low), float(high), deep=all(sample.dtype == np.uint16 for sample in samples))


def show_in_8_bit(pixels: Intensities, values: ValueRange | None) -> Pixels:
    """Convert the pixels of a mosaic to 8 bits, by the range ``values`` where they have 16."""
    if values is None or pixels.dtype == np.uint8:
        return np.asarray(pixels, dtype=np.uint8)
    return values.to_8_bit(pixels)


def _bands(pixels: NDArray[np.generic]) -> list[slice]:
    rows = max(_BAND_VALUES // max(pixels[0].size, 1), 1)
    return [slice(top, top + rows) for top in range(0, len(pixels), rows)]


def measure_clipped(image: Intensities) -> Pixels:
    """Measure the share of pixels that are white in a channel, or black in all of them, or nearly.

    Returns
    -------
    ndarray of uint8, shape (rows, 80)
        0 to 255, in cells as high as wide; 0 for 16 bits, of which nobody knows where they end.
    """
    clipped: Pixels = np.zeros(image.shape[:2], np.uint8)
    if image.dtype == np.uint8:
        brightest = reduce(cv2.max, cv2.split(image))
        clipped[(brightest >= NEARLY_WHITE) | (brightest <= NEARLY_BLACK)] = 255
    size = CLIPPED_CELLS, max(round(CLIPPED_CELLS * clipped.shape[0] / clipped.shape[1]), 1)
    return np.asarray(cv2.resize(clipped, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
