"""From the matches of a frame to a homography, on the chip alone; `hdl.geometry.estimator` equals it bit for bit.

The kept matches are ordered by weight. Samples of four are drawn in PROSAC's order, solved, and scored by all matches;
the best homography is kept. After each step of the search that found a better one, four rounds of weighted least
squares over its inliers, in ever narrower bands, refine it: each is scored, and stays unless its score is clearly
lower. It is accepted if enough matches agree closely, in enough places of the frame.

A pass computes the areas of two samples and solves them, unless both are dropped; meanwhile the two before are scored.
It takes as long as the longer of these. Each of the 16 steps ends after a number of passes or at its share of
`SEARCH_CYCLES`, so that even with the most matches the homography comes within `MAX_CYCLES` after the last match.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Records
from golden_model.config import Config, EstimatorConfig
from golden_model.geometry import match_gain, ordering, programs, sampling
from golden_model.geometry.acceptance import INLIER_GAIN, count_cells
from golden_model.geometry.fixed_point import ENTRY
from golden_model.geometry.floating import MANTISSA_BITS, Floats
from golden_model.geometry.program import LANES
from golden_model.geometry.refit import BANDS, MAX_INLIERS, SUMS, factors, solve_sums
from golden_model.geometry.solving import MIN_CHECKED_EXPONENT, areas, solve
from golden_model.records import ELEMENTS, HOMOGRAPHY, Tag

Integers = NDArray[np.int64]

MAX_MATCHES = 2048
"""Matches of a frame that the hardware stores: as many as a frame has features."""
SEARCH_CYCLES = 164_800
"""The longest time for the samples; the rest covers sorting, refit and acceptance of any set of matches."""
MAX_CYCLES = 300_000
MAX_REFITTED_OFTEN = 256
"""With more matches, only the last step's best homography is refitted: there would be no time for more."""
REFIT_MARGIN_LOG2 = 8
"""A refit stays even if the homography before it has a score that is higher by this share, 1/256. The gain tells no
errors below 0.75 px apart, so the best of many samples often has a slightly higher score than the least squares of all
its inliers, which are several times closer to the truth (measured: 0.08 instead of 0.42 px, 90th percentile)."""


class EstimateCause(enum.IntFlag):
    """Why a homography is not accepted (bits of ``Estimate.causes``); 0: it is."""

    BAD_FRAME = 1
    TOO_FEW_MATCHES = 2
    TOO_MANY_MATCHES = 4
    INVALID_SETTINGS = 8
    NO_HYPOTHESIS = 16
    """No sample keeps the orientation of its triangles, or none has a score."""
    TOO_FEW_INLIERS = 32
    TOO_FEW_CELLS = 64


@dataclass(frozen=True, eq=False)
class Estimate:
    """Result of `estimate`."""

    homography: Integers
    """Elements (3, 3), left to right, `golden_model.geometry.fixed_point.ENTRY`; 0 where there is none."""
    score: int
    support: int
    """Sum of the weights of the matches with an error below 4.2 px."""
    inliers: int
    """Matches with an error below 1.98 px, positions in the right frame."""
    cells: int
    """Cells of the right frame, of 64, in which they lie."""
    causes: int
    cycles: int
    """Clocks from the end of the matches to the result."""


@dataclass(frozen=True)
class EstimatorCycles:
    """Clocks of the parts of `hdl.geometry.estimator`, besides those that a number of matches or a program takes."""

    accept: int = 2
    """From the end of the matches to the sorting, and the result."""
    sort: int = 258
    """Sums of the counts of matches by weight."""
    place: int = 5
    """Per match: it is moved to its rank."""
    turn: int = 27
    """Between two passes: solutions become hypotheses, samples are drawn."""
    program: int = 3
    """From the start of a program to that of the next in a pass, besides its own."""
    skip: int = 1
    """In place of a program, where no sample of a pass is worth solving."""
    sweep: int = 25
    """Besides one clock per match."""
    gather: int = 12
    """Per group of inliers, besides the program."""
    round: int = 32
    """Per round of the refit, besides programs and sweep."""
    look: int = 1
    """After the first look at a homography to refit, and after the last one that decides on acceptance."""
    records: int = 3
    """From the last word of the matches' packet, and to the first word of the record, besides all of the above."""


CYCLES = EstimatorCycles()


class FrameMatches(NamedTuple):
    """The kept matches of a frame, in the order of their records."""

    left: Integers
    """Positions x, y (N, 2), `golden_model.formats.POSITION`."""
    right: Integers
    weight: Integers
    """(N,), `golden_model.formats.WEIGHT`."""
    size: tuple[int, int]
    """Width and height of the right frame, px."""
    good: bool = True
    """Whether the frame is good, and its matches are complete."""

    @classmethod
    def from_records(cls, matches: Records, status: np.void) -> FrameMatches:
        """Take the kept ones of Match records, and the frame's status."""
        kept = matches[matches["verdict"] == 1]
        left = np.stack((kept["left_x"], kept["left_y"]), axis=1, dtype=np.int64)
        right = np.stack((kept["right_x"], kept["right_y"]), axis=1, dtype=np.int64)
        weight = kept["weight"].astype(np.int64)
        return cls(left, right, weight, (int(status["width"]), int(status["height"])), bool(status["good"]))

    def in_order(self) -> FrameMatches:
        """The same matches by falling weight."""
        order = ordering.order(self.weight)
        return self._replace(left=self.left[order], right=self.right[order], weight=self.weight[order])

    def gain(self, homography: Integers) -> Integers:
        """Gain (N,) of each match under a homography."""
        gains: Integers = match_gain.gain(homography[np.newaxis], self.left, self.right)[0]
        return gains

    def score(self, homography: Integers) -> int:
        """Sum of weight times gain."""
        return int(self.gain(homography) @ self.weight)


def estimate(frame: FrameMatches, settings: EstimatorConfig, *, max_matches: int = MAX_MATCHES) -> Estimate:
    """Estimate the homography of a frame's kept matches; the memory holds ``max_matches``."""
    count = len(frame.weight)
    refused = _refusal(count, settings, max_matches, good=frame.good)
    if refused:
        return _none(refused, CYCLES.accept)
    matches = frame.in_order()
    best, score, cycles = _search(matches, settings)
    cycles += CYCLES.accept + CYCLES.sort + CYCLES.place * count
    if score == 0:
        return _none(EstimateCause.NO_HYPOTHESIS, cycles)
    cycles += count + CYCLES.sweep + CYCLES.look
    gains = matches.gain(best)
    inliers = gains >= INLIER_GAIN
    cells = count_cells(matches.right[inliers], frame.size)
    few = (inliers.sum() < settings.min_inliers) * EstimateCause.TOO_FEW_INLIERS
    narrow = (cells < settings.min_cells) * EstimateCause.TOO_FEW_CELLS
    support = int(matches.weight[gains > 0].sum())
    return Estimate(best, score, support, int(inliers.sum()), cells, int(few | narrow), cycles)


def homography_record(result: Estimate, frame: int = 0, reference: int = 0) -> Records:
    """Make the record (`golden_model.records.HOMOGRAPHY`) of a frame's estimate, (1,)."""
    record = np.zeros(1, HOMOGRAPHY.dtype)
    record["tag"], record["frame"], record["reference"] = Tag.HOMOGRAPHY, frame, reference
    for name in ("causes", "inliers", "score", "support", "cycles", "cells"):
        record[name] = getattr(result, name)
    for name, element in zip(ELEMENTS, result.homography.ravel(), strict=True):
        record[name] = element & 0xFFFF_FFFF
    return record


def frame_homography(matches: Records, status: np.void, config: Config) -> Records:
    """The record (1,) that the accelerator sends for a frame, by its Match records and FrameStatus."""
    assert config.estimator
    stored = min(config.front_end.max_features, MAX_MATCHES)
    result = estimate(FrameMatches.from_records(matches, status), config.estimator, max_matches=stored)
    return homography_record(result, int(status["frame"]), int(matches["reference"].max(initial=0)))


def _refusal(matches: int, settings: EstimatorConfig, max_matches: int, *, good: bool) -> EstimateCause:
    causes = EstimateCause(0) if good else EstimateCause.BAD_FRAME
    if settings.seed == 0 or settings.passes == 0:
        causes |= EstimateCause.INVALID_SETTINGS
    if good and matches < sampling.SAMPLE:
        causes |= EstimateCause.TOO_FEW_MATCHES
    if good and matches > max_matches:
        causes |= EstimateCause.TOO_MANY_MATCHES
    return causes


def _none(causes: EstimateCause, cycles: int) -> Estimate:
    return Estimate(np.zeros((3, 3), dtype=np.int64), 0, 0, 0, 0, int(causes), cycles)


def _search(matches: FrameMatches, settings: EstimatorConfig) -> tuple[Integers, int, int]:
    """Best homography of all samples and of the refits, its score, and the clocks."""
    best, best_score, refitted_score = np.zeros((3, 3), dtype=np.int64), 0, 0
    state, cycles = settings.seed, 0
    count = len(matches.weight)
    for step in range(sampling.STEPS):
        ranks, states = _draw(state, sampling.subset_size(count, step), settings.passes)
        hypotheses, valid = _solve(matches, ranks)
        share, scoring_cycles = (step + 1) * (SEARCH_CYCLES // sampling.STEPS), 0
        for number, after in enumerate(states):
            state = after
            lanes = slice(LANES * number, LANES * (number + 1))
            solved = int(valid[lanes].sum())
            # The scores of the pass before are computed meanwhile.
            cycles += CYCLES.turn + max(solving_cycles(solved), scoring_cycles)
            scoring_cycles = solved * (count + CYCLES.sweep)
            for homography in hypotheses[lanes][valid[lanes]]:
                score = matches.score(homography)
                if score > best_score:
                    best, best_score = homography, score
            is_late = cycles > share
            if is_late:
                break
        cycles += CYCLES.turn + scoring_cycles
        has_time = count <= MAX_REFITTED_OFTEN and not is_late
        if best_score > refitted_score and (has_time or step == sampling.STEPS - 1):
            best, best_score, refit_cycles = _refit(matches, best, best_score)
            refitted_score, cycles = best_score, cycles + refit_cycles
    return best, best_score, cycles


def solving_cycles(solved: int) -> int:
    """Clocks of the programs of a pass in which so many samples have a homography."""
    solve = programs.SOLVE.cycles + CYCLES.program if solved else CYCLES.skip
    return programs.AREAS.cycles + CYCLES.program + solve


def _draw(state: int, size: int, passes: int) -> tuple[Integers, list[int]]:
    """Ranks (2 passes, 4) of the samples, and the generator's state after each pass."""
    ranks, states = [], []
    for _ in range(passes):
        for _ in range(LANES):
            sample, state = sampling.draw(state, size)
            ranks.append(sample)
        states.append(state)
    return np.array(ranks), states


def _solve(matches: FrameMatches, ranks: Integers) -> tuple[Integers, NDArray[np.bool_]]:
    """Homographies (M, 3, 3) of samples (M, 4), and which of them are valid."""
    zero, one = _constants()

    def drawn(side: Integers) -> list[list[Floats]]:
        return [[Floats.from_integers(position, 16) for position in side[rank].T] for rank in ranks.T]

    sample = drawn(matches.left), drawn(matches.right)
    kept, products = areas(zero, one, sample)
    return quantise(solve(zero, one, sample, kept)), np.all([passes(each) for each in products], axis=0)


def _constants() -> tuple[Floats, Floats]:
    return Floats.from_real(np.zeros(1)), Floats.from_real(np.ones(1))


def passes(checked: Floats) -> NDArray[np.bool_]:
    """Whether checked numbers are positive and large enough."""
    return np.asarray(~checked.negative & (checked.exponent >= MIN_CHECKED_EXPONENT))


def quantise(rows: list[list[Floats]]) -> Integers:
    """Scale homographies to fixed point: the largest element gets 24 bits, all are truncated.

    Returns
    -------
    (M, 3, 3) int64 ndarray
        `golden_model.geometry.fixed_point.ENTRY`.
    """
    numbers = Floats.stack([each for row in rows for each in row])
    largest = numbers.exponent.max(axis=-1, keepdims=True)
    dropped = MANTISSA_BITS - (ENTRY.bits - 1) + largest - numbers.exponent
    elements = numbers.mantissa >> np.minimum(dropped, MANTISSA_BITS)
    return np.asarray(np.where(numbers.negative, -elements, elements).reshape(-1, 3, 3))


def _refit(matches: FrameMatches, best: Integers, score: int) -> tuple[Integers, int, int]:
    """Refit a homography: the one that stays, its score, and the clocks."""
    newest = best
    sweep_cycles = len(matches.weight) + CYCLES.sweep
    cycles = sweep_cycles + CYCLES.look
    for band in BANDS:
        inliers = np.flatnonzero(matches.gain(newest) >= band)[:MAX_INLIERS]
        newest, valid = _fit(matches, inliers)
        groups = -(-len(inliers) // programs.GROUP)
        cycles += programs.CLEAR.cycles + groups * (programs.ADD.cycles + CYCLES.gather) + programs.FIT.cycles
        cycles += CYCLES.round + sweep_cycles
        newest_score = matches.score(newest)
        if valid and newest_score + (newest_score >> REFIT_MARGIN_LOG2) > score:
            best, score = newest, newest_score
    return best, score, cycles


def _fit(matches: FrameMatches, inliers: Integers) -> tuple[Integers, bool]:
    """Least squares over inliers; whether the result preserves orientation."""
    zero, one = _constants()
    centre = [zero.plus(one, Floats.from_integers(np.array([side << 3]), 16)) for side in matches.size]
    match = [
        Floats.from_integers(side[inliers, axis], 16) for side in (matches.left, matches.right) for axis in range(2)
    ]
    pairs = factors(zero, one, centre, match, Floats.from_integers(matches.weight[inliers], 8))
    first, second = (Floats.stack([pair[n] for pair in pairs]) for n in range(2))
    sums = Floats.from_real(np.zeros(SUMS))
    for n in range(len(inliers)):
        sums = sums.plus(first[n], second[n])
    rows, determinant = solve_sums(zero, one, centre, [sums[n : n + 1] for n in range(SUMS)])
    return quantise(rows)[0], bool(passes(determinant)[0])
