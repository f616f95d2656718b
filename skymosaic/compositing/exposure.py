"""Estimates the tone of each photograph of a flight, so that all of them agree where they overlap.

The logarithm of an intensity is that of the ground plus the photograph's exposure plus the camera's shading, so the
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
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from golden_model.arrays import Array, Float32, Intensities
from skymosaic.compositing.drift import take_out_drift
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.light import LOG_SIGMA, estimate_light
from skymosaic.compositing.overlaps import Overlaps, compare_overlaps, meeting_pairs
from skymosaic.compositing.tone import NEUTRAL, SHADING_TERMS, SHOULDER_START, Tone, shading_terms
from skymosaic.compositing.warp import Canvas
from skymosaic.imagery.depth import TAIL_PERCENT, ValueRange

EXPOSURE_SIGMA, BALANCE_SIGMA = 0.7, 0.05
"""Expected spread of the exposures, and of the channels of a photograph around its exposure."""
CELLS_OF_PRIOR = 4
"""Weight of these expectations, in cells: enough for photographs without an overlap, too little to bend a strip."""
SHADING_SIGMA = 0.3
"""Expected size of the shading's coefficients."""
SHADINGS = ((0, 0, 0, 0), (1, 1, 0, 0), (0, 0, 1, 1), (1, 1, 1, 1))
"""Terms of the shading to choose from: none, those of a lens, those of a light at one side, or all."""
MEAN_TERMS = (1 / 3, 0.16, 0.0, 0.0)
"""Means of the terms over a photograph; that of r^4 is .156 for a square one, and .168 for one of 16:9."""
ROUNDS = 5
NEARLY_WHITE = 250 / 255
MAX_MORE_WHITE = 0.0005
"""Share of white from which ground looks white, and the share of pixels that may become so."""
SHOULDERS = (SHOULDER_START, 160 / 255, 120 / 255, 80 / 255)
"""Shoulders to try until few enough pixels become white; if none does it, the last one stays."""
USUAL_KEPT, UNEVEN_PERCENTILES = (0.8, 1.25), (10, 90)
"""Brightness over that of the photograph which needs no warning, and the percentiles of places that are judged."""
ANCHORINGS = 3
"""Rounds of scaling all gains together, because compressed highlights darken the photographs again."""
MAX_HELD_OUT_DIFFERENCE = 0.99
"""Terms of the shading are used if they lower the median difference of held-out overlaps below this share."""
CLEARLY_LESS, MAX_LEFT_STEPS = 0.001, 0.5
"""Decrease of that difference which is more than that of smaller exposures, and the share of the squared steps of
exposure from photograph to photograph that a light at one side may leave.
"""
SIDE_CELLS = 8
MAX_UNSEEN_SIDE = 0.15
"""Difference of a light at one side from that which photographs show, over half a diagonal: the ground may hide it."""


def estimate_levels(samples: Sequence[NDArray[Any]], blacks: Sequence[float | None]) -> tuple[float, float]:
    """Estimate the camera's numbers for black and white, by values of each photograph of 16 bits.

    ``blacks`` are the levels that the camera wrote into the photographs; without any, black is 0.
    """
    least, most = min(sample.min() for sample in samples), max(sample.max() for sample in samples)
    known = [black for black in blacks if black is not None]
    black = min(float(np.median(known)), float(least)) if known else 0.0
    # Cameras of 10 to 14 bits fill the lower bits of their numbers, or the upper ones.
    return black, float((1 << int(most).bit_length()) - 1)


def estimate_tones(
    thumbnails: Sequence[Layer], *, black: float = 0.0, white: float = 255.0
) -> tuple[list[Tone], float]:
    """Estimate the tone of each photograph, by thumbnails on a reduced canvas, all BGR and without tones.

    The tones are scaled so that the median photograph keeps its brightness, with a shoulder that turns no more ground
    white than the photographs show. They are neutral for photographs without an overlap. ``black`` and ``white`` are
    the camera's numbers, see `estimate_levels`. The number returned is the ratio of a drift over the map that was taken
    out, see `skymosaic.compositing.drift`; 1 for none.
    """
    number = len(thumbnails)
    overlaps = compare_overlaps(thumbnails, black, white)
    logs, shading, overlaps = _fit_gains(overlaps, number, _measure_sides(thumbnails, black))
    light = estimate_light(overlaps, number)
    joined = np.unique(np.concatenate((overlaps.i, overlaps.j))).tolist()
    if not joined:
        return [NEUTRAL] * number, 1.0
    gains, common = np.exp(logs).tolist(), shading if shading.any() else None
    tones = [Tone(tuple(gains[k]), common, black, None if light is None else light[k]) for k in joined]
    some = [thumbnails[k] for k in joined]
    numbers = np.searchsorted(joined, (overlaps.i, overlaps.j))
    tones, drift = take_out_drift(some, tones, np.unique(numbers, axis=1))
    anchored = dict(zip(joined, _anchor(some, tones), strict=True))
    return [anchored.get(k, NEUTRAL) for k in range(number)], drift


def measure_toned_range(
    tones: Sequence[Tone], samples: Sequence[NDArray[np.generic]], values: ValueRange
) -> ValueRange:
    """Measure the range of photographs of 16 bits after toning, by samples (N,) or (N, 3), and the range before."""
    toned = [tone.apply(np.asarray(sample, np.uint16)[:, None]) for tone, sample in zip(tones, samples, strict=True)]
    low, high = np.percentile(np.concatenate([each.ravel() for each in toned]), (TAIL_PERCENT, 100 - TAIL_PERCENT))
    return replace(values, low=float(low), high=float(high))


def describe_uneven(thumbnails: Sequence[Layer], tones: Sequence[Tone], drift: float) -> str:
    """Say what to expect where a ``drift`` was taken out, or tones make whole places darker or brighter; else empty.

    A place is a photograph with all that meet it: what differs between them, as in a bracket of exposures, is no trend.
    """
    if drift > 1:
        return (
            f"brightness: along the flight ground, or light that stays with it, changes by a factor of {drift:.1f}. "
            "Overlaps cannot tell the two apart; it is taken for light and evened out. Fix the exposure to keep it"
        )
    kept = np.array([_measure_toned(layer, tone)[0] for layer, tone in zip(thumbnails, tones, strict=True)])
    together = np.eye(len(kept), dtype=np.bool_)
    for i, j in meeting_pairs([layer.footprint for layer in thumbnails]):
        together[i, j] = together[j, i] = True
    low, high = np.percentile([np.median(kept[row]) for row in together], UNEVEN_PERCENTILES)
    if USUAL_KEPT[0] <= low and high <= USUAL_KEPT[1]:
        return ""
    return (
        f"brightness: a tenth of the places are shown at {low:.2f} of their photographs' or less, and a tenth at "
        f"{high:.2f} or more; exposure, ground or a light that moves with the camera changes along the flight. Fix the "
        "exposure, and fly neighbouring lines in opposite directions"
    )


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


def _measure_sides(thumbnails: Sequence[Layer], black: float) -> Array:
    """The light at one side that photographs show by themselves, ground included: (2, 3), as in `Tone.shading`.

    Single photographs show mostly the ground; the median over all of them is that of the camera, unless the ground
    grows brighter in one direction of all photographs.
    """
    size = (SIDE_CELLS, SIDE_CELLS)
    places = shading_terms(np.stack(np.meshgrid(*map(np.arange, size)), axis=-1), size)[..., 2:].reshape(-1, 2)
    slopes = []
    for layer in thumbnails:
        cells = cv2.resize(layer.image, size, interpolation=cv2.INTER_AREA).reshape(-1, 3)
        slopes.append(places.T @ np.log(np.maximum(cells - black, 1.0)) / np.square(places).sum(axis=0)[:, None])
    return np.asarray(-np.median(slopes, axis=0))


def _fit_gains(overlaps: Overlaps, number: int, sides: Array) -> tuple[Array, Array, Overlaps]:
    """Logarithmic gains (number, 3), the shading (4, 3), and the overlaps with what neither explains."""
    mean, side = overlaps.difference.mean(axis=1, keepdims=True), sides.mean(axis=1, keepdims=True)
    exposure, common = _fit_chosen(overlaps, mean, number, EXPOSURE_SIGMA, side)
    balance, tint = _fit_chosen(overlaps, overlaps.difference - mean, number, BALANCE_SIGMA, sides - side)
    logs, shading = exposure + balance, common + tint
    left = overlaps.difference - _explain(overlaps, logs, shading)
    # A tint in the corners alone must not become one of the whole mosaic.
    return logs - MEAN_TERMS @ tint, shading, overlaps._replace(difference=left.astype(np.float32))


def _fit_chosen(overlaps: Overlaps, target: Float32, number: int, spread: float, sides: Array) -> tuple[Array, Array]:
    """Gains (number, C) and shading (4, C) for differences (N, C), with the terms that explain held-out overlaps.

    A light at one side must not be stronger than photographs show it by themselves, ``sides`` (2, C).
    """
    # Every second pair is held out, so that both halves cover the whole flight.
    fitted = overlaps.pair % 2 == 0
    ends = sparse.coo_array((np.ones(fitted.sum()), (overlaps.i[fitted], overlaps.j[fitted])), (number, number))
    part = connected_components(ends, directed=False)[1]
    # The other half knows nothing of exposures that no pair of this half joins.
    held_out = ~fitted & (part[overlaps.i] == part[overlaps.j])
    chosen = SHADINGS[0]
    if held_out.any():
        used, rest = (Overlaps._make(column[half] for column in overlaps) for half in (fitted, held_out))
        least = fewest = np.inf
        for terms in SHADINGS:
            gains, shading = _fit_channels(used, target[fitted], number, spread, terms)
            left = float(np.median(np.abs(target[held_out] - _explain(rest, gains, shading))))
            steps = float(np.square(gains[used.i] - gains[used.j]).mean())
            # A bright side is hard to tell from exposures that rise along the flight; it has to explain these, or more.
            clear = not any(terms[2:]) or least - left > CLEARLY_LESS or steps < MAX_LEFT_STEPS * fewest
            clear &= bool((np.abs(shading[2:] - sides) <= np.maximum(MAX_UNSEEN_SIDE, np.abs(sides))).all())
            if left < MAX_HELD_OUT_DIFFERENCE * least and clear:
                least, fewest, chosen = left, steps, terms
    return _fit_channels(overlaps, target, number, spread, chosen)


def _explain(overlaps: Overlaps, gains: Array, shading: Array) -> Array:
    """The differences (N, ...) that gains (number, ...) and a shading (4, ...) explain."""
    return np.asarray(gains[overlaps.i] - gains[overlaps.j] + overlaps.shading @ shading)


def _fit_channels(
    overlaps: Overlaps, target: Float32, number: int, spread: float, terms: tuple[int, ...]
) -> tuple[Array, Array]:
    """Gains (number, C) and a shading (4, C) that has only some terms."""
    overlaps = overlaps._replace(shading=overlaps.shading * np.array(terms, np.float32))
    gains, shading = zip(*(_fit(overlaps, channel, number, spread) for channel in target.T), strict=True)
    return np.column_stack(gains), np.column_stack(shading)


def _fit(overlaps: Overlaps, target: Float32, number: int, spread: float) -> tuple[Array, Array]:
    """Robust least squares for the gains (number,) and the shading (4,) of one channel.

    Iteratively reweighted with Geman and McClure's weights, since moving things and parallax differ by more than
    exposure.
    """
    prior = np.concatenate((np.full(number, CELLS_OF_PRIOR / spread**2), np.full(SHADING_TERMS, 1 / SHADING_SIGMA**2)))
    weight, fitted = np.full(len(target), 1 / LOG_SIGMA**2), np.zeros(len(prior))
    for _ in range(ROUNDS):
        matrix, right = _normal_equations(overlaps, target, weight, number)
        fitted = splu((matrix + sparse.diags_array(prior)).tocsc()).solve(right)
        left = target - _explain(overlaps, fitted[:number], fitted[number:])
        weight = 1 / LOG_SIGMA**2 / (1 + (left / LOG_SIGMA) ** 2) ** 2
    return fitted[:number], fitted[number:]


def _normal_equations(
    overlaps: Overlaps, target: Float32, weight: Array, number: int
) -> tuple[sparse.coo_array, Array]:
    """The equations (number + 4) of the gains and the shading, without a matrix of all cells.

    The cells of a pair have the same two gains, so their weights are summed first.
    """
    first = np.flatnonzero(np.diff(overlaps.pair, prepend=-1))
    ends, signs = np.column_stack((overlaps.i[first], overlaps.j[first])).ravel(), np.tile([1.0, -1.0], len(first))
    pairs = sparse.csr_array((signs, ends, 2 * np.arange(len(first) + 1)), shape=(len(first), number))
    terms = np.column_stack((np.ones_like(target), target, overlaps.shading))
    sums = np.add.reduceat(weight[:, None] * terms, first)
    gains, across = pairs.T @ sparse.diags_array(sums[:, 0]) @ pairs, pairs.T @ sums[:, 2:]
    shading = (weight[:, None] * overlaps.shading).T
    matrix = sparse.block_array([[gains, across], [across.T, shading @ overlaps.shading]])
    return matrix, np.concatenate((pairs.T @ sums[:, 1], shading @ target))
