"""Ring descriptors: the thesis's ILBP (equation III-4) and its smoothed, oriented descendants.

One `DescriptorPattern` describes them all, here and in ``hdl/ilbp.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

SQUARE_RING = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""The eight neighbours of equation III-4 as (x, y) at distance 1, from +x towards +y (down)."""


@dataclass(frozen=True)
class DescriptorPattern:
    """Which pixels a ring descriptor compares.

    Byte ``(a, b, k)`` holds in bit i, i = 0..7, whether ring ``a`` at angle ``step * i + s`` is at least ring
    ``b`` at angle ``step * i + s + k`` (angles modulo ``angles``, ``step = angles // 8``, s the sector of the
    orientation, 0 where the pattern is not oriented). Rings are indices into ``radii_px``.

    Parameters
    ----------
    name : str
        As used in configurations.
    radii_px : tuple of int
        Ring radii; radius 0 is the centre pixel.
    angles : int
        Pixels a ring: 16 (circle) or 8 (the square of equation III-4).
    comparisons : tuple of (int, int, int)
        ``(a, b, k)`` of each descriptor byte.
    smoothed : bool
        Whether the pixels come from the 5x5 binomial of the gray image or from the gray image itself.
    oriented : bool
        Whether the comparison turns with the orientation sector.
    carries_window : bool
        Whether the 3x3 gray window around the feature travels with the descriptor (for the SAD belonging).
    """

    name: str
    radii_px: tuple[int, ...]
    angles: int
    comparisons: tuple[tuple[int, int, int], ...]
    smoothed: bool
    oriented: bool
    carries_window: bool = False

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
        """Bytes of gray window that travel with the descriptor."""
        return 9 if self.carries_window else 0

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
        turn = 2 * math.pi * angle / self.angles
        return round(radius * math.cos(turn)), round(radius * math.sin(turn))


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
