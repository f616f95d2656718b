"""The merge of two levels: whole records, in the golden model's order, each frame ended by its status."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from amaranth import Array, Elaboratable, Module, Mux, Signal, Value
from amaranth.hdl import Assert, Assume, Cover

from golden_model.records import FRAME_STATUS, WORD_BYTES, Cause, Tag, feature_record
from hdl.level_merge import LevelMerge
from tests.formal.proofs import happened, held, prove

MAX_FEATURES = 1
RECORD = feature_record(descriptor_bytes=8)
RECORD_WORDS = RECORD.record_bytes // WORD_BYTES
CAPACITY_WORDS = MAX_FEATURES * RECORD_WORDS
WATCHED_BIT = 8
"""The bit of every record word that is compared; neither the index nor the frame number contains it."""
LOW_BIT = {field.name: 8 * offset for field, offset in FRAME_STATUS.offsets()}


@dataclass
class _Level:
    """What a level has given: a word or a row end in this clock, and how far its frame is."""

    takes_word: Value
    takes_end: Value
    bit: Value
    ended: Signal


class _Merge(Elaboratable):
    """Levels offer records, row ends and the next frame at any time; what leaves is taken at any time."""

    def __init__(self) -> None:
        self.merge = LevelMerge(record=RECORD, levels=2, max_features=MAX_FEATURES)
        self.offers = [Signal(4, name=f"level{n}") for n in range(2)]
        self.chosen, self.ready, self.ends = Signal(range(CAPACITY_WORDS)), Signal(), Signal()
        self.ports = [*self.offers, self.chosen, self.ready, self.ends]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.merge = merge = self.merge
        m.d.comb += [merge.o.ready.eq(self.ready), merge.i_ends.eq(self.ends)]
        m.d.comb += Assume(~(self.ends & merge.o_pending))
        before, running = Signal.like(self.chosen), Signal()
        m.d.sync += [before.eq(self.chosen), running.eq(1)]
        with m.If(running):
            m.d.comb += Assume(self.chosen == before)
        levels = [self._level(m, n) for n in range(2)]
        self._in_turn(m, *levels)
        self._leaves_whole(m, *self._came_in(m, levels))
        return m

    def _level(self, m: Module, n: int) -> _Level:
        """The environment: whole records, row ends between them."""
        source = self.merge.i_levels[n]
        valid, bit, ends_row, ends_level = self.offers[n]
        word, ended = Signal(range(RECORD_WORDS)), Signal()
        m.d.comb += [
            source.valid.eq(valid),
            source.p.data[WATCHED_BIT].eq(bit),
            source.p.data[:WATCHED_BIT].eq(Mux(word == 0, Tag.FEATURE, 0)),
            source.p.ends_row.eq(ends_row),
            source.p.ends_level.eq(ends_level),
            Assume(ends_row | ~ends_level),
            Assume((word == 0) | ~ends_row),
        ]
        held(m, Assume, valid, source.ready, self.offers[n])
        takes = valid & source.ready
        with m.If(takes & ~ends_row):
            m.d.sync += word.eq(Mux(word == RECORD_WORDS - 1, 0, word + 1))
        with m.If(takes & ends_row):
            m.d.sync += ended.eq(ends_level)
        return _Level(takes & ~ends_row, takes & ends_row, bit, ended)

    def _in_turn(self, m: Module, full: _Level, half: _Level) -> None:
        """Two rows of the full size, one of the half size, and so on; one that has ended is passed over.

        ``rows`` counts the full size's since the last one of the half size.
        """
        rows = Signal(range(3))
        with m.If(half.takes_end | (full.ended & half.ended)):
            m.d.sync += rows.eq(0)
        with m.Elif(full.takes_end & (rows < 2)):
            m.d.sync += rows.eq(rows + 1)
        with m.If(full.takes_word):
            m.d.comb += Assert(~half.takes_word & ~full.ended & (half.ended | (rows < 2)))
        with m.If(half.takes_word):
            m.d.comb += Assert(~half.ended & (full.ended | (rows == 2)))

    def _came_in(self, m: Module, levels: list[_Level]) -> tuple[Array, Array]:
        """The chosen word of a frame, and how many came, for this frame and the last, which may still leave."""
        frame, words = Signal(), Signal(range(CAPACITY_WORDS + 2))
        watched, counts = (
            Array(Signal(name=f"watched{n}") for n in range(2)),
            Array(Signal.like(words, name=f"count{n}") for n in range(2)),
        )
        for level in levels:
            with m.If(level.takes_word):
                m.d.sync += words.eq(Mux(words > CAPACITY_WORDS, words, words + 1))
                with m.If(words == self.chosen):
                    m.d.sync += watched[frame].eq(level.bit)
        with m.If(levels[0].ended & levels[1].ended):
            m.d.sync += [frame.eq(~frame), words.eq(0), counts[frame].eq(words)]
            for level in levels:
                m.d.comb += Assert(~level.takes_word & ~level.takes_end)
                m.d.sync += level.ended.eq(0)
        return watched, counts

    def _leaves_whole(self, m: Module, watched: Array, counts: Array) -> None:
        """What fits leaves in the order in which it came, then the status with its number."""
        o = self.merge.o
        held(m, Assert, o.valid, o.ready, Value.cast(o.payload))
        frame, words, word, in_status = (
            Signal(),
            Signal(range(CAPACITY_WORDS + 1)),
            Signal(range(RECORD_WORDS)),
            Signal(),
        )
        starts_status = (word == 0) & (o.payload.data[:WATCHED_BIT] == Tag.FRAME_STATUS)
        overflows, frames = Signal(), happened(m, o.valid & o.ready & o.payload.last, most=2)
        with m.If(o.valid & o.ready):
            m.d.sync += [word.eq(Mux(word == RECORD_WORDS - 1, 0, word + 1)), in_status.eq(in_status | starts_status)]
            m.d.comb += Assert(o.payload.last == (in_status & (word == RECORD_WORDS - 1)))
            with m.If(~in_status & ~starts_status):
                m.d.comb += Assert(words < CAPACITY_WORDS)
                m.d.sync += words.eq(words + 1)
                with m.If(words == self.chosen):
                    m.d.comb += Assert(o.payload.data[WATCHED_BIT] == watched[frame])
            overflow = counts[frame] > CAPACITY_WORDS
            with m.If(starts_status):
                status = o.payload.data
                m.d.comb += [
                    Assert(words == Mux(overflow, CAPACITY_WORDS, counts[frame])),
                    Assert(status[LOW_BIT["good"]] == ~overflow),
                    Assert(status[LOW_BIT["causes"] :][:16] == Mux(overflow, Cause.TOO_MANY_FEATURES, 0)),
                ]
                m.d.sync += overflows.eq(overflow)
            with m.If(o.payload.last):
                m.d.sync += [frame.eq(~frame), words.eq(0), in_status.eq(0)]
        m.d.comb += [Cover(overflows), Cover((frames == 1) & (words == RECORD_WORDS))]


@pytest.mark.slow
def test_two_levels_leave_in_turn_and_whole(tmp_path: Path) -> None:
    prove(_Merge(), tmp_path)
