"""Estimates the tone of each photograph of a flight, so that all of them agree where they overlap.

The logarithm of an intensity is that of the ground plus the photograph's exposure plus the lens falloff, so the
unknowns enter linearly. Least squares on the gains themselves (Brown and Lowe 2007, equation 29) pulls them towards
zero, because darker pictures always differ less; differences of logarithms have no such bias. Differences that
exposures do not explain are left to a smooth light field per photograph, see `skymosaic.compositing.light`.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from golden_model.arrays import Array, Float32, Intensities
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.light import LOG_SIGMA, estimate_light
from skymosaic.compositing.overlaps import Overlaps, compare_overlaps
from skymosaic.compositing.tone import NEUTRAL, SHOULDER_START, Tone
from skymosaic.compositing.warp import Canvas
from skymosaic.imagery.depth import TAIL_PERCENT, ValueRange

EXPOSURE_SIGMA, BALANCE_SIGMA = 0.7, 0.05
"""Expected spread of the exposures, and of the channels of a photograph around its exposure."""
CELLS_OF_PRIOR = 4
"""Weight of these expectations, in cells: enough for photographs without an overlap, too little to bend a strip."""
FALLOFF_SIGMA = 0.3
ROUNDS = 5
NEARLY_WHITE = 250 / 255
MAX_MORE_WHITE = 0.0005
"""Share of white from which ground looks white, and the share of pixels that may become so."""
SHOULDERS = (SHOULDER_START, 160 / 255, 120 / 255, 80 / 255)
"""Shoulders to try until few enough pixels become white; if none does it, the last one stays."""
ANCHORINGS = 3
"""Rounds of scaling all gains together, because compressed highlights darken the photographs again."""
MAX_HELD_OUT_DIFFERENCE = 0.99
"""A lens falloff is used if it lowers the median difference of held-out overlaps below this share."""


def estimate_levels(samples: Sequence[NDArray[Any]], blacks: Sequence[float | None]) -> tuple[float, float]:
    """Estimate the camera's numbers for black and white in photographs of 16 bits.

    Parameters
    ----------
    samples : sequence of ndarray of uint16
        Values of each photograph.
    blacks : sequence of float or None
        Black level that the camera wrote into each photograph; without any, black is 0.
    """
    least, most = min(sample.min() for sample in samples), max(sample.max() for sample in samples)
    known = [black for black in blacks if black is not None]
    black = min(float(np.median(known)), float(least)) if known else 0.0
    # Cameras of 10 to 14 bits fill the lower bits of their numbers, or the upper ones.
    return black, float((1 << int(most).bit_length()) - 1)


def estimate_tones(thumbnails: Sequence[Layer], *, black: float = 0.0, white: float = 255.0) -> list[Tone]:
    """Estimate the tone of each photograph.

    Parameters
    ----------
    thumbnails : sequence of Layer
        The photographs on a reduced canvas, all BGR, without tones.
    black, white : float
        The camera's numbers for black and white, see `estimate_levels`.

    Returns
    -------
    list of Tone
        Scaled so that the median photograph keeps its brightness, with a shoulder that turns no more ground white
        than the photographs show. Neutral for photographs without an overlap.
    """
    number = len(thumbnails)
    overlaps = compare_overlaps(thumbnails, black, white)
    logs, falloff, overlaps = _fit_gains(overlaps, number)
    light = estimate_light(overlaps, number)
    joined = np.unique(np.concatenate((overlaps.i, overlaps.j))).tolist()
    if not joined:
        return [NEUTRAL] * number
    gains, common = np.exp(logs).tolist(), (float(falloff[0]), float(falloff[1]))
    tones = [Tone(tuple(gains[k]), common, black, None if light is None else light[k]) for k in joined]
    anchored = dict(zip(joined, _anchor([thumbnails[k] for k in joined], tones), strict=True))
    return [anchored.get(k, NEUTRAL) for k in range(number)]


def measure_toned_range(
    tones: Sequence[Tone], samples: Sequence[NDArray[np.generic]], values: ValueRange
) -> ValueRange:
    """Measure the range of photographs of 16 bits after toning.

    Parameters
    ----------
    tones : sequence of Tone
    samples : sequence of ndarray of uint16, shape (N,) or (N, 3)
        Values of each photograph.
    values : ValueRange
        The range before toning.
    """
    toned = [tone.apply(np.asarray(sample, np.uint16)[:, None]) for tone, sample in zip(tones, samples, strict=True)]
    low, high = np.percentile(np.concatenate([each.ravel() for each in toned]), (TAIL_PERCENT, 100 - TAIL_PERCENT))
    return replace(values, low=float(low), high=float(high))


def _anchor(thumbnails: Sequence[Layer], tones: Sequence[Tone]) -> list[Tone]:
    """Scale tones together so that the median photograph keeps its brightness, and choose their shoulder."""
    unchanged = np.mean([_white_share(layer.image) for layer in thumbnails])
    anchored = list(tones)
    for shoulder in SHOULDERS:
        anchored = [replace(tone, shoulder=shoulder) for tone in tones]
        for _ in range(ANCHORINGS):
            measured = [_measure_toned(layer, tone) for layer, tone in zip(thumbnails, anchored, strict=True)]
            kept, white = zip(*measured, strict=True)
            factor = 1 / float(np.median(kept))
            anchored = [replace(tone, gain=tuple(factor * gain for gain in tone.gain)) for tone in anchored]
        if np.mean(white) <= unchanged + MAX_MORE_WHITE:
            break
    return anchored


def _white_share(pixels: Intensities) -> float:
    white = np.iinfo(pixels.dtype).max
    return float(cv2.inRange(pixels, (NEARLY_WHITE * white + 1,) * 3, (white,) * 3).mean() / 255)


def _measure_toned(layer: Layer, tone: Tone) -> tuple[float, float]:
    """The share of its brightness that a toned photograph keeps, and the share of it that is white."""
    toned = tone.apply(layer.image, tone.factors(layer.size, Canvas(0, 0, *layer.size)))
    return float(toned.mean() / max(layer.image.mean(), 1e-6)), _white_share(toned)


def _fit_gains(overlaps: Overlaps, number: int) -> tuple[Array, Array, Overlaps]:
    """Logarithmic gains (number, 3), the lens falloff (2,), and the overlaps with what neither explains."""
    exposure, falloff = _fit_exposure(overlaps, number)
    logs = exposure[:, None] + _fit_balance(overlaps, number)
    channels = zip(overlaps.difference.T, logs.T, strict=True)
    left = np.column_stack([channel - _explain(overlaps, gains, falloff) for channel, gains in channels])
    return logs, falloff, overlaps._replace(difference=left.astype(np.float32))


def _fit_exposure(overlaps: Overlaps, number: int) -> tuple[Array, Array]:
    """Logarithmic exposure of each photograph, and the lens falloff where it explains held-out overlaps."""
    mean = overlaps.difference.mean(axis=1)
    # Every second pair is held out, so that both halves cover the whole flight.
    odd = overlaps.pair % 2 == 1
    with_falloff = False
    if odd.any() and not odd.all():
        fitted_to, held_out = (Overlaps._make(column[chosen] for column in overlaps) for chosen in (~odd, odd))
        plain, reduced = (
            np.median(np.abs(mean[odd] - _explain(held_out, *_fit(fitted_to, mean[~odd], number, with_falloff=each))))
            for each in (False, True)
        )
        with_falloff = bool(reduced < MAX_HELD_OUT_DIFFERENCE * plain)
    return _fit(overlaps, mean, number, with_falloff=with_falloff)


def _fit_balance(overlaps: Overlaps, number: int) -> Array:
    """Logarithmic gain of each channel against the photograph's exposure, (number, 3)."""
    beyond = overlaps.difference - overlaps.difference.mean(axis=1, keepdims=True)
    return np.stack([_fit(overlaps, channel, number, spread=BALANCE_SIGMA)[0] for channel in beyond.T], axis=1)


def _explain(overlaps: Overlaps, gains: Array, falloff: Array) -> Array:
    """The differences (N,) that the gains of one channel and the lens falloff explain."""
    return np.asarray(gains[overlaps.i] - gains[overlaps.j] + overlaps.falloff @ falloff)


def _fit(
    overlaps: Overlaps,
    target: Float32,
    number: int,
    *,
    spread: float = EXPOSURE_SIGMA,
    with_falloff: bool = False,
) -> tuple[Array, Array]:
    """Robust least squares for the gains (number,) of one channel, and for the lens falloff (2,), which may be left 0.

    Iteratively reweighted with Geman and McClure's weights, since moving things and parallax differ by more than
    exposure.
    """
    if not with_falloff:
        overlaps = overlaps._replace(falloff=np.zeros_like(overlaps.falloff))
    prior = np.concatenate((np.full(number, CELLS_OF_PRIOR / spread**2), np.full(2, 1 / FALLOFF_SIGMA**2)))
    weight, fitted = np.full(len(target), 1 / LOG_SIGMA**2), np.zeros(number + 2)
    for _ in range(ROUNDS):
        matrix, right = _normal_equations(overlaps, target, weight, number)
        fitted = splu((matrix + sparse.diags_array(prior)).tocsc()).solve(right)
        left = target - _explain(overlaps, fitted[:number], fitted[number:])
        weight = 1 / LOG_SIGMA**2 / (1 + (left / LOG_SIGMA) ** 2) ** 2
    return fitted[:number], fitted[number:]


def _normal_equations(
    overlaps: Overlaps, target: Float32, weight: Array, number: int
) -> tuple[sparse.coo_array, Array]:
    """The equations (number + 2) of the gains and the falloff, without a matrix of all cells.

    The cells of a pair have the same two gains, so their weights are summed first.
    """
    first = np.flatnonzero(np.diff(overlaps.pair, prepend=-1))
    ends, signs = np.column_stack((overlaps.i[first], overlaps.j[first])).ravel(), np.tile([1.0, -1.0], len(first))
    pairs = sparse.csr_array((signs, ends, 2 * np.arange(len(first) + 1)), shape=(len(first), number))
    terms = np.column_stack((np.ones_like(target), target, overlaps.falloff))
    sums = np.add.reduceat(weight[:, None] * terms, first)
    gains, across = pairs.T @ sparse.diags_array(sums[:, 0]) @ pairs, pairs.T @ sums[:, 2:]
    falloff = (weight[:, None] * overlaps.falloff).T
    matrix = sparse.block_array([[gains, across], [across.T, falloff @ overlaps.falloff]])
    return matrix, np.concatenate((pairs.T @ sums[:, 1], falloff @ target))
