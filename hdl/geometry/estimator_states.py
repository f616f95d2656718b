"""The states that lead a frame from its matches to its homography, in `hdl.geometry.estimator`.

============  ================================================================  =======================================
state         what is done                                                      followed by
============  ================================================================  =======================================
Wait          matches of the frame arrive                                       Accept-Frame
Accept-Frame  the frame is refused, or sorting begins                           Send or Sort
Sort          matches move to the ranks of their weights                        Draw
Draw          starts the draws, and the quantiser on what the last pass solved  Turn
Turn          both end: new homographies are due for scoring                    Measure; after a step's last Close-Step
Measure       starts the areas of the samples                                   Solve
Solve         they end; starts the solver, if a sample keeps its orientation    Search
Search        programs and scores end: the pass is counted                      Draw
Close-Step    the last scores end; a new best homography is due again           Draw, List; at last List, Check, Send
List          its inliers in the round's band are listed                        Add; after the last round Draw or Check
Add           asks for the next group of them; without one, starts the fit      Gather or Fit
Gather        the group is copied; starts its sums                              Begin-Add
Begin-Add     the processor becomes busy                                        Add
Fit           the fit ends; starts the quantiser                                Quantise
Quantise      it ends: the fitted homography is due for scoring                 List
Check         the best homography has been scored again, for its inliers        Send
Send          the result is offered                                             Wait
============  ================================================================  =======================================
"""

from typing import NamedTuple

from amaranth import Module, Mux, Signal, Value
from amaranth.lib import data, stream

from golden_model.geometry.estimator import MAX_REFITTED_OFTEN, SEARCH_CYCLES, EstimateCause
from golden_model.geometry.program import LANES, Program
from golden_model.geometry.programs import ADD, AREAS, CLEAR, FIT, GROUP, PROGRAMS, SOLVE
from golden_model.geometry.refit import BANDS, MAX_INLIERS
from golden_model.geometry.sampling import SAMPLE, STEPS
from hdl.geometry.match_gain import HYPOTHESIS
from hdl.geometry.ordering import FRAME, MatchOrdering
from hdl.geometry.processor import Processor
from hdl.geometry.quantiser import Quantiser
from hdl.geometry.sampling import COUNT, DRAWS, SampleDraws
from hdl.geometry.sweep import SCORE, Sweep
from hdl.lib.line_memory import LineMemory
from hdl.lib.views import view_signal
from hdl.settings import ESTIMATION

ESTIMATOR_SETTINGS = data.StructLayout({setting.name: setting.bits for setting in ESTIMATION})
"""See `golden_model.config.EstimatorConfig`."""
BEST = 1 << LANES
"""Bit of the best homography so far among those to score; the others are those of the lanes."""
TURN_CYCLES = max(Quantiser.latency_cycles, SampleDraws.latency_cycles + DRAWS + LineMemory.latency_cycles) + 1


class Parts(NamedTuple):
    """What the states lead."""

    ordering: MatchOrdering
    draws: SampleDraws
    processor: Processor
    quantiser: Quantiser
    sweep: Sweep

    def run(self, m: Module, program: Program) -> None:
        """Start a program in this clock."""
        m.d.comb += [self.processor.i_start.eq(1), self.processor.i_program.eq(PROGRAMS.index(program))]


class FrameInWork:
    """The frame whose matches are in use: what the states share with the data path, and with each other."""

    def __init__(self) -> None:
        self.count = Signal(COUNT)
        """Number of matches."""
        self.header = view_signal(FRAME)
        self.settings = view_signal(ESTIMATOR_SETTINGS)
        self.cycles = Signal(32)
        """Clocks since the last match."""
        self.causes = Signal(len(EstimateCause))
        self.best = view_signal(HYPOTHESIS)
        """The best homography so far; 0: none."""
        self.best_score = Signal(SCORE)
        self.refitted_score = Signal(SCORE)
        """Score of the best homography after its last refit."""
        self.due = Signal(LANES + 1)
        """Homographies to score: a bit per lane, and `BEST`."""
        self.valid = Signal(LANES)
        """Lanes whose homography may become the best."""
        self.turn = Signal(range(TURN_CYCLES + 1))
        """Clocks since the quantiser started."""
        self.is_last = Signal()
        """No step follows."""
        self.round = Signal(range(len(BANDS) + 1))
        """Rounds of the refit that have been fitted; 0: there is no refit under way."""
        self.group = Signal(range(MAX_INLIERS // GROUP + 1))
        """Groups of the list that have been added."""
        self.gather = Signal()
        """Copy the next group."""
        self.gathered = Signal()
        """It is copied."""


class _Search:
    """Progress of the search."""

    def __init__(self, settings: data.View) -> None:
        self.step = Signal(range(STEPS + 1))
        self.passes = Signal(settings.passes.shape())
        """Passes of the step."""
        self.closes = Signal()
        """The step has had its passes, of which the last is to be scored."""
        self.is_late = Signal()
        """They took longer than their share."""
        self.elapsed = Signal(range(2 * SEARCH_CYCLES))
        self.limit = Signal(range(SEARCH_CYCLES + 1))
        """End of the step's share."""


def lead(m: Module, parts: Parts, frame: FrameInWork, settings: data.View, o: stream.Interface) -> None:
    """All states; ``o`` offers the frame's result."""
    search, idle = _Search(frame.settings), Signal()
    m.d.sync += frame.cycles.eq(frame.cycles + 1)
    # Every program and every score is complete.
    m.d.comb += idle.eq(~parts.processor.o_busy & ~frame.due.any())
    with m.FSM():
        _accept(m, parts, frame, settings)
        _begin_search(m, parts, frame, search)
        _draw(m, parts, frame, search)
        _solve(m, parts, frame, search, idle)
        _close_step(m, frame, search)
        _list_inliers(m, parts, frame)
        _add_up(m, parts, frame, idle)
        _fit(m, parts, frame, idle)
        with m.State("Check"), m.If(~frame.due.any()):
            few = parts.sweep.o_inliers < frame.settings.min_inliers
            narrow = parts.sweep.o_cells < frame.settings.min_cells
            inliers = Mux(few, EstimateCause.TOO_FEW_INLIERS, 0)
            m.d.sync += frame.causes.eq(inliers | Mux(narrow, EstimateCause.TOO_FEW_CELLS, 0))
            m.next = "Send"
        with m.State("Send"):
            m.d.comb += o.valid.eq(1)
            m.d.sync += frame.cycles.eq(frame.cycles)
            with m.If(o.ready):
                m.next = "Wait"


def _accept(m: Module, parts: Parts, frame: FrameInWork, settings: data.View) -> None:
    ordering = parts.ordering
    with m.State("Wait"):
        m.d.sync += [
            frame.cycles.eq(1),
            frame.count.eq(ordering.o_count),
            frame.header.eq(ordering.o_frame),
            frame.settings.eq(settings),
            frame.best.as_value().eq(0),
            frame.best_score.eq(0),
            frame.causes.eq(_refusal(ordering, settings)),
        ]
        with m.If(ordering.o_complete):
            m.next = "Accept-Frame"
    with m.State("Accept-Frame"):
        with m.If(frame.causes.any()):
            m.d.comb += ordering.i_discard.eq(1)
            m.next = "Send"
        with m.Else():
            m.d.comb += ordering.i_sort.eq(1)
            m.next = "Sort"


def _refusal(ordering: MatchOrdering, settings: data.View) -> Value:
    """Why the frame has no homography at all."""
    invalid = (settings.seed == 0) | (settings.passes == 0)
    return (
        Mux(~ordering.o_frame.good, EstimateCause.BAD_FRAME, 0)
        | Mux(invalid, EstimateCause.INVALID_SETTINGS, 0)
        | Mux((ordering.o_count < SAMPLE) & ordering.o_frame.good, EstimateCause.TOO_FEW_MATCHES, 0)
        | Mux(ordering.o_too_many & ordering.o_frame.good, EstimateCause.TOO_MANY_MATCHES, 0)
    )


def _begin_search(m: Module, parts: Parts, frame: FrameInWork, search: _Search) -> None:
    m.d.comb += parts.draws.i_step.eq(search.step)
    m.d.sync += search.elapsed.eq(search.elapsed + 1)
    with m.State("Sort"):
        m.d.comb += parts.draws.i_restart.eq(1)
        m.d.sync += [
            search.step.eq(0),
            search.passes.eq(0),
            search.elapsed.eq(0),
            search.limit.eq(SEARCH_CYCLES // STEPS),
            frame.valid.eq(0),
            search.closes.eq(0),
            frame.refitted_score.eq(0),
        ]
        with m.If(parts.ordering.o_sorted):
            m.next = "Draw"


def _draw(m: Module, parts: Parts, frame: FrameInWork, search: _Search) -> None:
    """Quantise what the last pass has solved, while the samples of the next one are fetched."""
    with m.State("Draw"):
        m.d.comb += [parts.draws.i_start.eq(~search.closes), parts.quantiser.i_start.eq(1)]
        m.d.sync += frame.turn.eq(1)
        m.next = "Turn"
    with m.State("Turn"):
        m.d.sync += frame.turn.eq(frame.turn + 1)
        with m.If(frame.turn == TURN_CYCLES):
            m.d.sync += frame.due.eq(frame.valid)
            m.next = "Measure"
            with m.If(search.closes):
                m.next = "Close-Step"


def _solve(m: Module, parts: Parts, frame: FrameInWork, search: _Search, idle: Value) -> None:
    """Solve the samples that are worth it, and count the pass."""
    passed = Signal(LANES)
    with m.State("Measure"):
        parts.run(m, AREAS)
        m.next = "Solve"
    with m.State("Solve"), m.If(~parts.processor.o_busy):
        m.d.sync += passed.eq(parts.processor.o_passed)
        m.next = "Search"
        with m.If(parts.processor.o_passed.any()):
            parts.run(m, SOLVE)
    with m.State("Search"), m.If(idle):
        is_late = search.elapsed >= search.limit
        m.d.sync += [search.passes.eq(search.passes + 1), frame.valid.eq(passed)]
        with m.If((search.passes + 1 == frame.settings.passes) | is_late):
            m.d.sync += [search.passes.eq(0), search.step.eq(search.step + 1)]
            m.d.sync += search.limit.eq(search.limit + SEARCH_CYCLES // STEPS)
            m.d.sync += [search.closes.eq(1), search.is_late.eq(is_late)]
        m.next = "Draw"


def _close_step(m: Module, frame: FrameInWork, search: _Search) -> None:
    """When all samples of a step are scored, refit the best homography if it is new, and go on or end."""
    is_last = search.step == STEPS
    has_time = ~search.is_late & (frame.count <= MAX_REFITTED_OFTEN)
    with m.State("Close-Step"), m.If(~frame.due.any()):
        m.d.sync += [search.closes.eq(0), frame.valid.eq(0), frame.round.eq(0), frame.is_last.eq(is_last)]
        m.next = "Draw"
        with m.If(is_last & (frame.best_score == 0)):
            m.d.sync += frame.causes.eq(EstimateCause.NO_HYPOTHESIS)
            m.next = "Send"
        with m.Elif((frame.best_score > frame.refitted_score) & (has_time | is_last)):
            m.d.sync += frame.due.eq(BEST)
            m.next = "List"
        with m.Elif(is_last):
            m.d.sync += frame.due.eq(BEST)
            m.next = "Check"


def _list_inliers(m: Module, parts: Parts, frame: FrameInWork) -> None:
    """Begin a round of the refit with the inliers that the last score has listed, or end it."""
    with m.State("List"), m.If(~frame.due.any()):
        m.d.sync += frame.group.eq(0)
        with m.If(frame.round == len(BANDS)):
            m.d.sync += [frame.refitted_score.eq(frame.best_score), frame.valid.eq(0), frame.round.eq(0)]
            m.next = "Draw"
            with m.If(frame.is_last):
                m.d.sync += frame.due.eq(BEST)
                m.next = "Check"
        with m.Else():
            parts.run(m, CLEAR)
            m.next = "Add"


def _add_up(m: Module, parts: Parts, frame: FrameInWork, idle: Value) -> None:
    """Add the listed inliers to the sums, group by group."""
    with m.State("Add"):
        with m.If(idle & (frame.group * GROUP >= parts.sweep.o_listed)):
            parts.run(m, FIT)
            m.next = "Fit"
        with m.Elif(idle):
            m.d.comb += frame.gather.eq(1)
            m.next = "Gather"
    with m.State("Gather"), m.If(frame.gathered):
        parts.run(m, ADD)
        m.d.sync += frame.group.eq(frame.group + 1)
        m.next = "Begin-Add"
    # The processor is busy from the clock after its start.
    with m.State("Begin-Add"):
        m.next = "Add"


def _fit(m: Module, parts: Parts, frame: FrameInWork, idle: Value) -> None:
    """Make the fitted homography that of the first lane, and have it scored."""
    with m.State("Fit"), m.If(idle):
        m.d.comb += parts.quantiser.i_start.eq(1)
        m.d.sync += [frame.valid.eq(parts.processor.o_passed[0]), frame.turn.eq(1)]
        m.next = "Quantise"
    with m.State("Quantise"):
        m.d.sync += frame.turn.eq(frame.turn + 1)
        with m.If(frame.turn == TURN_CYCLES):
            m.d.sync += [frame.due.eq(1), frame.round.eq(frame.round + 1)]
            m.next = "List"
