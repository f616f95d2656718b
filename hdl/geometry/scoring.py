"""Scores homographies that a host proposes by the weighted matches of a frame, one match per clock."""

from typing import NamedTuple

from amaranth import Cat, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from golden_model.config import check_range
from golden_model.formats import WEIGHT
from golden_model.geometry.scoring import ENTRY, IN_FLIGHT, LEVELS, MAX_MATCHES, ScoreCause
from hdl.geometry.match_gain import HYPOTHESIS, PRODUCT_CYCLES, WEIGHED_PAIR, MatchGain
from hdl.lib.component import Component
from hdl.lib.delay import delayed
from hdl.lib.skid_buffer import SkidBuffer
from hdl.lib.views import view_signal

SENT_HYPOTHESIS = data.StructLayout(
    {"elements": data.ArrayLayout(signed(32), 9), "number": 16, "last": 1, "invalid": 1}
)
"""A hypothesis as a host sends it, row by row. ``number`` and ``last`` come back with its score; with ``invalid`` the
elements mean nothing, and it is answered with `ScoreCause.INVALID_RECORD`."""
FRAME_BITS = 32
SENT_MATCH = data.StructLayout({"match": WEIGHED_PAIR, "ends": 1, "frame": FRAME_BITS})
"""A match; or, with ``ends``, no match but the end of the set and the set's frame."""
_NOTE = data.StructLayout({"causes": len(ScoreCause), "number": 16, "last": 1, "frame": FRAME_BITS})
"""What waits for a hypothesis's score, apart from its sums."""
READ_CYCLES = 2
"""Clocks from an address to its match: the memory, and a register after it."""


class _Marks(NamedTuple):
    """Whether a match is the first of its hypothesis, or the last, in the clock of its address."""

    first: Value
    last: Value


class HomographyScoring(Component):
    """Score and support of every hypothesis; equal to `golden_model.geometry.scoring.score`.

    A set of matches is stored; hypotheses follow, any number of them. The next set is taken as soon as the hypotheses
    that were started have been read through, and hypotheses wait until a set that has begun is complete. Before the
    first set, and with an empty one, hypotheses are answered with `ScoreCause.NO_MATCHES`.

    With N matches a hypothesis takes max(N, 3) clocks. Hypotheses follow each other without a pause where N is at least
    ``latency_cycles`` and scores are taken at once; with fewer matches, two of them take at least N +
    ``latency_cycles``: no more than two are in flight, so that the pipeline never stalls.

    Parameters
    ----------
    max_matches : int
        Matches that the memory holds, 1 to 2048. A larger set is not scored, see `ScoreCause.TOO_MANY_MATCHES`.
    """

    i_matches: In(stream.Signature(SENT_MATCH))
    """Stream of `SENT_MATCH`. A set ends with a payload with ``ends``, which holds no match but the frame's number."""
    i_hypotheses: In(stream.Signature(SENT_HYPOTHESIS))
    """Stream of `SENT_HYPOTHESIS`, with elements as from `golden_model.geometry.scoring.quantise`; what does not fit 25
    bits, or is too small, is refused with a cause."""
    i_hold: In(1)
    """No hypothesis is started."""
    o: stream.Interface
    """Stream of ``score``, ``support``, ``causes``, ``number``, ``last`` and ``frame``: one per hypothesis, in their
    order; see `golden_model.geometry.scoring.Scores`. ``frame`` is that of the set by which it was scored."""

    # Address; memory; gain; its product with the weight; sum; skid buffer.
    latency_cycles = 1 + READ_CYCLES + MatchGain.latency_cycles + PRODUCT_CYCLES + 1 + SkidBuffer.latency_cycles
    """From a hypothesis at the input of an idle block to its score, with one match; each further match adds a clock."""

    def __init__(self, *, max_matches: int = MAX_MATCHES) -> None:
        check_range("max_matches", max_matches, 1, MAX_MATCHES)
        self.max_matches = max_matches
        support = max_matches * WEIGHT.max_raw
        self._result = data.StructLayout(
            {"score": range(support * LEVELS + 1), "support": range(support + 1), **_NOTE.members}
        )
        super().__init__(o=Out(stream.Signature(self._result)))

    def elaborate(self, platform: object) -> Module:
        """Store matches, read them for each hypothesis, sum their gains."""
        m = Module()
        memory: Memory = Memory(shape=WEIGHED_PAIR, depth=self.max_matches, init=[])
        m.submodules.memory = memory
        read = memory.read_port()
        reading = Signal()
        stored, too_many, loading, frame = self._store(m, memory, reading)
        marks = self._read(m, read.addr, reading, stored, loading)
        match = delayed(m, read.data, READ_CYCLES - 1)

        hypothesis = view_signal(HYPOTHESIS, reset_less=True)
        note = view_signal(_NOTE, reset_less=True)
        sent = self.i_hypotheses.payload
        # Taken when its first match leaves the memory.
        m.d.comb += self.i_hypotheses.ready.eq(delayed(m, marks.first, READ_CYCLES - 1, reset_less=False))
        with m.If(self.i_hypotheses.ready):
            m.d.sync += [element.eq(each) for element, each in zip(hypothesis, sent.elements, strict=True)]
            m.d.sync += note.causes.eq(Cat(*self._refused(), stored == 0, too_many, sent.invalid))
            m.d.sync += [note.number.eq(sent.number), note.last.eq(sent.last), note.frame.eq(frame)]
        m.submodules.gain = gain = MatchGain()
        m.d.comb += [gain.i_hypothesis.eq(hypothesis), gain.i_match.eq(match.pair)]
        self._sum(m, marks, gain.o_gain, match.weight, note)
        return m

    def _store(self, m: Module, memory: Memory, reading: Value) -> tuple[Signal, Signal, Signal, Signal]:
        """Take matches while none are read.

        Returns how many are stored, whether there were more, whether a set is open, and its frame.
        """
        stored = Signal(range(self.max_matches + 1))
        too_many = Signal()
        loading = Signal()
        frame = Signal(FRAME_BITS)
        write = memory.write_port()
        sent = self.i_matches
        # The first match of a set starts over.
        position = Mux(loading, stored, 0)
        has_room = position != self.max_matches
        m.d.comb += [
            sent.ready.eq(~reading),
            write.addr.eq(position),
            write.data.eq(sent.payload.match),
            write.en.eq(sent.valid & sent.ready & ~sent.payload.ends & has_room),
        ]
        with m.If(sent.valid & sent.ready):
            m.d.sync += [
                loading.eq(~sent.payload.ends),
                stored.eq(position + write.en),
                too_many.eq((too_many & loading) | (~sent.payload.ends & ~has_room)),
                # It matters at the end of the set; until then nothing is scored.
                frame.eq(sent.payload.frame),
            ]
        return stored, too_many, loading, frame

    def _read(self, m: Module, address: Signal, reading: Signal, stored: Value, loading: Value) -> _Marks:
        """Count through the matches once per hypothesis."""
        first = Signal()
        last = Signal()
        start = Signal()
        waiting = Signal()
        in_flight = Signal(range(IN_FLIGHT + 1))
        following = Signal.like(address, reset_less=True)
        # Matches go first: a set that has begun must be complete before a hypothesis reads it.
        may_start = ~waiting & (in_flight != IN_FLIGHT) & ~loading & ~self.i_matches.valid & ~self.i_hold
        m.d.comb += [
            address.eq(following),
            # Without matches there is one address, whose match does not count.
            last.eq(reading & ((following + 1 == stored) | (stored == 0))),
            start.eq(self.i_hypotheses.valid & may_start & (~reading | last)),
        ]
        m.d.sync += [
            first.eq(start),
            reading.eq(start | (reading & ~last)),
            waiting.eq(start | (waiting & ~self.i_hypotheses.ready)),
            in_flight.eq(in_flight + start - (self.o.valid & self.o.ready)),
            following.eq(Mux(start, 0, following + 1)),
        ]
        return _Marks(first, last)

    def _refused(self) -> tuple[Value, Value]:
        """The first bits of `ScoreCause`: an element does not fit the format, or all of them are too small."""
        beyond = [_exceeds(sent, ENTRY.bits) for sent in self.i_hypotheses.payload.elements]
        large = [_exceeds(sent, ENTRY.bits - 1) for sent in self.i_hypotheses.payload.elements]
        return Cat(*beyond).any(), ~Cat(*large).any()

    def _sum(self, m: Module, marks: _Marks, gain: Value, weight: Value, note: data.View) -> None:
        """Add up a hypothesis's gains; the score of a refused one is 0."""
        cycles = MatchGain.latency_cycles
        waiting_weight = delayed(m, weight, cycles)
        term = delayed(m, waiting_weight * gain, PRODUCT_CYCLES)
        share = delayed(m, Mux(gain.any(), waiting_weight, 0), PRODUCT_CYCLES)
        begins = delayed(m, marks.first, READ_CYCLES + cycles + PRODUCT_CYCLES)
        ends = delayed(m, marks.last, READ_CYCLES + cycles + PRODUCT_CYCLES + 1, reset_less=False)
        summed_note = delayed(m, note, cycles + PRODUCT_CYCLES + 1)
        # A flip-flop of its own: it reaches every bit of the sums.
        refused = delayed(m, note.causes.any(), cycles + PRODUCT_CYCLES + 1)
        m.submodules.output = output = SkidBuffer(shape=self._result)
        result = output.i.payload
        score = Signal.like(result.score, reset_less=True)
        support = Signal.like(result.support, reset_less=True)
        m.d.sync += [score.eq(Mux(begins, 0, score) + term), support.eq(Mux(begins, 0, support) + share)]
        m.d.comb += [
            output.i.valid.eq(ends),
            *(result[name].eq(summed_note[name]) for name in _NOTE.members),
            result.score.eq(Mux(refused, 0, score)),
            result.support.eq(Mux(refused, 0, support)),
        ]
        wiring.connect(m, output.o, wiring.flipped(self.o))


def _exceeds(value: Value, bits: int) -> Value:
    """Tell whether a signed value needs more than ``bits`` bits: those above are not all copies of its sign."""
    upper = value[bits - 1 :]
    return upper.any() & ~upper.all()
