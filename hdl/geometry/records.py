"""Homography estimation behind streams of 64-bit words: the matcher's packets in, records out."""

from amaranth import Cat, Module, Mux, ResetInserter, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.estimator import MAX_MATCHES, EstimateCause
from golden_model.records import ELEMENTS, FRAME_STATUS, HOMOGRAPHY, MATCH, WORD_BYTES, Record, Tag
from hdl.geometry.estimator import HomographyEstimator
from hdl.geometry.estimator_states import ESTIMATOR_SETTINGS
from hdl.geometry.match_gain import PAIR
from hdl.geometry.ordering import FRAME_MATCH
from hdl.lib.component import Component
from hdl.lib.views import view_signal
from hdl.streams import WordPayload, record_layout

RECORD_WORDS = HOMOGRAPHY.record_bytes // WORD_BYTES


class RecordEstimator(wiring.Component):
    """`HomographyEstimator` with records in and out.

    Every packet of matches is answered by a packet of one record, also where there is no homography. While nobody takes
    the first word of a record, the following ones are dropped: a host that does not read stops nothing. A record whose
    first words have been taken is waited for.
    """

    i_matches: In(stream.Signature(WordPayload))
    """Match records and a FrameStatus: the matcher's output."""
    i_settings: In(ESTIMATOR_SETTINGS)
    """Taken at the end of a packet of matches, as soon as the estimate before is complete."""
    i_enable: In(1)
    """Whether the next record is sent; 0: it is discarded, whoever takes words."""
    i_clear: In(1)
    """Forget matches and estimate; ``i_matches`` continues with a new packet. A record that is offered stays whole."""
    o: Out(stream.Signature(WordPayload))
    """`golden_model.records.HOMOGRAPHY`."""
    o_drops: Out(1)
    """A record is dropped in this clock because another one waits."""
    o_estimating: Out(1)
    """A packet of matches has begun, and its estimate is not complete."""
    o_refused: Out(1)
    """The last good frame has no homography that is accepted, though one before it has."""

    def __init__(self, *, max_matches: int = MAX_MATCHES) -> None:
        self._estimator = HomographyEstimator(max_matches=max_matches)
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Words to matches, the estimator, its result to words."""
        m = Module()
        estimator, kept = self._estimator, KeptMatches()
        m.submodules.estimator = ResetInserter(self.i_clear)(estimator)
        m.submodules.kept = ResetInserter(self.i_clear)(kept)
        wiring.connect(m, wiring.flipped(self.i_matches), kept.i)
        wiring.connect(m, kept.o, estimator.i)
        m.submodules.verdict = ResetInserter(self.i_clear)(self._verdict())
        record = view_signal(record_layout(HOMOGRAPHY))
        result = estimator.o.payload
        names = ("causes", "inliers", "frame", "score", "support", "cycles", "cells", "reference")
        m.d.comb += [
            estimator.i_settings.eq(self.i_settings),
            record.tag.eq(Tag.HOMOGRAPHY),
            *(record[name].eq(result[name]) for name in names),
            *(record[name].eq(result.homography[n]) for n, name in enumerate(ELEMENTS)),
        ]
        waiting = Signal(Value.cast(record).shape(), reset_less=True)
        left = Signal(range(RECORD_WORDS + 1))
        m.d.comb += [
            self.o.valid.eq(left != 0),
            self.o.payload.data.eq(waiting[: 8 * WORD_BYTES]),
            self.o.payload.last.eq(left == 1),
            self.o_drops.eq(estimator.o.valid & (left == RECORD_WORDS)),
            estimator.o.ready.eq((left == 0) | self.o_drops),
        ]
        with m.If(left == 0), m.If(estimator.o.valid & self.i_enable):
            m.d.sync += [waiting.eq(record), left.eq(RECORD_WORDS)]
        with m.Elif(self.o.ready):
            m.d.sync += [waiting.eq(waiting >> 8 * WORD_BYTES), left.eq(left - 1)]
        return m

    def _verdict(self) -> Module:
        """Count the packets of which no estimate is complete, and note how the last good frame's ended."""
        m = Module()
        begins = Signal(init=1)
        # Since the clear a homography has been accepted.
        is_chained = Signal()
        # One is being estimated, one is stored, and one arrives.
        packets = Signal(2)
        takes, result = self.i_matches.valid & self.i_matches.ready, self._estimator.o
        ends = result.valid & result.ready
        m.d.sync += packets.eq(packets + (takes & begins) - ends)
        m.d.comb += self.o_estimating.eq(packets.any())
        with m.If(takes):
            m.d.sync += begins.eq(self.i_matches.payload.last)
        with m.If(ends & ~(result.payload.causes & EstimateCause.BAD_FRAME).any()):
            refused = result.payload.causes.any()
            m.d.sync += [is_chained.eq(is_chained | ~refused), self.o_refused.eq(is_chained & refused)]
        return m


class KeptMatches(wiring.Component):
    """The kept matches of each packet, and at its end what its status says of the frame.

    A packet that is cut, holds anything else or ends with a bad status ends a frame that is not good.
    """

    i: In(stream.Signature(WordPayload))
    """Match records and a FrameStatus."""
    o: Out(stream.Signature(FRAME_MATCH))

    def elaborate(self, platform: object) -> Module:
        """Collect records, and pass on those that count."""
        m = Module()
        m.submodules.record = record = RecordCollector(record=MATCH)
        wiring.connect(m, wiring.flipped(self.i), record.i)
        taken, sent = record.o.payload, self.o.payload
        match = data.View(record_layout(MATCH), taken.record)
        status = data.View(record_layout(FRAME_STATUS, MATCH.record_bytes), taken.record)
        is_match = ~taken.cut & (match.tag == Tag.MATCH)
        is_kept = is_match & match.verdict & ~taken.last
        # Whether anything but matches came before the end.
        spoilt = Signal()
        reference = Signal.like(sent.frame.reference)
        m.d.comb += [
            self.o.valid.eq(record.o.valid & (is_kept | taken.last)),
            sent.ends.eq(taken.last),
            *(sent.frame[name].eq(status[name]) for name in ("frame", "width", "height")),
            sent.frame.reference.eq(reference),
            sent.frame.good.eq(~taken.cut & (status.tag == Tag.FRAME_STATUS) & status.good & ~spoilt),
            sent.match.weight.eq(match.weight),
            *(sent.match.pair[name].eq(match[name]) for name in PAIR.members),
            record.o.ready.eq(self.o.ready | ~(is_kept | taken.last)),
        ]
        with m.If(record.o.valid & record.o.ready):
            m.d.sync += spoilt.eq(~taken.last & (spoilt | ~is_match))
            m.d.sync += reference.eq(Mux(taken.last, 0, match.reference))
        return m


class RecordCollector(Component):
    """Assembles records of one length from their words.

    A record takes one clock more than it has words. After ``last`` the next word begins a record, whatever came before.

    Parameters
    ----------
    record : Record
        Gives the length.
    """

    i: In(stream.Signature(WordPayload))
    o: stream.Interface
    """Stream of ``record``, ``last`` (the record's last word had it) and ``cut`` (``last`` came too early, and the
    record means nothing)."""

    def __init__(self, *, record: Record) -> None:
        self._words = record.record_bytes // WORD_BYTES
        collected = data.StructLayout({"record": 8 * record.record_bytes, "last": 1, "cut": 1})
        super().__init__(o=Out(stream.Signature(collected)))

    def elaborate(self, platform: object) -> Module:
        """A shift register; it stands still while its record waits."""
        m = Module()
        record = Signal(self.o.payload.record.shape(), reset_less=True)
        word = Signal(range(self._words))
        complete = word == self._words - 1
        last = self.i.payload.last
        m.d.comb += [self.i.ready.eq(~self.o.valid), self.o.payload.record.eq(record)]
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [
                record.eq(Cat(record, self.i.payload.data)[len(self.i.payload.data) :]),
                word.eq(Mux(complete | last, 0, word + 1)),
                self.o.valid.eq(complete | last),
                self.o.payload.last.eq(last),
                self.o.payload.cut.eq(~complete),
            ]
        with m.Elif(self.o.ready):
            m.d.sync += self.o.valid.eq(0)
        return m
