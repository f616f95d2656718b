"""Matches two feature sets: mutual nearest neighbours, their relative orientations, and fuzzy weights."""

from functools import reduce
from operator import or_

from amaranth import Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import MatcherConfig
from golden_model.feature.ilbp import DescriptorPattern
from golden_model.formats import WEIGHT
from golden_model.records import FRAME_STATUS, MATCH, Tag
from hdl.lib.delay import port_register
from hdl.lib.views import view_signal
from hdl.matching.feature_banks import FeatureBanks
from hdl.matching.match_weigher import WEIGHED, MatchWeigher
from hdl.matching.mutual_neighbours import MutualNearestNeighbours
from hdl.matching.nearest_neighbours import NearestNeighbours
from hdl.streams import WordPayload, record_layout, words

MATCH_LAYOUT = record_layout(MATCH)
STATUS_LAYOUT = record_layout(FRAME_STATUS, MATCH.record_bytes)


class Matcher(wiring.Component):
    """Matches each good frame with its reference; equal to `golden_model.matching.matcher.match`.

    A frame is stored while the previous one is matched (`FeatureBanks`). When its FrameStatus has arrived and the
    matcher is idle, it becomes the current frame. The search compares all descriptors, which takes left * right / lanes
    clocks; then the mutual matches are read once for the histogram of relative orientations (oriented patterns only),
    and once more to weigh and send them. Every frame, good or bad, matched or not, ends with its FrameStatus.

    Parameters
    ----------
    config : MatcherConfig
        The rule base is built in; the limit of the weight is an input instead.
    pattern : DescriptorPattern
        Pattern of the features' descriptors.
    lanes : int
        Left descriptors compared at a time, one of `hdl.build.LANES`.
    max_features : int
        Features that a bank holds.
    """

    i_features: In(stream.Signature(WordPayload))
    """Feature and FrameStatus records of the front end. Stalls while a complete frame waits for the matching of the
    previous one."""
    o_matches: Out(stream.Signature(WordPayload))
    """Match records in rising left index, then the FrameStatus with the numbers of matches and of kept matches;
    ``last`` marks its last word."""
    o_frame_taken: Out(1)
    """High for the clock in which the next frame, good or bad, is accepted and its settings are sampled."""
    i_estimating: In(1)
    """The homography of a frame that has been sent is not known yet: no other frame is accepted."""
    i_refused: In(1)
    """The last good frame does not become the reference."""
    i_hold_reference: In(1)
    """See `FeatureBanks`."""
    i_take_reference: In(1)
    """See `FeatureBanks`."""
    o_reference_taken: Out(1)
    """High for the clock in which ``i_take_reference`` takes effect."""
    i_keep_above: In(WEIGHT.bits)
    """A match of the frame is kept if its weight is larger."""

    def __init__(self, *, config: MatcherConfig, pattern: DescriptorPattern, lanes: int, max_features: int) -> None:
        bits = pattern.bits
        self._weigher = MatchWeigher(config=config, pattern=pattern, max_features=max_features)
        self._banks = FeatureBanks(pattern=pattern, max_features=max_features)
        self._search = NearestNeighbours(bits=bits, lanes=lanes, max_features=max_features)
        self._pairs = MutualNearestNeighbours(bits=bits, max_features=max_features)
        self.keeps_all = config.rules is None
        self.counts_orientations = pattern.oriented
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Banks, search, pairs and weigher in a row; a state machine runs them for each frame."""
        m = Module()
        m.submodules.banks = self._banks
        m.submodules.search = self._search
        m.submodules.pairs = self._pairs
        m.submodules.weigher = self._weigher
        self._connect_banks(m)
        self._connect_results(m)
        sending = Signal()
        status = view_signal(STATUS_LAYOUT, reset_less=True)
        closes = Signal()
        weighed = self._weigher.o
        has_match = Signal()
        verdict = Signal()
        keep_above = Signal.like(self.i_keep_above, reset_less=True)
        m.d.comb += weighed.ready.eq(closes & has_match)
        with m.If(self.o_frame_taken):
            m.d.sync += keep_above.eq(self.i_keep_above)
        # The comparison with the limit takes a clock of its own.
        m.d.sync += has_match.eq(weighed.valid & ~weighed.ready)
        m.d.sync += verdict.eq(self.keeps_all | (weighed.payload.weight > keep_above))
        with m.If(weighed.ready):
            m.d.sync += [status.matches.eq(status.matches + 1), status.kept.eq(status.kept + verdict)]
        record = Mux(sending, status.as_value(), self._match(m, verdict).as_value())
        self._send(m, sending | has_match, record, sending, closes)
        self._control(m, status, sending, closes)
        return m

    def _connect_banks(self, m: Module) -> None:
        """Connect the banks, whose read addresses search and mutual pairs share: they never run at the same time."""
        banks, search, pair = self._banks, self._search, self._pairs.o.payload
        wiring.connect(m, wiring.flipped(self.i_features), banks.i)
        m.d.comb += [
            banks.i_hold_reference.eq(self.i_hold_reference | self.i_refused),
            banks.i_take_reference.eq(self.i_take_reference),
            banks.i_left_address.eq(Mux(search.o_busy, search.o_left_address, pair.left)),
            banks.i_right_address.eq(Mux(search.o_busy, search.o_right_address, pair.right)),
            search.i_left_count.eq(banks.o_left_count),
            search.i_right_count.eq(banks.o_right_count),
            search.i_left.eq(banks.o_left.descriptor),
            search.i_right.eq(banks.o_right.descriptor),
            self._weigher.i_left.eq(banks.o_left),
            self._weigher.i_right.eq(banks.o_right),
        ]

    def _connect_results(self, m: Module) -> None:
        """Connect rows and columns of the search to the mutual pairs, and these to the weigher."""
        search, pairs = self._search, self._pairs
        wiring.connect(m, pairs.o, self._weigher.i)
        m.d.comb += [
            # Without right features the search leaves no rows.
            pairs.i_left_count.eq(Mux(self._banks.o_right_count.any(), self._banks.o_left_count, 0)),
            search.i_row_index.eq(pairs.o_row_index),
            search.i_column_index.eq(pairs.o_column_index),
            search.i_read.eq(pairs.o_read),
            pairs.i_row.eq(search.o_row),
            pairs.i_column.eq(search.o_column),
        ]

    def _match(self, m: Module, verdict: Value) -> data.View:
        """Return the Match record of the pair that the weigher holds."""
        match = view_signal(MATCH_LAYOUT)
        pair, weighed = self._pairs.o.payload, self._weigher.o.payload
        m.d.comb += [
            match.tag.eq(Tag.MATCH),
            match.verdict.eq(verdict),
            match.left_index.eq(pair.left),
            match.right_index.eq(pair.right),
            match.distance.eq(pair.distance),
            match.margin.eq(pair.margin),
            match.reference.eq(self._banks.o_reference),
            *(match[name].eq(weighed[name]) for name, _ in WEIGHED),
        ]
        for side, feature in (("left", self._banks.o_left), ("right", self._banks.o_right)):
            m.d.comb += [match[f"{side}_x"].eq(feature.x), match[f"{side}_y"].eq(feature.y)]
        return match

    def _send(self, m: Module, valid: Value, record: Value, ends_frame: Value, closes: Signal) -> None:
        """Send a record word by word; ``closes`` is high when its last word is taken."""
        o = self.o_matches
        payload = port_register(m, o.payload)
        # One-hot, because a counter would have to be decoded before the words are selected.
        selected = Signal(len(words(record)), init=1)
        chosen = reduce(or_, (Mux(bit, word, 0) for bit, word in zip(selected, words(record), strict=True)))
        with m.If(o.ready | ~o.valid):
            m.d.sync += [o.valid.eq(valid), payload.data.eq(chosen), payload.last.eq(ends_frame & selected[-1])]
            m.d.comb += closes.eq(selected[-1])
            with m.If(valid):
                m.d.sync += selected.eq(selected.rotate_left(1))

    def _control(self, m: Module, status: data.View, sending: Signal, closes: Value) -> None:
        """Run the state machine, from one FrameStatus to the next."""
        arrived = self._banks.o_status
        search, pairs, weigher = self._search, self._pairs, self._weigher
        with m.FSM():
            with m.State("Wait-Frame"):
                # Copied first: once it is accepted, the next record takes its place.
                m.d.sync += status.eq(arrived.payload)
                with m.If(arrived.valid & ~self.i_estimating):
                    m.next = "Take-Frame"
            # Accepting the status makes the banks swap roles, so it must not happen before the matcher is idle.
            with m.State("Take-Frame"):
                m.d.comb += [arrived.ready.eq(1), self.o_frame_taken.eq(1)]
                m.next = "Send-Status"
                with m.If(status.good):
                    m.d.comb += self.o_reference_taken.eq(self.i_take_reference)
                    m.next = "Start-Search"
            # A state of its own: only now do the banks show their new roles and counts.
            with m.State("Start-Search"):
                m.d.comb += search.i_start.eq(1)
                m.next = "Search"
            with m.State("Search"), m.If(~search.o_busy):
                m.d.comb += pairs.i_start.eq(1)
                m.next = "Count-Orientations" if self.counts_orientations else "Weigh"
            if self.counts_orientations:
                with m.State("Count-Orientations"):
                    m.d.comb += weigher.i_count.eq(1)
                    with m.If(~pairs.o_busy):
                        m.d.comb += weigher.i_find.eq(1)
                        m.next = "Find-Peak"
                with m.State("Find-Peak"), m.If(~weigher.o_busy):
                    m.d.comb += pairs.i_start.eq(1)
                    m.next = "Weigh"
            with m.State("Weigh"), m.If(~pairs.o_busy):
                m.next = "Send-Status"
            with m.State("Send-Status"):
                m.d.comb += sending.eq(1)
                with m.If(closes):
                    m.next = "Wait-Frame"
