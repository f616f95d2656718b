"""Paints objects on the ground: buildings, cars, trees and bushes."""

from collections.abc import Sequence

import numpy as np

from golden_model.arrays import Array
from sim.scene.canvas import Canvas, Plane, bgr, lay_over
from sim.scene.layout import Box

_TILE_ROOFS = (
    bgr(140, 90, 72), bgr(122, 78, 64), bgr(104, 84, 76), bgr(92, 94, 98),
    bgr(72, 74, 78), bgr(150, 110, 90), bgr(118, 110, 102),
)  # fmt: skip
_SHEET_ROOFS = (bgr(168, 172, 174), bgr(134, 142, 146), bgr(112, 122, 112), bgr(140, 112, 100), bgr(186, 186, 182))
_CARS = (
    bgr(224, 224, 222), bgr(30, 32, 36), bgr(142, 146, 150), bgr(84, 88, 94),
    bgr(128, 38, 36), bgr(44, 64, 108), bgr(196, 188, 172), bgr(60, 78, 66),
)  # fmt: skip
_GLASS, _WINDSCREEN, _BRICK = bgr(70, 84, 100), bgr(34, 38, 44), bgr(120, 96, 84)
_DARK_LEAVES, _BRIGHT_LEAVES = bgr(60, 76, 44), bgr(116, 124, 68)


def paint_boxes(canvas: Canvas, boxes: Sequence[Box]) -> None:
    """Buildings and cars: a rotated rectangle each, with its roof in the relief."""
    for box in boxes:
        x, y = box.centre.tolist()
        window = canvas.window(x, y, 0.5 * np.hypot(box.length_px, box.width_px) + 2)
        if window is None:
            continue
        across, down = canvas.offsets(window, x, y)
        cos, sin = np.float32(np.cos(box.angle_rad)), np.float32(np.sin(box.angle_rad))
        u, v = across * cos + down * sin, down * cos - across * sin
        inside = np.minimum(box.length_px / 2 - np.abs(u), box.width_px / 2 - np.abs(v))
        paint = _paint_car if box.kind == "car" else _paint_building
        height, colour = paint(box, u, v, canvas.noise[:, *window])
        relief = canvas.relief[window]
        share: Plane = np.multiply(np.clip(inside + 0.5, 0, 1), height >= relief)
        lay_over(canvas.reflectance[:, *window], colour, share)
        np.copyto(relief, height, where=share > 0.5)


def _paint_building(box: Box, u: Plane, v: Plane, noise: Plane) -> tuple[Plane, Plane]:
    """Relief and colour of a gable or hip roof with courses, ridge and stains; houses have skylights and a chimney."""
    rng = np.random.default_rng(box.variety)
    tiled = box.kind == "house"
    from_eaves = box.width_px / 2 - np.abs(v)
    if tiled and rng.random() < 0.4:
        from_eaves = np.minimum(from_eaves, box.length_px / 2 - np.abs(u))
    pitch = rng.uniform(0.45, 0.75) if tiled else rng.uniform(0.15, 0.4)
    roofs = _TILE_ROOFS if tiled else _SHEET_ROOFS
    colour = roofs[rng.integers(len(roofs))] * np.float32(rng.uniform(0.85, 1.15))
    courses = np.sin(from_eaves * 2.1) if tiled else np.sin(u * 0.8)
    tone = 1 + 0.04 * courses + 0.05 * noise[0] + 0.06 * noise[2] + 0.07 * noise[4] + 0.05 * noise[5]
    tone *= np.where(from_eaves > box.width_px / 2 - 1.5, 1.15, 1) * np.where(from_eaves < 2, 0.82, 1)
    height = box.height_px + pitch * from_eaves + 0.25 * courses
    painted = colour * tone
    if tiled:
        size = np.array([box.length_px, box.width_px])
        for at_u, at_v in size * rng.uniform(-0.4, 0.4, (rng.integers(0, 5), 2)):
            lay_over(painted, _GLASS, (np.abs(u - at_u) < 3.5) & (np.abs(v - at_v) < 4.5))
        at_u, at_v = size * rng.uniform((-0.35, -0.15), (0.35, 0.15))
        chimney = (np.abs(u - at_u) < 3.2) & (np.abs(v - at_v) < 2.6)
        lay_over(painted, _BRICK * (1 + 0.1 * noise[0]), chimney)
        height += 8 * chimney
    return height.astype(np.float32, copy=False), painted


def _paint_car(box: Box, u: Plane, v: Plane, noise: Plane) -> tuple[Plane, Plane]:
    """Relief and colour of a car: bonnet, dark windows round a roof, slightly domed."""
    rng = np.random.default_rng(box.variety)
    u = u / (box.length_px / 2) + rng.uniform(-0.05, 0.05)
    v = v / (box.width_px / 2)
    cabin = (np.abs(u + 0.12) < 0.55) & (np.abs(v) < 0.9)
    roof = (np.abs(u + 0.16) < 0.33) & (np.abs(v) < 0.72)
    painted = _CARS[rng.integers(len(_CARS))] * (1 + 0.03 * noise[1])
    lay_over(painted, _WINDSCREEN, cabin & ~roof)
    return (box.height_px * (0.62 + 0.38 * cabin) - 1.5 * v**2 - 0.8 * u**2).astype(np.float32), painted


def paint_plants(canvas: Canvas, plants: Array) -> None:
    """Crowns with lobes and clumps of leaves: domes, cut and roughened by the noise at their position."""
    # Most are far away.
    from_edge = canvas.local(plants[:, :2]), canvas.relief.shape[::-1] - canvas.local(plants[:, :2])
    near = np.min(from_edge, axis=(0, 2)) > -1.35 * plants[:, 2] - 2
    for x, y, radius, height, tone in plants[near].tolist():
        window = canvas.window(x, y, 1.35 * radius)
        if window is None:
            continue
        across, down = canvas.offsets(window, x, y)
        noise = canvas.noise[:, *window]
        dome = 1 - (across**2 + down**2) / np.float32(radius * radius) + 0.16 * noise[2] + 0.18 * noise[3]
        if radius > 9:
            dome += 0.16 * noise[4]
        clumps = (0.7 * noise[1] + 1.0 * noise[2] + 1.2 * noise[3]) * min(1.0, radius / 14)
        crown = height * np.sqrt(np.clip(dome, 0, 1)) + clumps
        relief = canvas.relief[window]
        standing = (dome > 0.04) & (crown > relief)
        leaves = _DARK_LEAVES + (_BRIGHT_LEAVES - _DARK_LEAVES) * np.float32(tone)
        leaves = leaves * (1 + 0.16 * noise[0] + 0.14 * noise[1] + 0.12 * noise[2] + 0.25 * (dome - 0.6))
        np.copyto(canvas.reflectance[:, *window], leaves, where=standing)
        np.copyto(relief, crown, where=standing)
