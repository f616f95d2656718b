"""The ground seen from straight above: tiles are painted, then lit by the sun."""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Float32, Pixels
from sim.scene.canvas import MARGIN_PX, Canvas, Plane
from sim.scene.layout import plan_sections
from sim.scene.noise import Stream, make_noise, make_rng
from sim.scene.objects import paint_boxes, paint_plants
from sim.scene.surface import paint_parcels, paint_ponds, paint_roads

TILE_PX = 512
"""Of smaller tiles fewer pixels are painted that nobody sees, and more in the margins."""
CACHED_TILES = 192
"""Number of tiles in the cache, 768 KiB of colours and 512 KiB of heights each."""

_EDGE = cv2.BORDER_REPLICATE
_SUN, _SKY, _HAZE = (0.74, 0.82, 0.86), (0.21, 0.17, 0.14), (0.050, 0.046, 0.042)
"""Light of the sun and of the sky, and the haze between ground and camera; blue, green, red."""


def render_ground(seed: int, width_px: int, height_px: int, origin: tuple[int, int] = (0, 0)) -> Pixels:
    """An aerial photograph of a generated landscape, at about 0.15 m per pixel.

    The landscape is an endless plane that depends on the seed only; this is the part that starts at ``origin``.

    Parameters
    ----------
    seed : int
        Non-negative.
    width_px, height_px : int
        Size of the part.
    origin : (int, int)
        x and y of the part's top left pixel in the plane; may be negative.

    Returns
    -------
    ndarray
        Shape (height_px, width_px, 3), uint8, BGR. Parts that overlap agree exactly.
    """
    return _assemble_tiles(0, np.empty((height_px, width_px, 3), np.uint8), seed, origin)


def render_heights(seed: int, width_px: int, height_px: int, origin: tuple[int, int] = (0, 0)) -> NDArray[np.float16]:
    """Height of the surface of that landscape over the plane, in pixels, (height_px, width_px); arguments the same."""
    return _assemble_tiles(1, np.empty((height_px, width_px), np.float16), seed, origin)


def _assemble_tiles(part: int, whole: NDArray[Any], seed: int, origin: tuple[int, int]) -> NDArray[Any]:
    """``whole`` filled from one part of the tiles, 0 the colours or 1 the heights."""
    left, top = origin
    height_px, width_px = whole.shape[:2]
    for row in range(top // TILE_PX, (top + height_px - 1) // TILE_PX + 1):
        for column in range(left // TILE_PX, (left + width_px - 1) // TILE_PX + 1):
            x, y = column * TILE_PX - left, row * TILE_PX - top
            tile = _paint_tile(seed, column, row)[part][max(-y, 0) : height_px - y, max(-x, 0) : width_px - x]
            x, y = max(x, 0), max(y, 0)
            whole[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    return whole


@lru_cache(maxsize=CACHED_TILES)
def _paint_tile(seed: int, column: int, row: int) -> tuple[Pixels, NDArray[np.float16]]:
    """Colours and heights of one tile: painted and lit with its margin, which is then cut off."""
    x_px, y_px = column * TILE_PX - MARGIN_PX, row * TILE_PX - MARGIN_PX
    size = TILE_PX + 2 * MARGIN_PX
    noise = make_noise(seed, x_px, y_px, size, size)
    canvas = Canvas(x_px, y_px, np.empty((3, size, size), np.float32), np.empty((size, size), np.float32), noise)
    sections = plan_sections(seed, x_px, y_px, size, size)
    parcels = [parcel for section in sections for parcel in section.parcels]
    paint_parcels(canvas, [parcel for parcel in parcels if canvas.meets(parcel.outline)])
    paint_ponds(canvas, np.concatenate([section.ponds for section in sections]))
    paint_roads(canvas, [road for section in sections for road in section.roads if canvas.meets(road.points)])
    paint_boxes(canvas, [box for section in sections for box in section.boxes])
    paint_plants(canvas, np.concatenate([section.plants for section in sections]))
    lit = _light(canvas, make_rng(seed, Stream.SUN))
    inside = slice(MARGIN_PX, -MARGIN_PX)
    colours, heights = lit[inside, inside].copy(), canvas.relief[inside, inside].astype(np.float16)
    for part in (colours, heights):
        part.flags.writeable = False
    return colours, heights


def _light(canvas: Canvas, rng: np.random.Generator) -> Pixels:
    """Light the canvas by sun and blue sky: Lambert shading, cast shadows, darker hollows; returns display values."""
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(40, 54))
    toward_sun = np.array([np.cos(azimuth), np.sin(azimuth)], np.float32)
    relief = cv2.GaussianBlur(canvas.relief, (0, 0), 0.6)
    across = np.clip(cv2.Sobel(relief, -1, 1, 0, scale=1 / 8), -1.2, 1.2)
    down = np.clip(cv2.Sobel(relief, -1, 0, 1, scale=1 / 8), -1.2, 1.2)
    facing = np.float32(np.tan(elevation)) - toward_sun[0] * across - toward_sun[1] * down
    facing = np.maximum(facing, 0) / np.sqrt(1 + across**2 + down**2) / np.float32(np.tan(elevation))
    sunlit = facing * (1 - _cast_shadows(relief, toward_sun, np.tan(elevation)))
    open_sky = 1 - np.clip((cv2.blur(relief, (25, 25)) - relief) / 40, 0, 0.5)
    channels = []
    for reflectance, sun, sky, haze in zip(canvas.reflectance, _SUN, _SKY, _HAZE, strict=True):
        lit = reflectance * np.sqrt(sunlit * sun + open_sky * sky) + haze
        channels.append(cv2.convertScaleAbs(cv2.GaussianBlur(lit, (0, 0), 0.5), alpha=255))
    return np.asarray(cv2.merge(channels), np.uint8)


def _cast_shadows(relief: Plane, toward_sun: Float32, rise: float) -> Plane:
    """Share of the sun that is hidden, 0..1.

    The height of the shadow above each pixel is the largest relief towards the sun, lowered by ``rise`` for each pixel
    of distance. The distance doubles at each step, so that seven steps cover 127 px.
    """
    shade = relief
    for way_px in (1, 2, 4, 8, 16, 32, 64):
        dx, dy = np.rint(toward_sun * way_px).astype(int)
        shift = np.array([[1, 0, -dx], [0, 1, -dy]], np.float32)
        moved = cv2.warpAffine(shade, shift, relief.shape[::-1], flags=cv2.INTER_NEAREST, borderMode=_EDGE)
        shade = np.maximum(shade, moved - np.float32(rise * np.hypot(dx, dy)))
    return np.asarray(cv2.GaussianBlur(np.clip((shade - relief - 0.3) / 1.5, 0, 1), (0, 0), 0.9), np.float32)
