"""Shapes of the land under the landscape, which by itself is flat: dunes, terraces, and a slope beside a valley."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Heights = NDArray[np.float32]

DUNE_PX, DUNE_LENGTHS_PX = 24, (430, 290)
TERRACE_PX, TERRACE_WIDTH_PX, BANK_PX = 14, 260, 24
SLOPE, VALLEY_PX = 0.2, 700
"""The valley is flat, and as wide as the hills beside it."""


def _dunes(x: Heights, y: Heights) -> Heights:
    first, second = DUNE_LENGTHS_PX
    waves = np.sin(2 * np.pi * (x + 0.4 * y) / first) + 0.6 * np.sin(2 * np.pi * (y - 0.3 * x) / second)
    return np.asarray(DUNE_PX * (waves + 1.6) / 3.2, np.float32)


def _terraces(x: Heights, y: Heights) -> Heights:
    step, along = np.divmod(x + 0.25 * y, TERRACE_WIDTH_PX)
    banks = step + np.clip(along / BANK_PX, 0, 1)
    # Up and down again, four each.
    return np.asarray(TERRACE_PX * np.abs((banks + 4) % 8 - 4), np.float32)


def _slope(x: Heights, y: Heights) -> Heights:
    away = np.abs((x + 0.5 * y) % (2 * VALLEY_PX) - VALLEY_PX)
    return np.asarray(SLOPE * np.maximum(away - VALLEY_PX / 2, 0), np.float32)


TERRAINS: dict[str, Callable[[Heights, Heights], Heights]] = {"dunes": _dunes, "terraces": _terraces, "slope": _slope}


def render_terrain(name: str, width_px: int, height_px: int, origin: tuple[int, int]) -> Heights:
    """Height of the land over the plane, never negative, in pixels, (height_px, width_px).

    Parameters
    ----------
    name : str
        A key of `TERRAINS`.
    width_px, height_px : int
    origin : (int, int)
        x and y of the top left pixel in the plane.
    """
    x, y = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in (width_px, height_px)))
    return TERRAINS[name](x + origin[0], y + origin[1])
