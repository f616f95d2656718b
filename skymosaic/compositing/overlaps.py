"""Brightness of the same ground in different photographs of a flight, compared cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Float32
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.warp import Canvas, footprint
from skymosaic.geometry.homography import apply

CELL_PX = 8
"""Photographs are compared by means over square cells of the reduced canvas; parallax blurs single pixels."""
MAX_CELLS_PER_PAIR = 60
"""At most so many cells of an overlap are compared, spread evenly; more add time but no accuracy."""
MIN_LEVEL, MAX_LEVEL = 4 / 255, 250 / 255
"""Cells with a pixel outside these shares of white are left out: what is clipped says nothing about the exposure."""


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Compared cells, N of them.

    Attributes
    ----------
    i, j : ndarray of int, shape (N,)
        The two photographs of each.
    difference : ndarray of float64, shape (N, 3)
        Logarithms of the channels in j less those in i.
    at_i, at_j : ndarray of float64, shape (N, 2)
        The cell's place in each photograph, from (0, 0) at the first pixel to (1, 1) at the last one.
    falloff : ndarray of float64, shape (N, 2)
        r^2 and r^4 in i less those in j, with r the distance from the photograph's centre in half diagonals.
    pair : ndarray of int, shape (N,)
        Counts pairs of photographs.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    difference: Array
    at_i: Array
    at_j: Array
    falloff: Array
    pair: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class _Cells:
    """Means of the cells of one photograph."""

    window: Canvas
    logs: Float32  # (h, w, 3) logarithms of the channels
    places: Array  # (h, w, 2), see Overlaps.at_i
    squared_radius: Array  # (h, w)
    valid: NDArray[np.bool_]


def compare_overlaps(thumbnails: Sequence[Layer], black: float, white: float) -> Overlaps:
    """Compare all photographs that overlap.

    Parameters
    ----------
    thumbnails : sequence of Layer
        On a reduced canvas, all BGR, without tones.
    black, white : float
        The numbers that the camera gives to black and to white.
    """
    cells = [_cells(layer, black, white) for layer in thumbnails]
    parts: list[tuple[Array, ...]] = []
    for i, j in combinations(range(len(cells)), 2):
        common = cells[i].window.intersection(cells[j].window)
        if common is None:
            continue
        inside = [common.within(cells[k].window) for k in (i, j)]
        both = np.flatnonzero(cells[i].valid[inside[0]] & cells[j].valid[inside[1]])
        if len(both) == 0:
            continue
        both = both[np.linspace(0, len(both) - 1, min(len(both), MAX_CELLS_PER_PAIR)).astype(np.intp)]
        logs, places, squared = (
            [
                getattr(cells[k], name)[where].reshape(common.height_px * common.width_px, -1)[both]
                for k, where in zip((i, j), inside, strict=True)
            ]
            for name in ("logs", "places", "squared_radius")
        )
        falloff = np.column_stack((squared[0] - squared[1], squared[0] ** 2 - squared[1] ** 2))
        ends = [np.full(len(both), end) for end in (i, j, len(parts))]
        parts.append((ends[0], ends[1], logs[1] - logs[0], places[0], places[1], falloff, ends[2]))
    if not parts:
        none, no_pairs, no_counts = np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0, dtype=np.intp)
        return Overlaps(no_counts, no_counts, none, no_pairs, no_pairs, no_pairs, no_counts)
    first, second, difference, at_i, at_j, falloff, pair = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Overlaps(first, second, difference.astype(np.float64), at_i, at_j, falloff, pair)


def _cells(layer: Layer, black: float, white: float) -> _Cells:
    """Cell means on a grid that all photographs share."""
    part = footprint(layer.size, layer.transform)
    x, y = -(-part.x_px // CELL_PX), -(-part.y_px // CELL_PX)
    width, height = (part.x_px + part.width_px) // CELL_PX - x, (part.y_px + part.height_px) // CELL_PX - y
    window = Canvas(x, y, max(width, 1), max(height, 1))
    pixels = Canvas(CELL_PX * x, CELL_PX * y, CELL_PX * window.width_px, CELL_PX * window.height_px)
    shown = layer.pixels(pixels, cv2.INTER_LINEAR)
    least, most = ((black + share * (white - black),) * 3 for share in (MIN_LEVEL, MAX_LEVEL))
    usable = (layer.border_distance(pixels) > 0) & (cv2.inRange(shown, least, most) > 0)
    size = (window.width_px, window.height_px)
    means = cv2.resize(shown.astype(np.float32), size, interpolation=cv2.INTER_AREA) - np.float32(black)
    valid = cv2.resize(usable.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 1 - 1e-3
    columns, rows = (CELL_PX * (first + np.arange(count) + 0.5) - 0.5 for first, count in ((x, size[0]), (y, size[1])))
    centres = np.stack(np.meshgrid(columns, rows), axis=-1)
    places = apply(np.asarray(np.linalg.inv(layer.transform)), centres)
    last = np.array(layer.size) - 1
    squared_radius = ((places - last / 2) ** 2).sum(axis=-1) / ((np.array(layer.size) ** 2).sum() / 4)
    return _Cells(window, np.log(np.maximum(means, 1)), places / last, squared_radius, np.asarray(valid))
