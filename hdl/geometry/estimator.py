"""From the matches of a frame to a homography, without a processor."""

from amaranth import Array, Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import check_range
from golden_model.geometry.acceptance import CELLS
from golden_model.geometry.estimator import MAX_MATCHES, REFIT_MARGIN_LOG2, EstimateCause
from golden_model.geometry.program import LANES, SLOTS
from golden_model.geometry.programs import GROUP
from golden_model.geometry.refit import BANDS, MAX_INLIERS
from golden_model.geometry.sampling import SAMPLE
from hdl.geometry.estimator_states import ESTIMATOR_SETTINGS, FrameInWork, Parts, lead
from hdl.geometry.match_gain import HYPOTHESIS, WEIGHED_PAIR
from hdl.geometry.ordering import FRAME_MATCH, MatchOrdering
from hdl.geometry.processor import Processor
from hdl.geometry.quantiser import Quantiser
from hdl.geometry.sampling import COUNT, SampleDraws
from hdl.geometry.sweep import SCORE, SUPPORT, Sweep
from hdl.lib.delay import delayed
from hdl.lib.line_memory import LineMemory
from hdl.lib.views import view_signal

ESTIMATE = data.StructLayout(
    {
        "homography": HYPOTHESIS,
        "score": SCORE,
        "support": SUPPORT,
        "inliers": COUNT,
        "cells": range(CELLS**2 + 1),
        "causes": len(EstimateCause),
        "frame": 32,
        "reference": 16,
        "cycles": 32,
    }
)
"""See `golden_model.geometry.estimator.Estimate`."""
GATHER_CYCLES = 2 * LineMemory.latency_cycles + GROUP + 1


class HomographyEstimator(wiring.Component):
    """One homography for every frame of matches; equals `golden_model.geometry.estimator.estimate`, clocks included.

    While the matches of a frame are in use, those of the next one are stored.

    Parameters
    ----------
    max_matches : int
        Matches that each of the two memories holds, 4 to 2048.
    """

    i: In(stream.Signature(FRAME_MATCH))
    i_settings: In(ESTIMATOR_SETTINGS)
    """Taken when the last match of a frame has come."""
    o: Out(stream.Signature(ESTIMATE))
    """One per frame."""

    def __init__(self, *, max_matches: int = MAX_MATCHES) -> None:
        check_range("max_matches", max_matches, SAMPLE, MAX_MATCHES)
        self._parts = Parts(MatchOrdering(max_matches=max_matches), SampleDraws(), Processor(), Quantiser(), Sweep())
        self._matches = LineMemory(shape=WEIGHED_PAIR, depth=max_matches)
        self._list = LineMemory(shape=range(max_matches), depth=MAX_INLIERS)
        self._slots = LineMemory(shape=WEIGHED_PAIR, depth=SLOTS)
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Connect the parts, and lead them through search, refit and acceptance."""
        m = Module()
        parts, frame = self._parts, FrameInWork()
        m.submodules.ordering, m.submodules.matches = parts.ordering, self._matches
        m.submodules.list, m.submodules.slots = self._list, self._slots
        m.submodules.draws, m.submodules.processor = parts.draws, parts.processor
        m.submodules.quantiser, m.submodules.sweep = parts.quantiser, parts.sweep
        wiring.connect(m, wiring.flipped(self.i), parts.ordering.i)
        m.d.comb += [
            parts.draws.i_count.eq(frame.count),
            parts.draws.i_seed.eq(frame.settings.seed),
            *(
                centre.eq(frame.header[side] << 3)
                for centre, side in zip(parts.processor.i_centre, ("width", "height"), strict=True)
            ),
            parts.processor.i_register.eq(parts.quantiser.o_register),
            parts.quantiser.i_number.eq(parts.processor.o_register),
            parts.quantiser.i_exponents.eq(parts.processor.o_exponents),
            parts.sweep.i_count.eq(frame.count),
            parts.sweep.i_size.eq(Cat(frame.header.width, frame.header.height)),
        ]
        self._fetch(m, frame, *self._read_list(m, frame))
        self._score(m, frame)
        lead(m, parts, frame, self.i_settings, self.o)
        self._send(m, frame)
        return m

    def _read_list(self, m: Module, frame: FrameInWork) -> tuple[Value, Value]:
        """Write the list, and read a group of it: whether it gives an address, and whether from beyond its end."""
        sweep, gather = self._parts.sweep, Signal(range(GATHER_CYCLES + 1))
        with m.If(frame.gather | (gather != 0)):
            m.d.sync += gather.eq(Mux(gather == GATHER_CYCLES, 0, gather + 1))
        m.d.comb += frame.gathered.eq(gather == GATHER_CYCLES)
        position = Signal(range(MAX_INLIERS))
        m.d.comb += [
            position.eq(frame.group * GROUP + (gather - 1)[: (GROUP - 1).bit_length()]),
            self._list.i_read.eq(1),
            self._list.i_read_address.eq(position),
            self._list.i_write.eq(sweep.o_list),
            self._list.i_write_address.eq(sweep.o_listed),
            self._list.i_word.eq(sweep.o_listed_address),
        ]
        asks = (gather != 0) & (gather <= GROUP)
        found = delayed(m, asks, LineMemory.latency_cycles, reset_less=False)
        beyond = delayed(m, position >= sweep.o_listed, LineMemory.latency_cycles)
        return found, beyond

    def _fetch(self, m: Module, frame: FrameInWork, found: Value, beyond: Value) -> None:
        """Store matches in their order, and copy some into the slots: those drawn, or those found in the list."""
        ordering, draws, processor, _, sweep = self._parts
        slot = Signal(range(SLOTS))
        fetches = found | draws.o_valid
        with m.If(fetches):
            m.d.sync += slot.eq(slot + 1)
        with m.Elif(frame.gather | draws.i_start):
            m.d.sync += slot.eq(0)
        fetched = delayed(m, fetches, LineMemory.latency_cycles, reset_less=False)
        is_void = delayed(m, found & beyond, LineMemory.latency_cycles)
        match = view_signal(WEIGHED_PAIR)
        m.d.comb += match.eq(self._matches.o_word)
        with m.If(is_void):
            # Without a weight it adds nothing.
            m.d.comb += match.weight.eq(0)
        drawn_or_swept = Mux(draws.o_valid, draws.o_rank, sweep.o_address)
        m.d.comb += [
            self._matches.i_read.eq(1),
            self._matches.i_read_address.eq(Mux(found, self._list.o_word, drawn_or_swept)),
            self._matches.i_write.eq(ordering.o_write),
            self._matches.i_write_address.eq(ordering.o_address),
            self._matches.i_word.eq(ordering.o_match),
            sweep.i_match.eq(match),
            self._slots.i_write.eq(fetched),
            self._slots.i_write_address.eq(delayed(m, slot, LineMemory.latency_cycles)),
            self._slots.i_word.eq(match),
            self._slots.i_read.eq(1),
            self._slots.i_read_address.eq(processor.o_slot),
            processor.i_match.eq(self._slots.o_word),
        ]

    def _score(self, m: Module, frame: FrameInWork) -> None:
        """Score the homographies that are due, one after the other, and keep the best."""
        sweep, quantised = self._parts.sweep, self._parts.quantiser.o
        hypothesis = view_signal(HYPOTHESIS, reset_less=True)
        chosen = Signal(LANES + 1)
        running = Signal()
        margin = Mux(frame.round.any(), sweep.o_score >> REFIT_MARGIN_LOG2, 0)
        # After the last round nothing reads the band.
        m.d.comb += [sweep.i_hypothesis.eq(hypothesis), sweep.i_band.eq(Array(BANDS)[frame.round])]
        with m.If(~running & frame.due.any()):
            m.d.sync += [running.eq(1), sweep.i_start.eq(1)]
            # The last assignment counts: the lowest bit goes first.
            for n, source in reversed([*enumerate(quantised), (LANES, frame.best)]):
                with m.If(frame.due[n]):
                    m.d.sync += [hypothesis.eq(source), chosen.eq(1 << n)]
        with m.Elif(sweep.i_start):
            m.d.sync += sweep.i_start.eq(0)
        with m.Elif(running & ~sweep.o_busy):
            m.d.sync += [running.eq(0), frame.due.eq(frame.due & ~chosen)]
            with m.If((chosen[:LANES] & frame.valid).any() & (sweep.o_score + margin > frame.best_score)):
                m.d.sync += [frame.best.eq(hypothesis), frame.best_score.eq(sweep.o_score)]

    def _send(self, m: Module, frame: FrameInWork) -> None:
        """The result; nothing but its causes where there is no homography."""
        result, sweep = self.o.payload, self._parts.sweep
        m.d.comb += [
            result.homography.eq(frame.best),
            result.score.eq(frame.best_score),
            result.causes.eq(frame.causes),
            result.frame.eq(frame.header.frame),
            result.reference.eq(frame.header.reference),
            result.cycles.eq(frame.cycles),
        ]
        with m.If(frame.best_score != 0):
            m.d.comb += [
                result.support.eq(sweep.o_support),
                result.inliers.eq(sweep.o_inliers),
                result.cells.eq(sweep.o_cells),
            ]
