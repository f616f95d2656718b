"""Exposure of a flight: the tone of each photograph that makes all of them agree where they overlap.

The logarithm of an intensity is what was on the ground plus the photograph's exposure plus the lens falloff, so the
unknowns enter linearly. Least squares on the gains themselves (Brown and Lowe 2007, equation 29) pulls them towards
zero, because darker pictures always differ less; differences of logarithms have no such bias. What exposures leave is
described by a smooth field of light on each photograph, see `skymosaic.compositing.light`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Intensities
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.light import LOG_SIGMA, estimate_light
from skymosaic.compositing.overlaps import Overlaps, compare_overlaps
from skymosaic.compositing.tone import NEUTRAL, SHOULDER_START, Tone
from skymosaic.compositing.warp import Canvas
from skymosaic.imagery.depth import TAIL_PERCENT, ValueRange

EXPOSURE_SIGMA, BALANCE_SIGMA = 0.7, 0.05
"""Expected spread of the exposures, and of the channels of a photograph around its exposure."""
CELLS_OF_PRIOR = 4
"""The weight of these expectations, in cells: enough for photographs without an overlap, too little to bend a strip."""
FALLOFF_SIGMA = 0.3
ROUNDS = 5
NEARLY_WHITE = 250 / 255
MORE_WHITE = 0.0005
"""Share of white from which ground looks white, and the share of pixels that may become so."""
SHOULDERS = (SHOULDER_START, 160 / 255, 120 / 255, 80 / 255)
"""Shoulders that are tried until no more pixels become white than that; the last one stays where none is enough."""
ANCHORINGS = 3
"""How often all gains are scaled together: highlights that are compressed make the photographs darker again."""
HELD_OUT_GAIN = 0.99
"""A lens falloff is used if it lowers the median difference in overlaps it was not fitted to below this share."""


@dataclass(frozen=True)
class Levels:
    """What the camera's numbers mean, where photographs have 16 bits.

    Attributes
    ----------
    black : float
        The number of no light.
    white : float
        The largest number.
    """

    black: float = 0.0
    white: float = 255.0


def estimate_levels(samples: Sequence[NDArray[np.generic]], blacks: Sequence[float | None]) -> Levels:
    """The levels of photographs of 16 bits.

    Parameters
    ----------
    samples : sequence of ndarray of uint16
        Values of each photograph.
    blacks : sequence of float or None
        What the camera wrote as its black level into each; without it, black is 0.
    """
    least, most = min(sample.min() for sample in samples), max(sample.max() for sample in samples)
    known = [black for black in blacks if black is not None]
    # Cameras of 10 to 14 bits fill the lower bits of their numbers, or the upper ones.
    return Levels(
        min(float(np.median(known)), float(least)) if known else 0.0, float((1 << int(most).bit_length()) - 1)
    )


def estimate_tones(thumbnails: Sequence[Layer], levels: Levels = Levels()) -> list[Tone]:
    """The tone of each photograph.

    Parameters
    ----------
    thumbnails : sequence of Layer
        The photographs on a reduced canvas, all BGR, without tones.
    levels : Levels

    Returns
    -------
    list of Tone
        Scaled so that the median photograph keeps its brightness, with a shoulder that turns no more ground white
        than the photographs show. Neutral for photographs that overlap no other.
    """
    number = len(thumbnails)
    overlaps = compare_overlaps(thumbnails, levels.black, levels.white)
    exposure, falloff = _exposures(overlaps, number)
    logs = exposure[:, None] + _balance(overlaps, number)
    explained = logs[overlaps.i] - logs[overlaps.j] + (overlaps.falloff @ falloff)[:, None]
    light = estimate_light(overlaps, overlaps.difference - explained, number)
    joined = np.unique(np.concatenate((overlaps.i, overlaps.j))).tolist()
    tones = [NEUTRAL] * number
    for index in joined:
        own = None if light is None else light[index]
        gain = tuple(np.exp(logs[index]).tolist())
        tones[index] = Tone(gain, (float(falloff[0]), float(falloff[1])), levels.black, own)
    if joined:
        together = _anchored([thumbnails[index] for index in joined], [tones[index] for index in joined])
        for index, tone in zip(joined, together, strict=True):
            tones[index] = tone
    return tones


def measure_toned_range(
    tones: Sequence[Tone], samples: Sequence[NDArray[np.generic]], values: ValueRange
) -> ValueRange:
    """The range that photographs of 16 bits have with their tones.

    Parameters
    ----------
    tones : sequence of Tone
    samples : sequence of ndarray of uint16, shape (N,)
        Values of each photograph.
    values : ValueRange
        Of all photographs as they were taken.
    """
    toned = [tone.apply(np.asarray(sample, np.uint16)[:, None]) for tone, sample in zip(tones, samples, strict=True)]
    low, high = np.percentile(np.concatenate(toned), (TAIL_PERCENT, 100 - TAIL_PERCENT))
    return replace(values, low=float(low), high=float(high))


def _anchored(thumbnails: Sequence[Layer], tones: Sequence[Tone]) -> list[Tone]:
    """The tones, scaled together so that the median photograph keeps its brightness, and with a common shoulder."""
    unchanged = np.mean([_white_share(layer.image) for layer in thumbnails])
    anchored = list(tones)
    for shoulder in SHOULDERS:
        anchored = [replace(tone, shoulder=shoulder) for tone in tones]
        for _ in range(ANCHORINGS):
            toned = [_toned(layer, tone) for layer, tone in zip(thumbnails, anchored, strict=True)]
            kept = [
                after.mean() / max(layer.image.mean(), 1e-6) for after, layer in zip(toned, thumbnails, strict=True)
            ]
            factor = 1 / float(np.median(kept))
            anchored = [replace(tone, gain=tuple(factor * gain for gain in tone.gain)) for tone in anchored]
        if np.mean([_white_share(after) for after in toned]) <= unchanged + MORE_WHITE:
            break
    return anchored


def _white_share(pixels: Intensities) -> float:
    white = np.iinfo(pixels.dtype).max
    return float(cv2.inRange(pixels, (NEARLY_WHITE * white + 1,) * 3, (white,) * 3).mean() / 255)


def _toned(layer: Layer, tone: Tone) -> Intensities:
    """The whole photograph with a tone."""
    return tone.apply(layer.image, tone.factors(layer.size, Canvas(0, 0, *layer.size)))


def _exposures(overlaps: Overlaps, number: int) -> tuple[Array, Array]:
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


def _balance(overlaps: Overlaps, number: int) -> Array:
    """Logarithmic gain of each channel against the photograph's exposure, (number, 3)."""
    none = np.zeros((len(overlaps.i), 0))
    everything = np.ones(len(overlaps.i), dtype=np.bool_)
    beyond = overlaps.difference - overlaps.difference.mean(axis=1, keepdims=True)
    return np.stack(
        [_solved(overlaps, beyond[:, channel], none, number, everything, spread=BALANCE_SIGMA) for channel in range(3)],
        axis=1,
    )


def _predicted(overlaps: Overlaps, columns: Array, fitted: Array, number: int) -> Array:
    return np.asarray(fitted[overlaps.i] - fitted[overlaps.j] + columns @ fitted[number:])


def _solved(
    overlaps: Overlaps,
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
