"""Scores proposed homographies by weighted matches, in integers and without a division.

Coordinates are those of match records: 1/16 px, unsigned, 16 bits. In units of 2^16 of them, 4096 px, every coordinate
is below 1 and the nine elements of a usual homography have similar magnitudes, so one format serves all nine:
`quantise` scales a homography until its largest element is 2^24 - 1 and rounds the others. A homography's scale is
free, its sign says which points are in front of the camera: those whose third coordinate w is positive.

A match is at an error e = (n - x'w) / w, where n and w are linear in the left position and x' is the right one. With
tau = 3 px its gain is the truncated quadratic 32 (1 - e² / 2tau²), rounded up to a whole number, which needs only
comparisons of (n - x'w)² with multiples of w². The score is the sum of weight times gain, the support the sum of the
weights where the gain is not 0. All widths follow from the largest magnitudes below (``MAX_...``).
"""

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Records
from golden_model.formats import POSITION, SQ, WEIGHT, round_shift
from golden_model.records import ELEMENTS, HYPOTHESIS, SCORE, Tag

ENTRY = SQ(25)
"""An element of a hypothesis. With an unsigned position of 16 bits it fits one multiplier of 25 x 18 bits."""
MIN_LARGEST_ENTRY = 1 << ENTRY.bits - 2
"""The largest element of a hypothesis is at least this, or rounding would be too coarse."""
MAX_MATCHES = 2048
"""Matches that the hardware stores: as many as a frame has features."""
TOLERANCE_PX = 3
LEVEL_BITS = 5
LEVELS = 1 << LEVEL_BITS
"""Steps of the gain between error 0 and sqrt(2) ``TOLERANCE_PX``. With 16 steps, a pair with relief, where the seed
decides between two planes, got the wrong plane more often than in floating point; with 32, as often (measured)."""

TERM_SHIFT = 18
"""Bits that x'w, y'w and w drop before the right position is multiplied."""
ERROR_SHIFT = 13
DEPTH_SHIFT = 7
"""Bits that n - x'w and w drop before they are squared. With the 16 bits of the position, both then have the same
unit up to a factor, which `DEPTH_FACTOR` and `ERROR_FACTOR` restore."""
ERROR = SQ(18)
"""n - x'w is limited to this range before it is squared; the limit is beyond the tolerance for every w."""
ERROR_FACTOR, DEPTH_FACTOR = 8, 9
"""e² < 2tau² where 8 (n - x'w)² < 9 w², in the units after the shifts: 9/8 = 2 (3 * 16)² / 2^12."""

MAX_SUM = -ENTRY.min_raw * (2 * POSITION.max_raw + (1 << POSITION.bits))
MAX_TERM = MAX_SUM + (1 << TERM_SHIFT - 1) >> TERM_SHIFT
MAX_DEPTH = MAX_TERM >> DEPTH_SHIFT
MAX_MISS = MAX_TERM * ((1 << POSITION.bits) + POSITION.max_raw)
MAX_SQUARED_ERROR = ERROR_FACTOR * 2 * ERROR.min_raw**2
MAX_SQUARED_DEPTH = DEPTH_FACTOR * MAX_DEPTH**2

LATENCY_CYCLES = 25
"""Clocks from a hypothesis to its score with one match; each further match adds one."""
MIN_CYCLES = 3
"""Clocks from the start of a hypothesis to the start of the next."""
IN_FLIGHT = 2
"""Hypotheses that are started before the score of the first has been taken."""


class ScoreCause(enum.IntFlag):
    """Why a hypothesis has no score (bits of ``Scores.causes``); 0: it has one."""

    OUT_OF_RANGE = 1
    NOT_NORMALISED = 2
    NO_MATCHES = 4
    TOO_MANY_MATCHES = 8
    INVALID_RECORD = 16


@dataclass(frozen=True, eq=False)
class Scores:
    """Result of `score` for M hypotheses."""

    score: NDArray[np.int64]
    """Sum (M,) of weight times gain (0 to 32), 24 bits."""
    support: NDArray[np.int64]
    """Sum (M,) of the weights of the matches with an error below sqrt(2) * 3 px, 19 bits."""
    causes: NDArray[np.int64]
    """Bits (M,) of `ScoreCause`; where it is not 0, score and support are 0."""


def quantise(homographies: Array) -> NDArray[np.int64]:
    """Round homographies (M, 3, 3) of pixels to hypotheses: integers whose largest magnitude is 2^24 - 1.

    Parameters
    ----------
    homographies : (M, 3, 3) float64 ndarray
        They map left to right pixels; points in front of the camera have a positive third coordinate.

    Returns
    -------
    (M, 3, 3) int64 ndarray
        `ENTRY`, halves rounded up.

    Raises
    ------
    ValueError
        For a wrong shape, or a homography that is zero or not finite, with its index.
    """
    H = np.asarray(homographies, dtype=np.float64)
    if H.ndim != 3 or H.shape[1:] != (3, 3):
        raise ValueError(f"homographies have shape {H.shape}; need (M, 3, 3)")
    unit_px = float(1 << POSITION.integer_bits)
    units = np.array([unit_px, unit_px, 1.0])
    scaled = H * units / units[:, np.newaxis]
    largest = np.abs(scaled).max(axis=(1, 2), initial=0)
    wrong = np.flatnonzero(~(np.isfinite(largest) & (largest > 0)))
    if wrong.size:
        raise ValueError(f"homography {wrong[0]} is zero or not finite; leave it out")
    # First to a largest magnitude of 1: the factor for a tiny homography would overflow.
    normalised = scaled / largest[:, np.newaxis, np.newaxis]
    return np.asarray(np.floor(normalised * ENTRY.max_raw + 0.5), dtype=np.int64)


def score(
    hypotheses: NDArray[np.integer],
    left: NDArray[np.integer],
    right: NDArray[np.integer],
    weight: NDArray[np.integer],
    *,
    max_matches: int = MAX_MATCHES,
) -> Scores:
    """Score hypotheses by matches as the hardware does, to the last bit.

    Parameters
    ----------
    hypotheses : (M, 3, 3) integer ndarray
        As `quantise` gives them; any integers of 32 bits are legal, with `ScoreCause` for those that have no score.
    left, right : (N, 2) integer ndarray
        Positions x, y of the matches, `golden_model.formats.POSITION`.
    weight : (N,) integer ndarray
        Weights that the fuzzy rules gave, `golden_model.formats.WEIGHT`.
    max_matches : int
        Matches that the memory holds. With more, no hypothesis has a score.

    Raises
    ------
    ValueError
        For wrong shapes, or positions and weights out of their range.
    """
    h = np.asarray(hypotheses, dtype=np.int64)
    x, y, w = (np.asarray(values, dtype=np.int64) for values in (left, right, weight))
    if h.ndim != 3 or h.shape[1:] != (3, 3) or x.ndim != 2 or x.shape[1] != 2 or y.shape != x.shape:
        raise ValueError(f"shapes are {h.shape}, {x.shape} and {y.shape}; need (M, 3, 3), (N, 2) and (N, 2)")
    if w.shape != x.shape[:1]:
        raise ValueError(f"weights have shape {w.shape}; need ({len(x)},)")
    if not (POSITION.holds(x) and POSITION.holds(y) and WEIGHT.holds(w)):
        raise ValueError(f"positions must be {POSITION} and weights {WEIGHT}, as match records hold them")
    causes = _causes(h, len(x), max_matches)
    gains = np.zeros((len(h), len(x)), dtype=np.int64)
    # The widths are bounded for these only.
    scored = causes == 0
    gains[scored] = gain(h[scored], x, y)
    return Scores(gains @ w, np.asarray((gains > 0) @ w, dtype=np.int64), causes)


def hypothesis_records(hypotheses: NDArray[np.integer]) -> Records:
    """Make records (`golden_model.records.HYPOTHESIS`) of hypotheses (M, 3, 3), numbered from 0."""
    records = np.zeros(len(hypotheses), HYPOTHESIS.dtype)
    records["tag"], records["number"] = Tag.HYPOTHESIS, np.arange(len(hypotheses))
    for name, elements in zip(ELEMENTS, hypotheses.reshape(-1, 9).T, strict=True):
        records[name] = elements.astype(np.int32).view(np.uint32)
    return records


def homography_elements(record: np.void) -> NDArray[np.int64]:
    """The elements (3, 3) of a record of one homography, with their signs."""
    stored = np.array([record[name] for name in ELEMENTS], np.uint32)
    return stored.view(np.int32).astype(np.int64).reshape(3, 3)


def answers(hypotheses: NDArray[np.integer], matches: Records, frame: int = 0) -> Records:
    """Score hypotheses (M, 3, 3) by the kept ones among a frame's Match records.

    Returns the records (`golden_model.records.SCORE`) that answer `hypothesis_records`.
    """
    kept = matches[matches["verdict"] == 1]
    left = np.stack((kept["left_x"], kept["left_y"]), axis=1)
    right = np.stack((kept["right_x"], kept["right_y"]), axis=1)
    scores = score(hypotheses, left, right, kept["weight"])
    records = np.zeros(len(hypotheses), SCORE.dtype)
    records["tag"], records["number"], records["frame"] = Tag.SCORE, np.arange(len(records)), frame
    records["score"], records["support"], records["causes"] = scores.score, scores.support, scores.causes
    return records


def _causes(h: NDArray[np.int64], matches: int, max_matches: int) -> NDArray[np.int64]:
    low, high = h.min(axis=(1, 2), initial=0), h.max(axis=(1, 2), initial=0)
    causes = np.where((low < ENTRY.min_raw) | (high > ENTRY.max_raw), int(ScoreCause.OUT_OF_RANGE), 0)
    # As the hardware sees it: an element whose two leading bits differ.
    small = (low >= -MIN_LARGEST_ENTRY) & (high < MIN_LARGEST_ENTRY)
    causes |= np.where(small, int(ScoreCause.NOT_NORMALISED), 0)
    if matches == 0:
        causes |= int(ScoreCause.NO_MATCHES)
    if matches > max_matches:
        causes |= int(ScoreCause.TOO_MANY_MATCHES)
    return causes


def gain(h: NDArray[np.int64], left: NDArray[np.int64], right: NDArray[np.int64]) -> NDArray[np.int64]:
    """Gain (M, N) of every match under every hypothesis, 0 to `LEVELS`."""
    x, y = left.T
    sums = h[:, :, :1] * x + h[:, :, 1:2] * y + (h[:, :, 2:] << POSITION.bits)
    terms = round_shift(sums, TERM_SHIFT)
    w = terms[:, 2:]
    miss = (terms[:, :2] << POSITION.bits) - right.T * w
    error = np.clip(miss >> ERROR_SHIFT, ERROR.min_raw, ERROR.max_raw)
    depth = np.maximum(w[:, 0] >> DEPTH_SHIFT, 0)
    squared_error = ERROR_FACTOR * (error**2).sum(axis=1)
    squared_depth = DEPTH_FACTOR * depth**2
    gains = np.zeros(depth.shape, dtype=np.int64)
    near = squared_error < squared_depth
    # Rounded up to a whole step, so that a match at the edge of the tolerance still counts.
    gains[near] = LEVELS - (LEVELS * squared_error[near]) // squared_depth[near]
    return gains


def finish_cycles(matches: int, hypotheses: int) -> NDArray[np.int64]:
    """Clock (M,) in which each of M hypotheses has its score, where all wait at the idle block in clock 0.

    Scores are taken at once. From 25 matches on, hypothesis k is done in clock (k + 1) ``matches`` + 24.
    """
    read = max(matches, 1)
    finished: list[int] = []
    start = 0
    for k in range(hypotheses):
        if k:
            start += max(read, MIN_CYCLES)
        # The pipeline never stalls: the next may start only when a score has left.
        if k >= IN_FLIGHT:
            start = max(start, finished[k - IN_FLIGHT] + 1)
        finished.append(start + read - 1 + LATENCY_CYCLES)
    return np.array(finished, dtype=np.int64)
