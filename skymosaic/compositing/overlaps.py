"""Compares the brightness of the same ground in different photographs of a flight, cell by cell."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Float32
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.tone import SHADING_TERMS, shading_terms
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply

CELL_PX = 8
"""Photographs are compared by means over square cells of the reduced canvas, because parallax shifts single pixels."""
MAX_CELLS_PER_PAIR = 60
"""Compared cells of an overlap, spread evenly; more add time but no accuracy."""
MIN_LEVEL, MAX_LEVEL = 4 / 255, 250 / 255
"""Cells with a pixel outside these shares of white are left out: clipped pixels say nothing about the exposure."""


class Overlaps(NamedTuple):
    """N cells that two photographs show."""

    i: NDArray[np.int32]
    j: NDArray[np.int32]
    """(N,): the two photographs of each cell."""
    difference: Float32
    """(N, 3): logarithms of the channels in j less those in i."""
    at_i: Float32
    at_j: Float32
    """(N, 2): the cell's place in each photograph, from (0, 0) at the first pixel to (1, 1) at the last one."""
    shading: Float32
    """(N, 4): `skymosaic.compositing.tone.shading_terms` in i less those in j."""
    pair: NDArray[np.int32]
    """(N,): number of the pair of photographs, from 0."""


@dataclass(frozen=True, eq=False)
class _Cells:
    """The cells of one photograph."""

    layer: Layer
    window: Canvas  # on the grid of cells
    logs: Float32  # (h, w, 3) logarithms of the channels' means
    valid: NDArray[np.bool_]

    def locate(self, cells: NDArray[np.intp]) -> tuple[Float32, Float32]:
        """The places of cells (N, 2) in the photograph (N, 2), see `Overlaps.at_i`, and the shading there (N, 4)."""
        size = self.layer.size
        points = apply(np.asarray(np.linalg.inv(self.layer.transform)), CELL_PX * (cells + 0.5) - 0.5)
        places = points / (np.array(size) - 1)
        return places.astype(np.float32), shading_terms(points, size).astype(np.float32)


def compare_overlaps(thumbnails: Sequence[Layer], black: float, white: float) -> Overlaps:
    """Compare all photographs that overlap; arguments as of `skymosaic.compositing.exposure.estimate_tones`."""
    cells = [_measure_cells(layer, black, white) for layer in thumbnails]
    windows = [each.window for each in cells]
    pairs = meeting_pairs(windows)
    overlaps = _reserve(MAX_CELLS_PER_PAIR * len(pairs))
    end = number = 0
    for i, j in pairs:
        common = windows[i].intersection(windows[j])
        assert common is not None
        in_i, in_j = common.within(windows[i]), common.within(windows[j])
        both = np.argwhere(cells[i].valid[in_i] & cells[j].valid[in_j])
        rows, columns = both[np.linspace(0, len(both) - 1, min(len(both), MAX_CELLS_PER_PAIR)).astype(np.intp)].T
        if len(rows) == 0:
            continue
        part = slice(end, end + len(rows))
        overlaps.i[part], overlaps.j[part], overlaps.pair[part] = i, j, number
        overlaps.difference[part] = (cells[j].logs[in_j] - cells[i].logs[in_i])[rows, columns]
        chosen = np.column_stack((columns + common.x_px, rows + common.y_px))
        overlaps.at_i[part], terms_i = cells[i].locate(chosen)
        overlaps.at_j[part], terms_j = cells[j].locate(chosen)
        overlaps.shading[part] = terms_i - terms_j
        end, number = part.stop, number + 1
    return Overlaps._make(column[:end] for column in overlaps)


def meeting_pairs(windows: Sequence[Canvas]) -> list[tuple[int, int]]:
    """The pairs of rectangles that overlap, each (i, j) with i < j."""
    first = np.array([(window.x_px, window.y_px) for window in windows]).reshape(-1, 2)
    last = first + np.array([(window.width_px, window.height_px) for window in windows]).reshape(-1, 2)
    pairs = []
    for i in range(len(windows)):
        meets = ((first[i + 1 :] < last[i]) & (last[i + 1 :] > first[i])).all(axis=1)
        pairs += [(i, i + 1 + int(later)) for later in np.flatnonzero(meets)]
    return pairs


def _reserve(count: int) -> Overlaps:
    """Room for so many cells; what is never written takes no memory."""
    i, j, pair = (np.empty(count, np.int32) for _ in range(3))
    difference, at_i, at_j, shading = (np.empty((count, columns), np.float32) for columns in (3, 2, 2, SHADING_TERMS))
    return Overlaps(i, j, difference, at_i, at_j, shading, pair)


def _measure_cells(layer: Layer, black: float, white: float) -> _Cells:
    """Average a photograph over the cells of a grid that all photographs share."""
    part = layer.footprint
    x, y = -(-part.x_px // CELL_PX), -(-part.y_px // CELL_PX)
    width, height = (part.x_px + part.width_px) // CELL_PX - x, (part.y_px + part.height_px) // CELL_PX - y
    window = Canvas(x, y, max(width, 1), max(height, 1))
    pixels = Canvas(CELL_PX * x, CELL_PX * y, CELL_PX * window.width_px, CELL_PX * window.height_px)
    shown = layer.pixels(pixels, cv2.INTER_LINEAR)
    least, most = ((black + share * (white - black),) * 3 for share in (MIN_LEVEL, MAX_LEVEL))
    usable = (layer.border_distance(pixels) > 0) & (cv2.inRange(shown, least, most) > 0)
    size = (window.width_px, window.height_px)
    means = cv2.resize(shown.astype(np.float32), size, interpolation=cv2.INTER_AREA) - np.float32(black)
    # Every pixel of a cell has to be usable; averaging rounds.
    valid = cv2.resize(usable.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 1 - 1e-3
    return _Cells(layer, window, np.log(np.maximum(means, 1)), np.asarray(valid))
