"""Ring descriptors: the thesis's ILBP (equation III-4) and smoothed, oriented versions of it.

One `DescriptorPattern` configures both `describe` and the hardware, `hdl.feature.ilbp.RingDescriptor`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from golden_model.feature.orientation import moments, sector_of
from golden_model.records import Record, feature_record

SQUARE_RING = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""The eight neighbours of equation III-4 as (x, y) at distance 1, from +x towards +y (down)."""


@dataclass(frozen=True)
class DescriptorPattern:
    """Pixels that a ring descriptor compares.

    Bit i of byte ``(a, b, k)``, i = 0..7, says whether ring ``a`` at angle ``step * i + s`` is at least as bright as
    ring ``b`` at angle ``step * i + s + k`` (angles modulo ``angles``; ``step = angles // 8``; s is the orientation
    sector, 0 where the pattern is not oriented). Rings are indices into ``radii_px``.
    """

    name: str
    """As used in configurations."""
    radii_px: tuple[int, ...]
    """Radii of the rings; radius 0 is the centre pixel."""
    angles: int
    """Pixels per ring: 16 (circle) or 8 (the square of equation III-4)."""
    comparisons: tuple[tuple[int, int, int], ...]
    """``(a, b, k)`` of each descriptor byte."""
    smoothed: bool
    """The pixels come from the 5x5 binomial of the gray image, otherwise from the gray image itself."""
    oriented: bool
    """The compared angles rotate with the orientation sector."""
    carries_window: bool = False
    """The feature record also holds the 3x3 gray window around the feature, whose SAD the fuzzy ILBP needs."""

    def __post_init__(self) -> None:
        if self.angles not in (8, 16):
            raise ValueError(f"a ring has 8 or 16 angles, not {self.angles}")
        if self.oriented and self.angles != 16:
            raise ValueError("an oriented pattern needs rings of 16 angles")
        for a, b, k in self.comparisons:
            if not (0 <= a < len(self.radii_px) and 0 <= b < len(self.radii_px) and 0 <= k < self.angles):
                raise ValueError(f"comparison {(a, b, k)} is outside the rings of {self.name}")

    @property
    def descriptor_bytes(self) -> int:
        """Length of the descriptor."""
        return len(self.comparisons)

    @property
    def bits(self) -> int:
        """Length of the descriptor in bits: the largest Hamming distance."""
        return 8 * self.descriptor_bytes

    @property
    def window_bytes(self) -> int:
        """Bytes of the gray window that the record holds beside the descriptor."""
        return 9 if self.carries_window else 0

    @cached_property
    def record(self) -> Record:
        """Record of a feature with this descriptor."""
        return feature_record(self.descriptor_bytes, self.window_bytes)

    @property
    def support_px(self) -> int:
        """Largest distance in x or y of a gray pixel that the descriptor depends on."""
        return max(self.radii_px) + (2 if self.smoothed else 0)

    @cached_property
    def offsets(self) -> tuple[tuple[tuple[int, int], ...], ...]:
        """``offsets[ring][angle]`` = (x, y) of the pixel, y down."""
        return tuple(tuple(self._offset(radius, a) for a in range(self.angles)) for radius in self.radii_px)

    def _offset(self, radius: int, angle: int) -> tuple[int, int]:
        if self.angles == 8:
            x, y = SQUARE_RING[angle]
            return radius * x, radius * y
        # No product lies halfway between two integers, so the way of rounding does not matter.
        angle_rad = 2 * math.pi * angle / self.angles
        return round(radius * math.cos(angle_rad)), round(radius * math.sin(angle_rad))


# Chosen by ablation on real flights; docs/explanation/descriptor.md explains the notation.
_ILBP_128 = (
    (5, 2, 4), (6, 4, 13), (4, 2, 15), (6, 4, 1), (2, 1, 2), (6, 6, 3), (4, 4, 2), (5, 3, 0),
    (3, 2, 2), (6, 4, 15), (5, 5, 1), (2, 1, 13), (6, 6, 5), (3, 2, 0), (6, 5, 0), (5, 2, 1),
)  # fmt: skip
_ILBP_256_TAIL = (
    (3, 2, 14), (6, 5, 2), (5, 0, 0), (4, 4, 1), (5, 4, 15), (6, 5, 15), (6, 3, 1), (2, 2, 3),
    (4, 2, 0), (6, 5, 11), (6, 6, 1), (2, 0, 0), (4, 3, 15), (6, 4, 0), (5, 5, 3), (3, 3, 1),
)  # fmt: skip
_RINGS_PX = (0, 2, 4, 6, 9, 12, 15)

ILBP_128 = DescriptorPattern("ilbp-128", _RINGS_PX, 16, _ILBP_128, smoothed=True, oriented=True)
ILBP_256 = DescriptorPattern("ilbp-256", _RINGS_PX, 16, _ILBP_128 + _ILBP_256_TAIL, smoothed=True, oriented=True)


def thesis_ilbp(rings: int) -> DescriptorPattern:
    """The thesis's ILBP of 8 ``rings`` bits (equation III-4): neighbours at r = 1..rings against the centre."""
    return DescriptorPattern(
        name=f"thesis-ilbp-{rings}",
        radii_px=tuple(range(rings + 1)),
        angles=8,
        comparisons=tuple((radius, 0, 0) for radius in range(1, rings + 1)),
        smoothed=False,
        oriented=False,
        carries_window=True,
    )


_UPRIGHT = tuple(replace(p, name=f"{p.name}-upright", oriented=False) for p in (ILBP_128, ILBP_256))

PATTERNS = {p.name: p for p in (ILBP_128, ILBP_256, *_UPRIGHT, *(thesis_ilbp(n) for n in range(1, 5)))}
"""Every descriptor by its name in configurations."""


def describe(
    gray: NDArray[np.uint8],
    smoothed5: NDArray[np.uint8],
    x: NDArray[np.integer],
    y: NDArray[np.integer],
    pattern: DescriptorPattern,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Orientation sector and descriptor of every feature.

    Parameters
    ----------
    gray : (H, W) uint8
        Gray image of the features' level.
    smoothed5 : (H, W) uint8
        The 5x5 binomial of ``gray``; used if ``pattern.smoothed``.
    x, y : (N,) integer
        Feature positions in the level's pixels, at least ``pattern.support_px`` from the border.
    pattern : DescriptorPattern
        The pixels to compare.

    Returns
    -------
    sector : (N,) uint8
        0..15 sixteenths of a full circle from +x towards +y (down); 0 if the pattern is not oriented.
    descriptor : (N, pattern.descriptor_bytes) uint8
        Descriptor bit 8 j + i is bit i of byte j.

    Raises
    ------
    ValueError
        If a pixel of a ring lies outside the image.
    """
    plane = smoothed5 if pattern.smoothed else gray
    offsets = [offset for ring in pattern.offsets for offset in ring]
    samples = gather(plane, x, y, offsets).reshape(len(pattern.radii_px), pattern.angles, -1)
    if pattern.oriented:
        sector = sector_of(*moments(samples, pattern.radii_px))
    else:
        sector = np.zeros(samples.shape[2], dtype=np.uint8)
    return sector, _compare(samples, sector, pattern)


def gather(
    plane: NDArray[np.uint8], x: NDArray[np.integer], y: NDArray[np.integer], offsets: Sequence[tuple[int, int]]
) -> NDArray[np.uint8]:
    """The pixels at each of M ``(dx, dy)`` offsets from each of N positions: (M, N) uint8.

    Raises
    ------
    ValueError
        If one of the pixels lies outside the (H, W) plane.
    """
    height, width = plane.shape
    columns = np.asarray(x, dtype=np.intp)
    rows = np.asarray(y, dtype=np.intp)
    dx, dy = np.array(offsets, dtype=np.intp).T
    # Checked once for the bounding box of the offsets: `take` would read a pixel of another line instead.
    inside = (
        (columns + dx.min() >= 0) & (columns + dx.max() < width) & (rows + dy.min() >= 0) & (rows + dy.max() < height)
    )
    if not inside.all():
        outside = int(np.argmin(inside))
        raise ValueError(
            f"feature {outside} at ({columns[outside]}, {rows[outside]}) reaches outside the {width}x{height} image; "
            "keep features at least the descriptor's support from the border"
        )
    pixels: NDArray[np.uint8] = np.take(plane, (rows * width + columns) + (dy * width + dx)[:, np.newaxis])
    return pixels


def _compare(samples: NDArray[np.uint8], sector: NDArray[np.uint8], pattern: DescriptorPattern) -> NDArray[np.uint8]:
    """Descriptor bytes (N, B) from (rings, angles, N) samples: compare at every angle, then rotate by the sector."""
    rings_a, rings_b, shifts = np.array(pattern.comparisons, dtype=np.intp).T[:, :, np.newaxis]
    angle = np.arange(pattern.angles)
    bits = samples[rings_a, angle] >= samples[rings_b, (angle + shifts) % pattern.angles]
    # Angle step * i + phase becomes bit i of byte ``phase``; a rotation by a sector selects the phase and rotates the
    # byte.
    step = pattern.angles // 8
    phases = np.packbits(bits.reshape(len(shifts), 8, step, -1), axis=1, bitorder="little")[:, 0]
    phase, rotation = sector % step, sector // step
    chosen = phases[:, phase, np.arange(sector.size)]
    return np.ascontiguousarray(((chosen >> rotation) | (chosen << (8 - rotation))).T)
