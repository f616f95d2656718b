"""Predicts in which clock each step of a frame through the accelerator happens, from sizes, counts and matches alone.

The prediction is exact for streams without pauses: one beat of one or two pixels per clock, and outputs that are always
taken. It adds up the latencies that the blocks state (`Latencies`), and follows the one place where waiting depends on
data: the queue of mutual matches between the walk over the rows and the weighing.

Not predicted are pauses of the streams, the first word of each feature, and

- frames without selection by cells, whose queue may hold pixels back;
- frames so narrow that a cell row, if its cells are full, has not left when the next one or the frame ends;
- what follows a frame whose matching, with the homography, delays the features of the next but one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from golden_model.config import CELL_SIZES_PX, MAX_FRAME_PX, MIN_LEVEL_PX, Config, FrontEndConfig, MatcherConfig
from golden_model.feature.ilbp import DescriptorPattern
from golden_model.fuzzy.sugeno import SugenoSystem
from golden_model.geometry.estimator import CYCLES
from golden_model.matching import rule_bases
from golden_model.records import HOMOGRAPHY, MATCH, WORD_BYTES


@dataclass(frozen=True, kw_only=True)
class Latencies:
    """Latencies of the blocks in clocks; a test compares them with the hardware's own."""

    record_words: int
    """Length of a Feature record."""
    match_words: int
    """Length of a Match record."""
    admission: int = 2
    """From a beat at the input to the same beat inside: a skid buffer, and the register of frame admission."""
    status: int = 3
    """From a frame's last beat to the first word of its status in the merge."""
    status_word: int = 2
    """Per further word of a status: it is selected in one clock and sent in the next."""
    skid_buffer: int = 1
    """Per stage between the merge and an output, or the matcher."""
    acceptance: int = 2
    """From the last word of a status at the matcher to the clock in which the frame is accepted."""
    search_start: int = 2
    """From acceptance to the first clock of the search."""
    drain: int
    """From the last address of a search to readable results."""
    shortest_pass: int
    """Shortest pass of the right features over the lanes."""
    walk: int = 5
    """From a row's address to its mutual match in the queue."""
    count: int
    """How long a match occupies the histogram of orientations."""
    weigh: int
    """How long a match occupies the weigher."""
    lone_match: int
    """How much longer a frame's only match does: the estimator takes the first record late, which nothing hides if
    the status follows it at once."""
    peak: int
    """Search for the peak of the histogram, and clearing it; 0 without orientations."""

    @classmethod
    def compute(cls, config: Config, *, lanes: int) -> Latencies:
        """Compute the latencies of a build."""
        pattern, words = config.front_end.pattern, MATCH.record_bytes // WORD_BYTES
        return cls(
            record_words=pattern.record.record_bytes // WORD_BYTES,
            match_words=words,
            drain=_READ_CYCLES + DISTANCE_CYCLES[pattern.bits] + lanes + 2,
            shortest_pass=lanes + 4,
            # Weight, its square, sum.
            count=sugeno_cycles(rule_bases.aerial_orientation(pattern.bits)) + 4 + 1,
            # Features read, weight, comparison with the limit, record; with rules, a clock until the next match.
            weigh=_READ_CYCLES + weight_cycles(pattern, config.matcher) + 1 + words + bool(config.matcher.rules),
            lone_match=int(config.estimator is not None and config.matcher.rules is None),
            # Up and down the 16 bins, and 5 clocks of latency between.
            peak=16 + 5 + 16 if pattern.oriented else 0,
        )


_READ_CYCLES = 3
_ROW_CYCLES = 128 + 3 * MAX_FRAME_PX // (2 * CELL_SIZES_PX[0])
"""The longest time from the end of a cell row to its last feature, besides the words of features: less than 128 clocks
of pipeline, and a clock for each empty cell, of both levels of the largest build."""
DISTANCE_CYCLES = {8: 4, 16: 5, 24: 5, 32: 5, 128: 5, 256: 8}
"""Operand register and population count, by the length of the descriptor in bits."""
SAD_CYCLES = 3


def weight_cycles(pattern: DescriptorPattern, config: MatcherConfig) -> int:
    """Clocks from the features to their weight: relative orientation or sum of absolute differences, then the rules."""
    if config.rules is None:
        return 1
    measuring = SAD_CYCLES if config.rules.compares_windows else 1
    return measuring + sugeno_cycles(config.rules.tables(pattern.bits))


def sugeno_cycles(system: SugenoSystem) -> int:
    """Clocks of `hdl.fuzzy.sugeno.Sugeno` for a system.

    Memberships, one per rule, three per product or one per minimum, the sum, then rounding or a division.
    """
    inputs = len(system.inputs)
    combining, rounding = (3 * (inputs - 2), 2) if system.conjunction == "product" else (inputs - 1, 11)
    return 2 + len(system.rules) + 1 + combining + 4 + rounding


@dataclass(frozen=True, eq=False)
class FrameWork:
    """Size, counts and matches of a frame, on which its clocks depend."""

    width_px: int
    height_px: int
    good: bool
    left: int
    """Number of features of the reference."""
    right: int
    """Number of features of this frame; 0 where there is nothing to match."""
    rows: NDArray[np.integer]
    """Left indices (N,) of the mutual matches, rising."""
    estimate_cycles: int | None = None
    """``cycles`` of the frame's homography; None without an estimator."""


@dataclass(frozen=True)
class Timeline:
    """Clocks of a frame, counted from the first pixel of the first frame."""

    first_pixel: int
    """It is taken at the input."""
    last_pixel: int
    """It is taken at the input."""
    features_end: int
    """Last word of the features' packet, which is that of the status."""
    accepted: int
    """The matcher takes the frame, and the banks change roles."""
    searched: int
    """All distances have been compared; equal to ``accepted`` for a bad frame, as are the following ones."""
    counted: int
    """The common orientation is known."""
    weighed: int
    """The last match has its weight."""
    matches_end: int
    """Last word of the matches' packet."""
    homography_end: int | None = None
    """Last word of the homography; None without an estimator."""

    def steps(self) -> Iterator[tuple[str, int]]:
        """Return name and clock of each step of the frame, in their order."""
        return ((name, clock) for name, clock in vars(self).items() if clock is not None)

    def delay(self, cycles: int) -> Timeline:
        """Return the same timeline, ``cycles`` clocks later."""
        return Timeline(**{name: clock + cycles for name, clock in self.steps()})

    @property
    def status_cycles(self) -> int:
        """``cycles`` of the frame's status."""
        return self.last_pixel - self.first_pixel + 1


def timelines(works: Sequence[FrameWork], config: Config, *, lanes: int, pixels_per_clock: int = 1) -> list[Timeline]:
    """Predict frames that follow each other without a pause.

    With two pixels per clock, the last pixel of a line of odd width takes a clock of its own.

    Returns
    -------
    list of Timeline
        Shorter than ``works`` where the rest cannot be predicted (see the module's docstring).
    """
    if not config.front_end.selection:
        return []
    works = list(itertools.takewhile(lambda work: _leaves_in_time(work, config.front_end, pixels_per_clock), works))
    line_cycles = [-(-work.width_px // pixels_per_clock) for work in works]
    return list(_timelines(works, line_cycles, Latencies.compute(config, lanes=lanes), config.front_end.border_px))


def steady_pace(work: FrameWork, config: Config, *, lanes: int) -> tuple[int, int] | None:
    """Clocks from one such frame to the next, and from last pixel to last match; None where they cannot be predicted.

    The slower of pixels and matching, with the homography if the frame has one, sets the pace.
    """
    lines = timelines([work, work], config, lanes=lanes)
    if not lines:
        return None
    first, second = lines
    return second.accepted - first.accepted, first.matches_end - first.last_pixel


def _timelines(
    works: Sequence[FrameWork], line_cycles: Sequence[int], latencies: Latencies, border_px: int
) -> Iterator[Timeline]:
    first_pixel, idle = 0, 0
    for number, work in enumerate(works):
        last_pixel = first_pixel + line_cycles[number] * work.height_px - 1
        last_word = (
            last_pixel + latencies.admission + latencies.status + latencies.status_word * (latencies.record_words - 1)
        )
        # The same words go to the output's buffer and to the one before the matcher.
        arrived = last_word + 2 * latencies.skid_buffer
        accepted = max(arrived + 1, idle) + latencies.acceptance - 1
        searched, counted, weighed = _match_clocks(work, latencies, accepted)
        # The words of a record pass the output's buffer. The gate takes a clock to open for the first one of a packet:
        # for the status, if there are no matches.
        has_matches = work.good and len(work.rows) > 0
        matches_end = weighed + 1 + latencies.match_words + latencies.skid_buffer + (not has_matches)
        idle, homography_end = weighed + 1 + latencies.match_words, None
        if work.estimate_cycles is not None:
            # The matches' gate delays its words, not those for the estimator.
            idle = matches_end - 1 + work.estimate_cycles + CYCLES.records
            homography_end = idle + HOMOGRAPHY.record_bytes // WORD_BYTES - 1
        yield Timeline(
            first_pixel=first_pixel,
            last_pixel=last_pixel,
            features_end=arrived,
            accepted=accepted,
            searched=searched,
            counted=counted,
            weighed=weighed,
            matches_end=matches_end,
            homography_end=homography_end,
        )
        first_pixel = last_pixel + 1
        # A frame that waits for the matcher holds back the features of the next one, which come after its border.
        if number + 1 < len(works) and accepted > first_pixel + border_px * line_cycles[number + 1]:
            return


def _leaves_in_time(work: FrameWork, front_end: FrontEndConfig, pixels_per_clock: int) -> bool:
    """Whether each level's last two cell rows leave before pixels would wait for them, or the status.

    Only these end a few lines apart. All their cells are taken to be full, of all levels at once.
    """
    if front_end.cell_px is None or front_end.per_cell is None:
        front_end = front_end.for_size(work.width_px, work.height_px)
    assert front_end.cell_px
    assert front_end.per_cell
    record, border_px = front_end.pattern.record, front_end.border_px
    features, lines = 0, []
    for level in range(front_end.levels):
        features += -(-(work.width_px >> level) // front_end.cell_px) * front_end.per_cell
        # Lines of the last cell row that may have features.
        lines.append(((work.height_px >> level) - border_px - 1) % front_end.cell_px + 1 << level)
    # The smallest level is lower than the widest border.
    lines.append(min(border_px - front_end.lag_px, MIN_LEVEL_PX - 1))
    leaving_cycles = _ROW_CYCLES + features * record.record_bytes // WORD_BYTES
    return min(lines) * -(-work.width_px // pixels_per_clock) >= leaving_cycles


def _match_clocks(work: FrameWork, latencies: Latencies, accepted: int) -> tuple[int, int, int]:
    """Clocks in which a frame is searched, counted and weighed."""
    if not work.good:
        return accepted, accepted, accepted
    searched = accepted + latencies.search_start + _search_cycles(work, latencies)
    begins, counted = searched + 1, searched
    if latencies.peak:
        counted = _walk_ends(work, latencies.walk, latencies.count, begins)
        begins = counted + latencies.peak + 2
    weigh = latencies.weigh + (len(work.rows) == 1) * latencies.lone_match
    return searched, counted, _walk_ends(work, latencies.walk, weigh, begins)


def _search_cycles(work: FrameWork, latencies: Latencies) -> int:
    if not work.left or not work.right:
        return 0
    # See `Latencies.compute`.
    lanes = latencies.shortest_pass - 4
    return -(-work.left // lanes) * max(work.right, latencies.shortest_pass) + latencies.drain


def _walk_ends(work: FrameWork, walk_cycles: int, service_cycles: int, begins: int) -> int:
    """Clock in which a walk over all rows ends.

    One row is read per clock. Its match waits in a skid buffer: one at the output, one aside; while one is aside, no
    row is read.
    """
    rows = work.left if work.right else 0
    if not rows:
        return begins
    # Clock and row of the last match that entered the buffer, until when no row was read after it, and when it was
    # taken from the queue.
    entered, row, resumed, taken = begins + walk_cycles, 0, begins + walk_cycles, 0
    for index in work.rows.tolist():
        entered, row = resumed + index - row, index
        resumed = max(entered, taken)
        taken = resumed + service_cycles
    return max(resumed + rows - 1 - row, taken + 1)
