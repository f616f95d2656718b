"""Paints the ground: fields and gardens, ponds, roads and tracks."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Points
from sim.scene.canvas import BLOCK_PX, MARGIN_PX, Canvas, Plane, bgr, lay_over
from sim.scene.layout import Parcel, Road

_FIXED_POINT_BITS = 4
_STRIP_PX = 32
"""Rows that are textured at a time: so few fit into a processor's cache."""


@dataclass(frozen=True)
class Cover:
    """Appearance of a land use; colours are RGB 0..255.

    ``row_period_px`` and ``row_relief_px`` shape the rows, ``row_contrast`` their brightness; ``grain``, ``tufts``
    and ``patches`` are amplitudes of noise of 1..2 px, 4..16 px and 32..256 px; ``roughness_px`` is the relief of
    grain and tufts; ``tramline_px`` the spacing of wheel tracks (0: none).
    """

    first: tuple[float, float, float]
    second: tuple[float, float, float]
    row_period_px: float
    row_contrast: float
    row_relief_px: float
    grain: float
    tufts: float
    patches: float
    roughness_px: float
    tramline_px: float = 0


COVERS = {
    "verge": Cover((114, 114, 78), (136, 128, 96), 20, 0, 0, 0.14, 0.10, 0.6, 0.45),
    "meadow": Cover((102, 108, 68), (122, 120, 80), 38, 0.06, 0, 0.14, 0.05, 0.7, 0.35),
    "pasture": Cover((96, 104, 64), (122, 118, 82), 30, 0, 0, 0.13, 0.09, 0.8, 0.45),
    "cereal": Cover((86, 100, 60), (102, 110, 68), 6.5, 0.10, 0.6, 0.12, 0.04, 0.6, 0.3, 118),
    "ripe": Cover((178, 154, 106), (156, 138, 92), 6, 0.06, 0.4, 0.09, 0.04, 0.7, 0.3, 140),
    "stubble": Cover((172, 154, 116), (150, 136, 102), 36, 0.09, 0.3, 0.11, 0.05, 0.6, 0.3),
    "soil": Cover((132, 110, 88), (112, 94, 76), 9, 0.06, 0.9, 0.10, 0.05, 0.8, 0.6),
    "orchard": Cover((104, 108, 72), (128, 120, 90), 34, 0.10, 0, 0.13, 0.07, 0.7, 0.4),
    "wood": Cover((70, 78, 48), (92, 84, 58), 20, 0, 0, 0.14, 0.20, 0.7, 0.8),
    "scrub": Cover((112, 112, 78), (136, 126, 98), 20, 0, 0, 0.15, 0.12, 0.9, 0.6),
    "lot": Cover((100, 108, 68), (118, 116, 80), 12, 0.04, 0, 0.12, 0.06, 0.7, 0.3),
    "garden": Cover((98, 106, 66), (124, 110, 84), 14, 0.10, 0.6, 0.13, 0.12, 1.0, 0.6),
    "yard": Cover((152, 144, 132), (132, 124, 110), 20, 0, 0, 0.09, 0.07, 0.8, 0.25),
}
"""Appearance of each land use; colours also vary from parcel to parcel."""

_GRASS = bgr(108, 110, 74)
_RUBBLE = bgr(148, 138, 114)
_SHORE, _SHALLOW, _DEEP = bgr(112, 100, 78), bgr(92, 96, 74), bgr(48, 60, 56)
_MARKING = bgr(222, 220, 212)


@dataclass(frozen=True)
class Paving:
    """A road surface: its width, RGB colour and grain; marked roads have lines."""

    width_px: float
    colour: tuple[float, float, float]
    grain: float
    marked: bool = False


PAVINGS = {
    "gravel": Paving(22, (166, 155, 136), 0.10),
    "drive": Paving(18, (158, 148, 142), 0.07),
    "lane": Paving(27, (142, 140, 137), 0.05),
    "street": Paving(42, (132, 131, 130), 0.05, marked=True),
}
"""Each road surface, painted in this order."""


def paint_parcels(canvas: Canvas, parcels: Sequence[Parcel]) -> None:
    """Cover the whole canvas with parcels; their edges are ragged and overgrown."""
    height, width = canvas.relief.shape
    # Of the whole block: OpenCV fills other pixels along an edge that it cuts off.
    left, top = canvas.in_block
    plan = np.zeros(np.maximum([top + height, left + width], BLOCK_PX + 2 * MARGIN_PX), np.float32)
    for index, parcel in enumerate(parcels):
        cv2.fillPoly(plan, [np.rint(parcel.outline - canvas.block).astype(np.int32)], float(index))
    plan = plan[top : top + height, left : left + width]
    noise = canvas.noise
    columns = np.arange(width, dtype=np.float32)[np.newaxis, :]
    rows = np.arange(height, dtype=np.float32)[:, np.newaxis]
    source = columns + 2 * noise[3], rows + 2 * noise[4]
    plan = cv2.remap(plan, *source, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    table = np.array([_tabulate_parcel(parcel) for parcel in parcels], np.float32)
    labels = plan.astype(np.int32)
    for start in range(0, height, _STRIP_PX):
        strip = slice(start, start + _STRIP_PX)
        tone, share = _texture_parcels(canvas, strip, table[:, 6:], labels[strip])
        for channel in range(3):
            first = np.take(table[:, channel], labels[strip], mode="clip")
            second = np.take(table[:, 3 + channel], labels[strip], mode="clip")
            canvas.reflectance[channel, strip] = (first + (second - first) * share) * tone
    _grow_over_edges(canvas, labels)


def _tabulate_parcel(parcel: Parcel) -> tuple[float, ...]:
    """Make a parcel's row of the table: two colours, then the columns that `_texture_parcels` unpacks."""
    rng = np.random.default_rng(parcel.variety)
    cover = COVERS[parcel.use]
    brightness, hue = rng.normal(1, 0.08), 1 + rng.normal(0, 0.02, (3, 1, 1))
    first = (bgr(*cover.first) * brightness * hue).ravel()
    second = (bgr(*cover.second) * brightness * hue).ravel()
    direction = np.cos(parcel.angle_rad), np.sin(parcel.angle_rad)
    return (*first, *second, *direction, rng.uniform(0, 1000), *astuple(cover)[2:])


def _texture_parcels(canvas: Canvas, strip: slice, table: Plane, labels: NDArray[np.int32]) -> tuple[Plane, Plane]:
    """Paint the micro-relief of a strip, and return brightness and share of the second colour at each of its pixels."""
    noise = canvas.noise[:, strip]
    rows = np.arange(strip.start, strip.start + len(labels), dtype=np.float32)[:, np.newaxis]
    columns = np.arange(labels.shape[1], dtype=np.float32)[np.newaxis, :]
    cos, sin, offset, period, contrast, row_relief, grain, tufts, patches, roughness, tramline = (
        np.take(column, labels, mode="clip") for column in table.T
    )
    across = (rows + canvas.y_px) * cos - (columns + canvas.x_px) * sin + offset + 3 * noise[8]
    ridges = np.sin(across * (np.float32(2 * np.pi) / period)) * (0.8 + 0.4 * noise[3] + 0.3 * noise[5])
    fine = 0.8 * noise[0] + 0.7 * noise[1] + 0.4 * noise[2]
    coarse = 0.6 * noise[2] + 0.6 * noise[3] + 0.6 * noise[4] + 0.4 * noise[5]
    wide = 0.35 * noise[5] + 0.4 * noise[6] + 0.5 * noise[7] + 0.6 * noise[8]
    from_track = np.abs(np.mod(across, np.maximum(tramline, 1)) - 9)
    tracks = (tramline > 0) * np.clip(2.2 - np.abs(from_track - 6), 0, 1) * (0.7 + 0.3 * noise[3])
    tone = (1 + contrast * ridges + grain * fine + tufts * coarse) * (1 - 0.2 * tracks)
    canvas.relief[strip] = row_relief * (ridges - tracks) + roughness * (0.7 * fine + 0.7 * coarse)
    return np.maximum(tone, 0.1), np.clip(0.45 + 0.7 * patches * (wide + 0.15 * coarse) + 0.5 * tracks, 0, 1)


def _grow_over_edges(canvas: Canvas, labels: NDArray[np.int32]) -> None:
    """Grow grass on the strip between two parcels."""
    inside = np.ones(labels.shape, np.uint8)
    inside[:-1] &= labels[:-1] == labels[1:]
    inside[:, :-1] &= labels[:, :-1] == labels[:, 1:]
    distance = cv2.distanceTransform(inside, cv2.DIST_L2, 3)
    near = np.nonzero(distance < 16)
    noise = canvas.noise[:7, near[0], near[1]]
    strip = np.clip((6 + 2.5 * noise[5] + 2 * noise[3] - distance[near]) / 2, 0, 1) * 0.85
    grass = _GRASS[..., 0] * (1 + 0.14 * noise[0] + 0.12 * noise[2] + 0.12 * noise[4] + 0.15 * noise[6])
    _lay_over_at(canvas, near, grass, strip)
    canvas.relief[near] += strip * (0.6 * noise[1] + 0.6 * noise[3])


def _lay_over_at(canvas: Canvas, where: tuple[NDArray[np.intp], ...], over: Plane, share: Plane) -> None:
    """`lay_over` at scattered pixels: ``over`` has shape (3, n), ``share`` (n,)."""
    for plane, colour in zip(canvas.reflectance, over, strict=True):
        under = plane[where]
        lay_over(under, colour, share)
        plane[where] = under


def paint_ponds(canvas: Canvas, ponds: Array) -> None:
    """Paint still water with an irregular, muddy shore."""
    for x, y, radius in ponds.tolist():
        window = canvas.window(x, y, 1.8 * radius)
        if window is None:
            continue
        across, down = canvas.offsets(window, x, y)
        noise = canvas.noise[:, *window]
        depth = 1 - np.sqrt(across**2 + down**2) / radius
        depth += 0.2 * noise[6] + 0.2 * noise[5] + 0.1 * noise[4] + 0.04 * noise[2]
        wet = np.clip(depth * radius / 2, 0, 1)
        water = _SHALLOW + (_DEEP - _SHALLOW) * np.clip(depth * 2.5, 0, 1) + 0.006 * noise[0] + 0.01 * noise[5]
        under = canvas.reflectance[:, *window]
        lay_over(under, _SHORE * (1 + 0.1 * noise[0] + 0.1 * noise[3]), np.clip(depth * 6 + 0.8, 0, 0.9))
        lay_over(under, water, wet)
        canvas.relief[window] *= 1 - wet


def paint_roads(canvas: Canvas, roads: Sequence[Road]) -> None:
    """Paint the roads of each surface, with rubble verges, worn wheel tracks, and markings on the streets."""
    for surface, paving in PAVINGS.items():
        lines = [_to_fixed_point(canvas, road.points) for road in roads if road.surface == surface]
        if not lines:
            continue
        centre = np.ones(canvas.relief.shape, np.uint8)
        cv2.polylines(centre, lines, False, 0, 1, cv2.LINE_8, _FIXED_POINT_BITS)
        # Distance from the centre line in half widths: 1 at the edge.
        aside = cv2.distanceTransform(centre, cv2.DIST_L2, 5) / (paving.width_px / 2)
        _pave(canvas, paving, aside)
    _paint_markings(canvas, [road.points for road in roads if PAVINGS[road.surface].marked])


def _pave(canvas: Canvas, paving: Paving, aside: Plane) -> None:
    near = np.nonzero(aside < 2)
    noise, aside = canvas.noise[:7, near[0], near[1]], aside[near]
    verge = np.clip((1.4 + 0.2 * noise[4] + 0.2 * noise[5] - aside) * 5, 0, 0.6)
    roadway = np.clip((1 + 0.02 * noise[3] + 0.03 * noise[5] - aside) * 12, 0, 1)
    wheels = np.exp(-(((aside - 0.5) / 0.16) ** 2))
    tone = 1 + paving.grain * (0.6 * noise[0] + 0.5 * noise[1] + 0.4 * noise[4] + 0.6 * noise[6]) + 0.05 * wheels
    _lay_over_at(canvas, near, _RUBBLE[..., 0] * (1 + 0.12 * noise[0] + 0.12 * noise[2]), verge)
    _lay_over_at(canvas, near, bgr(*paving.colour)[..., 0] * tone, roadway)
    canvas.relief[near] *= 1 - 0.9 * roadway


def _paint_markings(canvas: Canvas, centre_lines: Sequence[Points]) -> None:
    """Paint a dashed centre line and two edge lines, worn by noise."""
    paint = np.zeros(canvas.relief.shape, np.uint8)
    half_width_px = PAVINGS["street"].width_px / 2
    for points in (line[4:-4] for line in centre_lines):  # no markings at crossings
        steps = np.diff(points, axis=0)
        lengths = np.hypot(*steps.T)
        normals = (steps / lengths[:, np.newaxis])[:, ::-1] * (-1, 1)
        aside = 0.86 * half_width_px * np.vstack([normals, normals[-1:]])
        lines = [_to_fixed_point(canvas, points + aside), _to_fixed_point(canvas, points - aside)]
        along = np.concatenate([[0], np.cumsum(lengths)])
        dashes = np.arange(10, along[-1] - 20, 60)[:, np.newaxis] + (0, 20)
        ends = np.stack([np.interp(dashes, along, axis) for axis in points.T], axis=-1)
        lines += [_to_fixed_point(canvas, dash) for dash in ends]
        cv2.polylines(paint, lines, False, 255, 1, cv2.LINE_AA, _FIXED_POINT_BITS)
    painted = np.nonzero(paint)
    noise = canvas.noise[:, painted[0], painted[1]]
    worn = paint[painted] / np.float32(255) * np.clip(0.6 + 0.25 * noise[3] + 0.2 * noise[6], 0, 0.9)
    _lay_over_at(canvas, painted, np.broadcast_to(_MARKING[..., 0], (3, worn.size)), worn)


def _to_fixed_point(canvas: Canvas, points: Points) -> NDArray[np.int32]:
    return np.rint(canvas.local(points) * (1 << _FIXED_POINT_BITS)).astype(np.int32)
