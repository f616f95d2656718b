"""Shapes of the land under the landscape, which by itself is flat."""

from collections.abc import Callable

import numpy as np

from sim.scene.canvas import Plane

TERRACE_PX, TERRACE_WIDTH_PX, BANK_PX = 14, 260, 24
SLOPE, VALLEY_PX = 0.2, 700


def _dunes(x: Plane, y: Plane) -> Plane:
    return np.asarray(12 + 7.5 * np.sin((x + 0.4 * y) / 68) + 4.5 * np.sin((y - 0.3 * x) / 46))


def _terraces(x: Plane, y: Plane) -> Plane:
    step, along = np.divmod(x + 0.25 * y, TERRACE_WIDTH_PX)
    # Four up, four down.
    return np.asarray(TERRACE_PX * np.abs((step + np.clip(along / BANK_PX, 0, 1) + 4) % 8 - 4))


def _slope(x: Plane, y: Plane) -> Plane:
    """Valleys, and hills as wide between them."""
    away = np.abs((x + 0.5 * y) % (2 * VALLEY_PX) - VALLEY_PX)
    return np.asarray(SLOPE * np.maximum(away - VALLEY_PX / 2, 0))


TERRAINS: dict[str, Callable[[Plane, Plane], Plane]] = {"dunes": _dunes, "terraces": _terraces, "slope": _slope}


def render_terrain(name: str, width_px: int, height_px: int, origin: tuple[int, int]) -> Plane:
    """Height of the land over the plane, never negative, in px, (height_px, width_px); from ``origin`` (x, y)."""
    x, y = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in (width_px, height_px)))
    return TERRAINS[name](x + origin[0], y + origin[1])
