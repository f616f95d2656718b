"""Stores the matches of a frame as they arrive, and hands them on in the order of their weights."""

from amaranth import Module, Mux, Signal
from amaranth.lib import data, stream
from amaranth.lib.wiring import In, Out

from golden_model.formats import WEIGHT
from golden_model.geometry.ordering import BINS
from hdl.geometry.match_gain import WEIGHED_PAIR
from hdl.lib.component import Component
from hdl.lib.line_memory import LineMemory

FRAME = data.StructLayout({"frame": 32, "reference": 16, "width": 16, "height": 16, "good": 1})
"""What is known about a frame after its matches."""
FRAME_MATCH = data.StructLayout({"match": WEIGHED_PAIR, "ends": 1, "frame": FRAME})
"""A match; or, with ``ends``, no match but the end of the frame's."""


PHASES = 2 * LineMemory.latency_cycles + 1
"""Clocks to place a match: it is read, then the rank of its weight."""


class MatchOrdering(Component):
    """Counting sort by falling weight, equal weights in their order; see `golden_model.geometry.ordering`.

    Matches are counted by weight as they arrive, one in four clocks. After the last one the block waits for
    ``i_sort`` or ``i_discard``: the next frame's matches are taken while those of this one are in use elsewhere.

    Parameters
    ----------
    max_matches : int
        Matches that are stored; that there were more is only noted.
    """

    i: In(stream.Signature(FRAME_MATCH))
    o_complete: Out(1)
    """All matches of a frame are there."""
    o_count: Signal
    """How many are stored."""
    o_too_many: Out(1)
    """There were more."""
    o_frame: Out(FRAME)
    i_sort: In(1)
    """While ``o_complete``: write all to ``o_address``."""
    i_discard: In(1)
    """While ``o_complete``: forget them."""
    o_sorted: Out(1)
    """The last match is written in this clock."""
    o_write: Out(1)
    o_address: Signal
    """Rank of ``o_match``, from 0."""
    o_match: Out(WEIGHED_PAIR)

    def __init__(self, *, max_matches: int) -> None:
        self._max_matches = max_matches
        self._matches = LineMemory(shape=WEIGHED_PAIR, depth=max_matches)
        # First counts, then ranks.
        self._ranks = LineMemory(shape=range(max_matches + 1), depth=BINS)
        super().__init__(o_count=Out(range(max_matches + 1)), o_address=Out(range(max_matches)))

    def elaborate(self, platform: object) -> Module:
        """Store and count; sum the counts up to first ranks; place every match at the next rank of its weight."""
        m = Module()
        m.submodules.matches, m.submodules.ranks = self._matches, self._ranks
        bin_ = Signal(range(BINS + self._ranks.latency_cycles))
        phase = Signal(range(PHASES))
        m.d.comb += [
            self._matches.i_write_address.eq(self.o_count),
            self._matches.i_word.eq(self.i.payload.match),
            self.o_match.eq(self._matches.o_word),
            self.o_address.eq(self._ranks.o_word),
        ]
        with m.FSM(init="Clear"):
            with m.State("Clear"):
                m.d.comb += [self._ranks.i_write.eq(1), self._ranks.i_write_address.eq(bin_)]
                m.d.sync += bin_.eq(bin_ + 1)
                with m.If(bin_ == BINS - 1):
                    m.d.sync += [bin_.eq(0), self.o_count.eq(0), self.o_too_many.eq(0)]
                    m.next = "Take"
            self._take(m, phase)
            with m.State("Wait"):
                m.d.comb += self.o_complete.eq(1)
                with m.If(self.i_discard):
                    m.next = "Clear"
                with m.Elif(self.i_sort):
                    m.next = "Sum"
            self._place(m, bin_, phase)
        return m

    def _take(self, m: Module, phase: Signal) -> None:
        ranks, sent = self._ranks, self.i.payload
        weight = Signal(WEIGHT.bits)
        with m.State("Take"):
            m.d.comb += self.i.ready.eq(1)
            m.d.sync += weight.eq(sent.match.weight)
            with m.If(self.i.valid & sent.ends):
                m.d.sync += self.o_frame.eq(sent.frame)
                m.next = "Wait"
            with m.Elif(self.i.valid & (self.o_count == self._max_matches)):
                m.d.sync += self.o_too_many.eq(1)
            with m.Elif(self.i.valid):
                m.d.comb += self._matches.i_write.eq(1)
                m.d.sync += self.o_count.eq(self.o_count + 1)
                m.next = "Count"
        with m.State("Count"):
            m.d.comb += [ranks.i_read.eq(phase == 0), ranks.i_read_address.eq(weight)]
            m.d.sync += phase.eq(phase + 1)
            with m.If(phase == ranks.latency_cycles):
                m.d.comb += [ranks.i_write.eq(1), ranks.i_write_address.eq(weight), ranks.i_word.eq(ranks.o_word + 1)]
                m.d.sync += phase.eq(0)
                m.next = "Take"

    def _place(self, m: Module, bin_: Signal, phase: Signal) -> None:
        """Turn counts into first ranks, from the largest weight on; then give every match its rank."""
        ranks, delay = self._ranks, self._ranks.latency_cycles
        total = Signal.like(self.o_count)
        number = Signal.like(self.o_count)
        m.d.comb += self._matches.i_read_address.eq(number)
        with m.State("Sum"):
            m.d.comb += [
                ranks.i_read.eq(1),
                ranks.i_read_address.eq(~bin_[: WEIGHT.bits]),
                ranks.i_write.eq(bin_ >= delay),
                ranks.i_write_address.eq(~(bin_ - delay)[: WEIGHT.bits]),
                ranks.i_word.eq(total),
            ]
            m.d.sync += [bin_.eq(bin_ + 1), total.eq(Mux(bin_ >= delay, total + ranks.o_word, 0)), number.eq(0)]
            with m.If(bin_ == BINS - 1 + delay):
                m.d.sync += bin_.eq(0)
                m.next = "Place"
        with m.State("Place"):
            m.d.comb += [
                self._matches.i_read.eq(phase == 0),
                ranks.i_read.eq(phase == self._matches.latency_cycles),
                ranks.i_read_address.eq(self.o_match.weight),
                ranks.i_write_address.eq(self.o_match.weight),
                ranks.i_word.eq(ranks.o_word + 1),
            ]
            m.d.sync += phase.eq(phase + 1)
            with m.If(phase == PHASES - 1):
                m.d.comb += [ranks.i_write.eq(1), self.o_write.eq(1)]
                m.d.sync += [phase.eq(0), number.eq(number + 1)]
                with m.If(number + 1 == self.o_count):
                    m.d.comb += self.o_sorted.eq(1)
                    m.next = "Clear"
