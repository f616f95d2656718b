"""Homography scoring and estimation behind streams of 64-bit words: the matcher's packets in, records out."""

from amaranth import Cat, Module, Mux, ResetInserter, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.geometry.estimator import EstimateCause
from golden_model.geometry.scoring import MAX_MATCHES
from golden_model.records import ELEMENTS, FRAME_STATUS, HOMOGRAPHY, HYPOTHESIS, MATCH, SCORE, WORD_BYTES, Record, Tag
from hdl.geometry.estimator import HomographyEstimator
from hdl.geometry.estimator_states import ESTIMATOR_SETTINGS
from hdl.geometry.match_gain import PAIR
from hdl.geometry.ordering import FRAME_MATCH
from hdl.geometry.scoring import HomographyScoring
from hdl.lib.component import Component
from hdl.lib.views import view_signal
from hdl.streams import WordPayload, record_layout, words

RECORD_WORDS = HOMOGRAPHY.record_bytes // WORD_BYTES


class RecordScoring(wiring.Component):
    """`HomographyScoring` with records in and out, as an AXI DMA moves them.

    Every packet of matches replaces the stored set: the kept matches of a good frame. A packet that is cut, holds
    anything else or ends with a bad status leaves an empty set, so that no score comes from it. Hypotheses wait while
    a packet of matches is under way, and matches wait, at most as many clocks as there are matches, while a hypothesis
    is read through.

    Every hypothesis is answered by one Score record with its number, and with the number of the frame whose matches
    scored it, since one that comes late meets the next set. ``last`` comes with the score of the hypothesis that had
    it. A record that is cut, or not a hypothesis, is answered with `ScoreCause.INVALID_RECORD`.

    A hypothesis takes max(N, 6) clocks with N matches, see `HomographyScoring`.
    """

    i_matches: In(stream.Signature(WordPayload))
    """Match records and a FrameStatus: the matcher's output."""
    i_hypotheses: In(stream.Signature(WordPayload))
    """`golden_model.records.HYPOTHESIS`, any number in a packet."""
    o: Out(stream.Signature(WordPayload))
    """`golden_model.records.SCORE`."""
    o_scored: Out(1)
    """The last word of an answer with a score leaves in this clock."""
    o_refused: Out(1)
    """The last word of an answer with causes instead leaves in this clock."""

    def __init__(self, *, max_matches: int = MAX_MATCHES) -> None:
        self._scoring = HomographyScoring(max_matches=max_matches)
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Words to records, the scoring, records to words."""
        m = Module()
        m.submodules.scoring = self._scoring
        self._take_matches(m)
        self._take_hypotheses(m)
        self._send_scores(m)
        return m

    def _take_matches(self, m: Module) -> None:
        m.submodules.kept = kept = KeptMatches()
        wiring.connect(m, wiring.flipped(self.i_matches), kept.i)
        taken, stored = kept.o.payload, self._scoring.i_matches
        # A bad packet ends twice; the second end is that of an empty set.
        ends_again = Signal()
        m.d.comb += [
            stored.valid.eq(kept.o.valid),
            stored.payload.ends.eq(taken.ends),
            stored.payload.frame.eq(Mux(taken.frame.good, taken.frame.frame, 0)),
            stored.payload.match.eq(taken.match),
            kept.o.ready.eq(stored.ready & (~taken.ends | taken.frame.good | ends_again)),
        ]
        with m.If(kept.o.valid & taken.ends & stored.ready):
            m.d.sync += ends_again.eq(~taken.frame.good & ~ends_again)
        # From the first word of a packet to its last record.
        under_way = Signal()
        with m.If(self.i_matches.valid & self.i_matches.ready):
            m.d.sync += under_way.eq(1)
        with m.Elif(kept.o.valid & kept.o.ready & taken.ends):
            m.d.sync += under_way.eq(0)
        m.d.comb += self._scoring.i_hold.eq(under_way | self.i_matches.valid)

    def _take_hypotheses(self, m: Module) -> None:
        m.submodules.hypothesis_record = record = RecordCollector(record=HYPOTHESIS)
        wiring.connect(m, wiring.flipped(self.i_hypotheses), record.i)
        taken, proposed = record.o.payload, self._scoring.i_hypotheses
        sent = data.View(record_layout(HYPOTHESIS), taken.record)
        m.d.comb += [
            proposed.valid.eq(record.o.valid),
            proposed.payload.number.eq(sent.number),
            proposed.payload.last.eq(taken.last),
            proposed.payload.invalid.eq(taken.cut | (sent.tag != Tag.HYPOTHESIS)),
            *(element.eq(sent[name]) for element, name in zip(proposed.payload.elements, ELEMENTS, strict=True)),
            record.o.ready.eq(proposed.ready),
        ]

    def _send_scores(self, m: Module) -> None:
        score = view_signal(record_layout(SCORE))
        scored = self._scoring.o
        low, high = words(score)
        is_high = Signal()
        m.d.comb += [
            score.tag.eq(Tag.SCORE),
            *(score[name].eq(scored.payload[name]) for name in ("causes", "number", "support", "score", "frame")),
            self.o.valid.eq(scored.valid),
            self.o.payload.data.eq(Mux(is_high, high, low)),
            self.o.payload.last.eq(is_high & scored.payload.last),
            scored.ready.eq(self.o.ready & is_high),
            self.o_scored.eq(scored.valid & scored.ready & ~scored.payload.causes.any()),
            self.o_refused.eq(scored.valid & scored.ready & scored.payload.causes.any()),
        ]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += is_high.eq(~is_high)


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
