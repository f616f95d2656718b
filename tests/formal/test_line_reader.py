"""The reader in lines: it keeps the rules of its streams, whatever picture, painter, memory and display do."""

from pathlib import Path

import pytest
from amaranth import Cat, Elaboratable, Module, Signal, Value
from amaranth.hdl import Assert, Assume, Cover

from hdl.axi.axi_write import BURST_WORDS
from hdl.painting import line_reader
from tests.formal.proofs import held, in_flight, prove

QUEUE_WORDS = 2 * BURST_WORDS


class _Reader(Elaboratable):
    """Pictures, stops, holds, memory and display do what they like."""

    def __init__(self) -> None:
        self.reader = reader = line_reader.LineReader()
        # Few bits of a word tell words apart, and whether something was painted.
        self.word, self.columns, self.lines = Signal(4), Signal(2), Signal(3)
        self.ports = [reader.i.valid, self.columns, self.lines, reader.i_held, reader.i_stop, reader.i_words.valid]
        self.ports += [self.word, reader.o_bursts.ready, reader.o.ready]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.reader = reader = self.reader
        i, words, bursts, o, hold = reader.i, reader.i_words, reader.o_bursts, reader.o, reader.o_hold
        m.d.comb += [i.payload.columns.eq(self.columns), i.payload.lines.eq(self.lines), i.payload.border.eq(5)]
        m.d.comb += [Cat(words.payload.data[0], words.payload.data[24], words.payload.data[56]).eq(self.word[:3])]
        m.d.comb += [words.payload.failed.eq(self.word[3])]
        held(m, Assume, i.valid, i.ready, self.columns, self.lines)
        with m.If(i.valid):
            m.d.comb += [Assume(self.columns != 0), Assume(self.lines != 0)]
        # What is held stays so, from the clock after.
        held_before = Signal()
        m.d.sync += held_before.eq(reader.i_held & hold.valid)
        with m.If(held_before & hold.valid):
            m.d.comb += Assume(reader.i_held)
        held(m, Assert, o.valid, o.ready, Value.cast(o.payload))
        stopped = Signal()
        m.d.sync += stopped.eq(reader.i_stop)
        # A stop withdraws what is asked for, nothing else does.
        waited, burst = Signal(), Signal.like(bursts.payload.burst)
        m.d.sync += [waited.eq(bursts.valid & ~bursts.ready), burst.eq(bursts.payload.burst)]
        with m.If(waited & ~reader.i_stop):
            m.d.comb += [Assert(bursts.valid), Assert(bursts.payload.burst == burst)]
        asks, comes = bursts.valid & bursts.ready, words.valid & words.ready
        owed = Signal(range(QUEUE_WORDS + 1))
        m.d.sync += owed.eq(owed + (asks << 4) - comes)
        m.d.comb += [
            # What was asked for is taken in any clock, and nothing else.
            Assert(words.ready == (owed != 0)),
            Assert(owed <= QUEUE_WORDS),
            Assert(~bursts.valid | hold.valid),
            Assert(~bursts.valid | ~reader.i_stop),
            Assert(reader.o_idle == ~hold.valid),
            Assert(~reader.o_idle | (owed == 0)),
        ]
        # A picture begins with its first pixel and no other, and no more is shown than one.
        shows = o.valid & o.ready
        pictures = in_flight(m, i.valid & i.ready, shows & o.payload.first, most=1)
        m.d.comb += [Cover(shows & o.payload.first), Cover(shows & (pictures == 0)), Cover(stopped & (owed != 0))]
        return m


@pytest.mark.slow
def test_a_display_and_a_memory_are_never_misled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(line_reader, "QUEUE_WORDS", QUEUE_WORDS)
    prove(_Reader(), tmp_path)
