"""From the matches of a frame to a homography, without a processor."""

from amaranth import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.acceptance import CELLS
from golden_model.geometry.estimator import MAX_REFITTED_OFTEN, SEARCH_CYCLES, Cause
from golden_model.geometry.program import LANES, SLOTS, Program
from golden_model.geometry.programs import ADD, AREAS, CLEAR, FIT, GROUP, PROGRAMS, SOLVE
from golden_model.geometry.refit import BANDS, MAX_INLIERS
from golden_model.geometry.sampling import SAMPLE, STEPS
from golden_model.geometry.scoring import MAX_MATCHES
from hdl.geometry.match_gain import HYPOTHESIS, WEIGHED_PAIR
from hdl.geometry.ordering import FRAME_MATCH, MatchOrdering
from hdl.geometry.processor import Processor
from hdl.geometry.quantiser import Quantiser
from hdl.geometry.sampling import COUNT, DRAWS, SampleDraws
from hdl.geometry.sweep import SCORE, SUPPORT, Sweep
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.lib.views import view_signal

SETTINGS = data.StructLayout({"passes": 8, "seed": 32, "min_inliers": 12, "min_cells": range(CELLS**2 + 1)})
"""See `golden_model.config.EstimatorConfig`."""
ESTIMATE = data.StructLayout(
    {
        "homography": HYPOTHESIS,
        "score": SCORE,
        "support": SUPPORT,
        "inliers": COUNT,
        "cells": range(CELLS**2 + 1),
        "causes": len(Cause),
        "frame": 32,
        "cycles": 32,
    }
)
"""See `golden_model.geometry.estimator.Estimate`."""
BEST = 1 << LANES
"""Bit of the best homography so far among those to score; the others are those of the lanes."""
GATHER_CYCLES = 2 * LineMemory.latency_cycles + GROUP + 1
TURN_CYCLES = max(Quantiser.latency_cycles, SampleDraws.latency_cycles + DRAWS + LineMemory.latency_cycles) + 1


class HomographyEstimator(wiring.Component):
    """One homography for every frame of matches; equals `golden_model.geometry.estimator.estimate`, clocks included.

    While the matches of a frame are in use, those of the next one are stored.

    Parameters
    ----------
    max_matches : int
        Matches that each of the two memories holds, 4 to 2048.
    """

    i: stream.Interface
    """Stream of `hdl.geometry.ordering.FRAME_MATCH`."""
    i_settings: data.View
    """Taken when the last match of a frame has come."""
    o: stream.Interface
    """Stream of `ESTIMATE`, one per frame."""

    def __init__(self, *, max_matches: int = MAX_MATCHES) -> None:
        if not SAMPLE <= max_matches <= MAX_MATCHES:
            raise ValueError(f"max_matches is {max_matches}; it must be {SAMPLE} to {MAX_MATCHES}")
        self._ordering = MatchOrdering(max_matches=max_matches)
        self._matches = LineMemory(shape=WEIGHED_PAIR, depth=max_matches)
        self._list = LineMemory(shape=range(max_matches), depth=MAX_INLIERS)
        self._slots = LineMemory(shape=WEIGHED_PAIR, depth=SLOTS)
        self._draws, self._processor, self._quantiser, self._sweep = SampleDraws(), Processor(), Quantiser(), Sweep()
        super().__init__(
            {
                "i": In(stream.Signature(FRAME_MATCH)),
                "i_settings": In(SETTINGS),
                "o": Out(stream.Signature(ESTIMATE)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Connect the parts, and lead them through search, refit and acceptance."""
        m = Module()
        m.submodules.ordering, m.submodules.matches = self._ordering, self._matches
        m.submodules.list, m.submodules.slots = self._list, self._slots
        m.submodules.draws, m.submodules.processor = self._draws, self._processor
        m.submodules.quantiser, m.submodules.sweep = self._quantiser, self._sweep
        wiring.connect(m, wiring.flipped(self.i), self._ordering.i)
        # Of the frame whose matches are in use.
        self._count = Signal(COUNT)
        self._frame = view_signal(self._ordering.o_frame.shape())
        self._settings = view_signal(SETTINGS)
        self._cycles = Signal(32)
        self._round = Signal(range(len(BANDS) + 1))
        self._refitted_score = Signal(SCORE)
        self._is_last = Signal()
        self._group = Signal(range(MAX_INLIERS // GROUP + 1))
        m.d.comb += [
            self._draws.i_count.eq(self._count),
            self._draws.i_seed.eq(self._settings.seed),
            *(
                centre.eq(self._frame[side] << 3)
                for centre, side in zip(self._processor.i_centre, ("width", "height"), strict=True)
            ),
            self._processor.i_register.eq(self._quantiser.o_register),
            self._quantiser.i_number.eq(self._processor.o_register),
            self._quantiser.i_exponents.eq(self._processor.o_exponents),
            self._sweep.i_count.eq(self._count),
            self._sweep.i_size.eq(Cat(self._frame.width, self._frame.height)),
        ]
        # Every program and every score is complete.
        self._idle = Signal()
        self._fetch(m)
        self._start_sweeps(m)
        self._control(m)
        self._send(m)
        return m

    def _fetch(self, m: Module) -> None:
        """Copy matches into the slots: those drawn, or a group of the list; and write matches and list."""
        gather = Signal(range(GATHER_CYCLES + 1))
        self._gather = Signal()
        self._gathered = Signal()
        with m.If(self._gather | (gather != 0)):
            m.d.sync += gather.eq(Mux(gather == GATHER_CYCLES, 0, gather + 1))
        m.d.comb += self._gathered.eq(gather == GATHER_CYCLES)
        position = Signal(range(MAX_INLIERS))
        m.d.comb += position.eq(self._group * GROUP + (gather - 1)[: (GROUP - 1).bit_length()])
        asks = (gather != 0) & (gather <= GROUP)
        found = delayed(m, asks, LineMemory.latency_cycles, reset_less=False)
        beyond = delayed(m, position >= self._sweep.o_listed, LineMemory.latency_cycles)
        slot = Signal(range(SLOTS))
        fetches = found | self._draws.o_valid
        with m.If(fetches):
            m.d.sync += slot.eq(slot + 1)
        with m.Elif(self._gather | self._draws.i_start):
            m.d.sync += slot.eq(0)
        fetched = delayed(m, fetches, LineMemory.latency_cycles, reset_less=False)
        is_void = delayed(m, found & beyond, LineMemory.latency_cycles)
        match = view_signal(WEIGHED_PAIR)
        m.d.comb += match.eq(self._matches.o_word)
        with m.If(is_void):
            # Without a weight it adds nothing.
            m.d.comb += match.weight.eq(0)
        m.d.comb += [
            self._list.i_read.eq(1),
            self._list.i_read_address.eq(position),
            self._list.i_write.eq(self._sweep.o_list),
            self._list.i_write_address.eq(self._sweep.o_listed),
            self._list.i_word.eq(self._sweep.o_listed_address),
            self._matches.i_read.eq(1),
            self._matches.i_read_address.eq(
                Mux(found, self._list.o_word, Mux(self._draws.o_valid, self._draws.o_rank, self._sweep.o_address))
            ),
            self._matches.i_write.eq(self._ordering.o_write),
            self._matches.i_write_address.eq(self._ordering.o_address),
            self._matches.i_word.eq(self._ordering.o_match),
            self._sweep.i_match.eq(match),
            self._slots.i_write.eq(fetched),
            self._slots.i_write_address.eq(delayed(m, slot, LineMemory.latency_cycles)),
            self._slots.i_word.eq(match),
            self._slots.i_read.eq(1),
            self._slots.i_read_address.eq(self._processor.o_slot),
            self._processor.i_match.eq(self._slots.o_word),
        ]

    def _start_sweeps(self, m: Module) -> None:
        """Sweep the homographies that are due, one after the other, and keep the best."""
        sweep = self._sweep
        # A bit per lane, and one for the best homography so far.
        self._due = Signal(LANES + 1)
        # Lanes whose homography may become the best.
        self._valid = Signal(LANES)
        self._best = view_signal(HYPOTHESIS)
        self._best_score = Signal(SCORE)
        hypothesis = view_signal(HYPOTHESIS, reset_less=True)
        chosen = Signal(LANES + 1)
        running = Signal()
        m.d.comb += [
            sweep.i_hypothesis.eq(hypothesis),
            sweep.i_band.eq(self._band()),
            self._idle.eq(~self._processor.o_busy & ~self._due.any()),
        ]
        with m.If(~running & self._due.any()):
            m.d.sync += [running.eq(1), sweep.i_start.eq(1)]
            for n, source in reversed(
                list(enumerate((*(self._quantiser.o[lane] for lane in range(LANES)), self._best)))
            ):
                with m.If(self._due[n]):
                    m.d.sync += [hypothesis.eq(source), chosen.eq(1 << n)]
        with m.Elif(sweep.i_start):
            m.d.sync += sweep.i_start.eq(0)
        with m.Elif(running & ~sweep.o_busy):
            m.d.sync += [running.eq(0), self._due.eq(self._due & ~chosen)]
            with m.If((chosen[:LANES] & self._valid).any() & (sweep.o_score > self._best_score)):
                m.d.sync += [self._best.eq(hypothesis), self._best_score.eq(sweep.o_score)]

    def _run(self, m: Module, program: Program) -> None:
        """Start a program in this clock."""
        m.d.comb += [self._processor.i_start.eq(1), self._processor.i_program.eq(PROGRAMS.index(program))]

    def _control(self, m: Module) -> None:
        """Lead a frame from its matches to the result."""
        self._causes = Signal(len(Cause))
        self._turn = Signal(range(TURN_CYCLES + 1))
        m.d.sync += self._cycles.eq(self._cycles + 1)
        with m.FSM():
            self._accept(m)
            self._search(m)
            self._refit(m)
            with m.State("Check"), m.If(~self._due.any()):
                few = self._sweep.o_inliers < self._settings.min_inliers
                narrow = self._sweep.o_cells < self._settings.min_cells
                m.d.sync += self._causes.eq(Mux(few, Cause.TOO_FEW_INLIERS, 0) | Mux(narrow, Cause.TOO_FEW_CELLS, 0))
                m.next = "Send"
            with m.State("Send"):
                m.d.comb += self.o.valid.eq(1)
                m.d.sync += self._cycles.eq(self._cycles)
                with m.If(self.o.ready):
                    m.next = "Wait"

    def _accept(self, m: Module) -> None:
        """Take a frame's matches, or refuse them."""
        ordering = self._ordering
        with m.State("Wait"):
            m.d.sync += [
                self._cycles.eq(1),
                self._count.eq(ordering.o_count),
                self._frame.eq(ordering.o_frame),
                self._settings.eq(self.i_settings),
                self._best.as_value().eq(0),
                self._best_score.eq(0),
                self._causes.eq(self._refusal()),
            ]
            with m.If(ordering.o_complete):
                m.next = "Accept-Frame"
        with m.State("Accept-Frame"):
            with m.If(self._causes.any()):
                m.d.comb += ordering.i_discard.eq(1)
                m.next = "Send"
            with m.Else():
                m.d.comb += ordering.i_sort.eq(1)
                m.next = "Sort"

    def _search(self, m: Module) -> None:
        """Draw, solve and score samples, step by step."""
        step = Signal(range(STEPS + 1))
        passes = Signal(self._settings.passes.shape())
        # Lanes whose sample is worth solving.
        passed = Signal(LANES)
        # The step has had its passes, of which the last is to be scored; and whether it took longer than its share.
        closes = Signal()
        is_late = Signal()
        elapsed = Signal(range(2 * SEARCH_CYCLES))
        limit = Signal(range(SEARCH_CYCLES + 1))
        share = SEARCH_CYCLES // STEPS
        m.d.comb += self._draws.i_step.eq(step)
        m.d.sync += elapsed.eq(elapsed + 1)
        with m.State("Sort"):
            m.d.comb += self._draws.i_restart.eq(1)
            m.d.sync += [step.eq(0), passes.eq(0), elapsed.eq(0), limit.eq(share), self._valid.eq(0)]
            m.d.sync += [closes.eq(0), self._refitted_score.eq(0)]
            with m.If(self._ordering.o_sorted):
                m.next = "Draw"
        # What the last pass has solved is quantised, while the samples of the next are fetched.
        with m.State("Draw"):
            m.d.comb += [self._draws.i_start.eq(~closes), self._quantiser.i_start.eq(1)]
            m.d.sync += self._turn.eq(1)
            m.next = "Turn"
        with m.State("Turn"):
            m.d.sync += self._turn.eq(self._turn + 1)
            with m.If(self._turn == TURN_CYCLES):
                m.d.sync += self._due.eq(self._valid)
                m.next = "Measure"
                with m.If(closes):
                    m.next = "Close-Step"
        with m.State("Measure"):
            self._run(m, AREAS)
            m.next = "Solve"
        with m.State("Solve"), m.If(~self._processor.o_busy):
            m.d.sync += passed.eq(self._processor.o_passed)
            m.next = "Search"
            with m.If(self._processor.o_passed.any()):
                self._run(m, SOLVE)
        with m.State("Search"), m.If(self._idle):
            m.d.sync += [passes.eq(passes + 1), self._valid.eq(passed)]
            with m.If((passes + 1 == self._settings.passes) | (elapsed >= limit)):
                m.d.sync += [passes.eq(0), step.eq(step + 1), limit.eq(limit + share)]
                m.d.sync += [closes.eq(1), is_late.eq(elapsed >= limit)]
            m.next = "Draw"
        self._close_step(m, step == STEPS, is_late, closes)

    def _close_step(self, m: Module, is_last: Value, is_late: Value, closes: Signal) -> None:
        """When all samples of a step are scored, refit the best homography if it is new, and go on or end."""
        has_time = ~is_late & (self._count <= MAX_REFITTED_OFTEN)
        with m.State("Close-Step"), m.If(~self._due.any()):
            m.d.sync += [closes.eq(0), self._valid.eq(0), self._round.eq(0), self._is_last.eq(is_last)]
            m.next = "Draw"
            with m.If(is_last & (self._best_score == 0)):
                m.d.sync += self._causes.eq(Cause.NO_HYPOTHESIS)
                m.next = "Send"
            with m.Elif((self._best_score > self._refitted_score) & (has_time | is_last)):
                m.d.sync += self._due.eq(BEST)
                m.next = "List"
            with m.Elif(is_last):
                m.d.sync += self._due.eq(BEST)
                m.next = "Check"

    def _refit(self, m: Module) -> None:
        """Fit the listed inliers, round by round."""
        with m.State("List"), m.If(~self._due.any()):
            m.d.sync += self._group.eq(0)
            with m.If(self._round == len(BANDS)):
                m.d.sync += [self._refitted_score.eq(self._best_score), self._valid.eq(0)]
                m.next = "Draw"
                with m.If(self._is_last):
                    m.d.sync += self._due.eq(BEST)
                    m.next = "Check"
            with m.Else():
                self._run(m, CLEAR)
                m.next = "Add"
        with m.State("Add"):
            with m.If(self._idle & (self._group * GROUP >= self._sweep.o_listed)):
                self._run(m, FIT)
                m.next = "Fit"
            with m.Elif(self._idle):
                m.d.comb += self._gather.eq(1)
                m.next = "Gather"
        with m.State("Gather"), m.If(self._gathered):
            self._run(m, ADD)
            m.d.sync += self._group.eq(self._group + 1)
            m.next = "Begin-Add"
        # The processor is busy from the clock after its start.
        with m.State("Begin-Add"):
            m.next = "Add"
        with m.State("Fit"), m.If(self._idle):
            m.d.comb += self._quantiser.i_start.eq(1)
            m.d.sync += [self._valid.eq(self._processor.o_passed[0]), self._turn.eq(1)]
            m.next = "Quantise"
        with m.State("Quantise"):
            m.d.sync += self._turn.eq(self._turn + 1)
            with m.If(self._turn == TURN_CYCLES):
                m.d.sync += [self._due.eq(1), self._round.eq(self._round + 1)]
                m.next = "List"

    def _band(self) -> Value:
        """Band of the round; after the last one nothing reads the list."""
        band: Value = Value.cast(BANDS[-1])
        for n, each in reversed(list(enumerate(BANDS))):
            band = Mux(self._round == n, each, band)
        return band

    def _refusal(self) -> Value:
        """Why the frame has no homography at all."""
        ordering = self._ordering
        invalid = (self.i_settings.seed == 0) | (self.i_settings.passes == 0)
        return (
            Mux(~ordering.o_frame.good, Cause.BAD_FRAME, 0)
            | Mux(invalid, Cause.INVALID_SETTINGS, 0)
            | Mux((ordering.o_count < SAMPLE) & ordering.o_frame.good, Cause.TOO_FEW_MATCHES, 0)
            | Mux(ordering.o_too_many & ordering.o_frame.good, Cause.TOO_MANY_MATCHES, 0)
        )

    def _send(self, m: Module) -> None:
        """The result; nothing but its causes where there is no homography."""
        result, has_score = self.o.payload, self._best_score != 0
        m.d.comb += [
            result.homography.eq(self._best),
            result.score.eq(self._best_score),
            result.causes.eq(self._causes),
            result.frame.eq(self._frame.frame),
            result.cycles.eq(self._cycles),
        ]
        with m.If(has_score):
            m.d.comb += [
                result.support.eq(self._sweep.o_support),
                result.inliers.eq(self._sweep.o_inliers),
                result.cells.eq(self._sweep.o_cells),
            ]
