"""Exposure of a flight: the tone of each photograph that makes all of them agree where they overlap.

The logarithm of an intensity is what was on the ground plus the photograph's exposure plus the lens falloff, so the
unknowns enter linearly. Least squares on the gains themselves (Brown and Lowe 2007, equation 29) pulls them towards
zero, because darker pictures always differ less; differences of logarithms have no such bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Float32, Intensities
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.tone import NEUTRAL, SHOULDER_START, Tone, radius_of
from skymosaic.compositing.warp import Canvas, footprint
from skymosaic.imagery.depth import TAIL_PERCENT, ValueRange

CELL_PX = 8
"""Photographs are compared by means over square cells of the reduced canvas; parallax blurs single pixels."""
CELLS_A_PAIR = 100
"""At most so many cells of an overlap are compared, spread evenly; more add time but no accuracy."""
DARKEST, BRIGHTEST = 4, 250
"""Cells with a pixel outside these are left out: what is clipped says nothing about the exposure."""
LOG_SIGMA = 0.08
"""Expected difference of two cells that show the same ground, as a logarithm; larger ones count less."""
EXPOSURE_SIGMA, BALANCE_SIGMA = 0.7, 0.05
"""Expected spread of the exposures, and of the channels of a photograph around its exposure."""
CELLS_OF_PRIOR = 4
"""The weight of these expectations, in cells: enough for photographs without an overlap, too little to bend a strip."""
FALLOFF_SIGMA = 0.3
ROUNDS = 5
NEARLY_WHITE, MORE_WHITE = 240, 0.01
"""Gray level from which ground looks white, and the share of pixels that may become so."""
DARKER_STEP, DARKER_STEPS = 0.04, 4
"""How far all photographs are darkened for that: 15 % at most, then the shoulder of the tones has to do."""
NOT_WHITE = 64_000
"""Values of 16 bits below this are not white: a camera of 10 bits has no more than 65,472."""
HELD_OUT_GAIN = 0.99
"""A lens falloff is used if it lowers the median difference in overlaps it was not fitted to below this share."""


@dataclass(frozen=True, eq=False)
class _Cells:
    """Means of the cells of one photograph."""

    window: Canvas
    logs: Float32  # (h, w, 3) logarithms of the channels
    radius: Float32  # (h, w), half diagonals
    valid: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Overlaps:
    """Compared cells: photographs i and j, the difference of their logarithms (N, 3), and radius functions (N, 2)."""

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    difference: Array
    falloff: Array
    pair: NDArray[np.intp]


def exposure_tones(thumbnails: Sequence[Layer]) -> list[Tone]:
    """The tone of each photograph.

    Parameters
    ----------
    thumbnails : sequence of Layer
        The photographs on a reduced canvas, all BGR, without tones.

    Returns
    -------
    list of Tone
        Scaled so that the median photograph keeps its brightness, or up to 15 % less where ground would turn white.
        Neutral for photographs that overlap no other.
    """
    cells = [_cells(layer) for layer in thumbnails]
    overlaps = _overlaps(cells)
    exposure, falloff = _exposures(overlaps, len(cells))
    balance = _balance(overlaps, len(cells))
    logs = exposure[:, None] + balance
    joined = np.unique(np.concatenate((overlaps.i, overlaps.j))).tolist()
    tones = [NEUTRAL] * len(cells)
    if joined:
        for index, tone in zip(joined, _agreeing([thumbnails[k] for k in joined], logs[joined], falloff), strict=True):
            tones[index] = tone
    return tones


def _agreeing(thumbnails: Sequence[Layer], logs: Array, falloff: Array) -> list[Tone]:
    """The tones with these logarithms of the gains (V, 3), scaled together."""
    kept = [_brightness_kept(layer, tone) for layer, tone in zip(thumbnails, _tones(logs, falloff), strict=True)]
    return _without_burning(thumbnails, logs - np.log(np.median(kept)), falloff)


def deep_tones(
    tones: Sequence[Tone], samples: Sequence[NDArray[np.generic]], values: ValueRange
) -> tuple[list[Tone], ValueRange]:
    """The tones for photographs of 16 bits, and the range that their toned values have.

    A camera that exposes each photograph for itself leaves no room for the differences that the tones restore: all
    values are made smaller together where 16 bits would not hold them.

    Parameters
    ----------
    tones : sequence of Tone
        From `exposure_tones`.
    samples : sequence of ndarray of uint16, shape (N,)
        Values of each photograph.
    values : ValueRange
        Of all photographs as they were taken; its lower end counts as black.
    """
    # What was white in a photograph stays white and takes no room.
    reached = [
        values.low + np.mean(tone.gain) * (sample[sample < NOT_WHITE] - values.low)
        for tone, sample in zip(tones, (sample.astype(np.float64) for sample in samples), strict=True)
    ]
    low, high = np.percentile(np.concatenate(reached), (TAIL_PERCENT, 100 - TAIL_PERCENT))
    room = SHOULDER_START * (np.iinfo(np.uint16).max - values.low)
    factor = min(1.0, room / max(high - values.low, 1.0))
    low, high = (float(values.low + factor * (end - values.low)) for end in (low, high))
    darker = [replace(tone, gain=tuple(factor * gain for gain in tone.gain), black=values.low) for tone in tones]
    return darker, replace(values, low=low, high=high)


def _without_burning(thumbnails: Sequence[Layer], logs: Array, falloff: Array) -> list[Tone]:
    """The tones, darkened a little together where they would turn more ground white than the photographs show.

    A camera that exposes for bright ground makes it as dark as the rest; its gain then lifts it beyond white.
    """
    unchanged = np.mean([_white_share(layer, NEUTRAL) for layer in thumbnails])
    tones = _tones(logs, falloff)
    for _ in range(DARKER_STEPS):
        white = np.mean([_white_share(layer, tone) for layer, tone in zip(thumbnails, tones, strict=True)])
        if white <= unchanged + MORE_WHITE:
            break
        logs = logs - DARKER_STEP
        tones = _tones(logs, falloff)
    return tones


def _white_share(layer: Layer, tone: Tone) -> float:
    return float(cv2.inRange(_toned(layer, tone), (NEARLY_WHITE,) * 3, (255,) * 3).mean() / 255)


def _toned(layer: Layer, tone: Tone) -> Intensities:
    """The whole photograph with a tone."""
    return tone.applied(layer.image, radius_of(layer.size, Canvas(0, 0, *layer.size)))


def _tones(logs: Array, falloff: Array) -> list[Tone]:
    first, second = falloff.tolist()
    return [Tone(tuple(np.exp(row).tolist()), (first, second)) for row in logs]


def _cells(layer: Layer) -> _Cells:
    """Cell means on a grid that all photographs share."""
    part = footprint(layer.size, layer.transform)
    x, y = -(-part.x_px // CELL_PX), -(-part.y_px // CELL_PX)
    width, height = (part.x_px + part.width_px) // CELL_PX - x, (part.y_px + part.height_px) // CELL_PX - y
    window = Canvas(x, y, max(width, 1), max(height, 1))
    pixels = Canvas(CELL_PX * x, CELL_PX * y, CELL_PX * window.width_px, CELL_PX * window.height_px)
    shown = layer.pixels(pixels)
    usable = (layer.border_distance(pixels) > 0) & (cv2.inRange(shown, (DARKEST,) * 3, (BRIGHTEST,) * 3) > 0)
    size = (window.width_px, window.height_px)
    means = cv2.resize(shown.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    valid = cv2.resize(usable.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 1 - 1e-3
    radius = cv2.resize(layer.radius(pixels), size, interpolation=cv2.INTER_AREA)
    return _Cells(window, np.log(np.maximum(means, 1)), np.asarray(radius, dtype=np.float32), np.asarray(valid))


def _overlaps(cells: Sequence[_Cells]) -> _Overlaps:
    parts: list[tuple[NDArray[np.intp], NDArray[np.intp], Array, Array, NDArray[np.intp]]] = []
    for i, j in combinations(range(len(cells)), 2):
        common = cells[i].window.intersection(cells[j].window)
        if common is None:
            continue
        in_i, in_j = common.within(cells[i].window), common.within(cells[j].window)
        both = np.flatnonzero(cells[i].valid[in_i] & cells[j].valid[in_j])
        if len(both) == 0:
            continue
        both = both[np.linspace(0, len(both) - 1, min(len(both), CELLS_A_PAIR)).astype(np.intp)]
        logs = [cell.logs[where].reshape(-1, 3)[both] for cell, where in ((cells[i], in_i), (cells[j], in_j))]
        squared = [cell.radius[where].ravel()[both] ** 2 for cell, where in ((cells[i], in_i), (cells[j], in_j))]
        parts.append(
            (
                np.full(len(both), i),
                np.full(len(both), j),
                np.asarray(logs[1] - logs[0], dtype=np.float64),
                np.stack([squared[0] - squared[1], squared[0] ** 2 - squared[1] ** 2], axis=1).astype(np.float64),
                np.full(len(both), len(parts)),
            )
        )
    if not parts:
        none = np.zeros(0, dtype=np.intp)
        return _Overlaps(none, none, np.zeros((0, 3)), np.zeros((0, 2)), none)
    return _Overlaps(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _exposures(overlaps: _Overlaps, number: int) -> tuple[Array, Array]:
    """Logarithmic exposure of each photograph, and the falloff of the lens where it explains held-out overlaps."""
    difference = overlaps.difference.mean(axis=1)
    none = np.zeros((len(difference), 0))
    odd = overlaps.pair % 2 == 1
    if odd.any() and not odd.all():
        held_out = []
        for columns in (none, overlaps.falloff):
            fitted = _solved(overlaps, difference, columns, number, ~odd)
            residual = difference - _predicted(overlaps, columns, fitted, number)
            held_out.append(np.median(np.abs(residual[odd])))
        if held_out[1] < HELD_OUT_GAIN * held_out[0]:
            fitted = _solved(overlaps, difference, overlaps.falloff, number, np.ones_like(odd))
            return fitted[:number], fitted[number:]
    return _solved(overlaps, difference, none, number, np.ones_like(odd)), np.zeros(2)


def _balance(overlaps: _Overlaps, number: int) -> Array:
    """Logarithmic gain of each channel against the photograph's exposure, (number, 3)."""
    none = np.zeros((len(overlaps.i), 0))
    everything = np.ones(len(overlaps.i), dtype=np.bool_)
    beyond = overlaps.difference - overlaps.difference.mean(axis=1, keepdims=True)
    return np.stack(
        [_solved(overlaps, beyond[:, channel], none, number, everything, spread=BALANCE_SIGMA) for channel in range(3)],
        axis=1,
    )


def _predicted(overlaps: _Overlaps, columns: Array, fitted: Array, number: int) -> Array:
    return np.asarray(fitted[overlaps.i] - fitted[overlaps.j] + columns @ fitted[number:])


def _solved(
    overlaps: _Overlaps,
    difference: Array,
    columns: Array,
    number: int,
    used: NDArray[np.bool_],
    *,
    spread: float = EXPOSURE_SIGMA,
) -> Array:
    """Robust least squares: unknowns of the photographs, then those of ``columns``.

    Iteratively reweighted with Geman and McClure's weights: moving things and parallax differ by more than exposure.
    """
    unknowns = number + columns.shape[1]
    prior = np.concatenate(
        [np.full(number, CELLS_OF_PRIOR / spread**2), np.full(columns.shape[1], 1 / FALLOFF_SIGMA**2)]
    )
    i, j, rows, wanted = overlaps.i[used], overlaps.j[used], columns[used], difference[used]
    weight = np.full(len(wanted), 1 / LOG_SIGMA**2)
    fitted = np.zeros(unknowns)
    for _ in range(ROUNDS):
        system = np.zeros((unknowns, unknowns))
        np.add.at(system, (i, i), weight)
        np.add.at(system, (j, j), weight)
        np.add.at(system, (i, j), -weight)
        np.add.at(system, (j, i), -weight)
        target = np.bincount(i, weight * wanted, unknowns) - np.bincount(j, weight * wanted, unknowns)
        for column in range(columns.shape[1]):
            share = weight * rows[:, column]
            cross = np.bincount(i, share, number) - np.bincount(j, share, number)
            system[number + column, :number] = system[:number, number + column] = cross
            system[number + column, number:] = rows.T @ share
            target[number + column] = share @ wanted
        fitted = np.linalg.solve(system + np.diag(prior), target)
        residual = wanted - (fitted[i] - fitted[j] + rows @ fitted[number:])
        weight = 1 / LOG_SIGMA**2 / (1 + (residual / LOG_SIGMA) ** 2) ** 2
    return np.asarray(fitted)


def _brightness_kept(layer: Layer, tone: Tone) -> float:
    """Mean intensity of the toned photograph against the photograph's."""
    return float(_toned(layer, tone).mean() / max(layer.image.mean(), 1e-6))
