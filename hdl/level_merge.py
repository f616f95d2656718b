"""Merges the features of the levels into one stream, in the golden order, and ends each frame with its status."""

from collections.abc import Sequence

from amaranth import Array, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.formats import RESPONSE_CODE
from golden_model.records import FRAME_STATUS, WORD_BYTES, Cause, Record, Tag
from hdl.frame_admission import CAUSES
from hdl.lib.component import Component
from hdl.lib.skid_buffer import SkidBuffer
from hdl.lib.views import view_signal
from hdl.streams import FRONT_END_SETTINGS, WORD, RowPayload, WordPayload, record_layout, words

ROW_LEVELS = (0, 0, 1)
"""Levels of the cell rows in the order in which they are sent, repeated: two of the full size, one of the half size."""

WITHOUT_PIXELS = Cause.MISSING_START | Cause.INVALID_SETTINGS
"""Causes of frames that never reach the levels."""


class LevelMerge(Component):
    """Sends two cell rows of level 0, then one of level 1, and so on; then the FrameStatus.

    This is the order in which cell rows become complete. Features get their index and frame number here. Features
    beyond ``max_features`` are dropped, and the frame is reported as bad.

    Parameters
    ----------
    record : Record
        Record of the features (`golden_model.records.feature_record`).
    levels : {1, 2}
    max_features : int
    """

    i_levels: Sequence[stream.Interface]
    """Per level, a stream of `hdl.streams.RowPayload`."""
    i_settings: In(FRONT_END_SETTINGS)
    """`hdl.streams.FRONT_END_SETTINGS` of the frame whose features arrive."""
    i_starts: In(1)
    """The first pixel of a frame has been admitted."""
    i_ends: In(1)
    """The last pixel of a frame has been admitted, or a frame without pixels (`WITHOUT_PIXELS`) must be reported."""
    i_causes: In(CAUSES)
    """Valid with ``i_ends``: the causes that make the frame bad."""
    i_threshold_code: In(RESPONSE_CODE.bits)
    """Valid with ``i_ends``: the frame's threshold."""
    o_pending: Out(1)
    """A frame has ended and its status has not been sent yet: no other frame may end."""
    o: Out(stream.Signature(WordPayload))

    def __init__(self, *, record: Record, levels: int, max_features: int) -> None:
        self.record = record
        self.levels = levels
        self.max_features = max_features
        super().__init__(i_levels=In(stream.Signature(RowPayload)).array(levels))

    def elaborate(self, platform: object) -> Module:
        """Pass rows on until every level has ended, then send the status."""
        m = Module()
        m.submodules.features = features = SkidBuffer(shape=WORD)
        m.submodules.output = output = SkidBuffer(shape=WordPayload)
        wiring.connect(m, wiring.flipped(self.o), output.o)
        record_words = self.record.record_bytes // WORD_BYTES
        word = Signal(range(record_words))
        record_ends = word == record_words - 1
        passing = Signal()
        sent = Signal()
        # A status word is selected in one clock and sent in the next; `is_chosen` says that it has been selected.
        is_chosen = Signal()
        taken = features.o.valid & features.o.ready
        given = output.i.valid & output.i.ready
        exhausted = self._select_rows(m, features.i, restart=sent) & ~features.o.valid
        index, full, overflow = self._count(m, taken & record_ends, restart=sent)
        status, without_pixels = self._status(m, index, overflow, passing, sent)
        numbers, status_word = self._words(m, word, index, status)
        # Index and frame number are 0 in the words of the levels, so an OR inserts them.
        m.d.comb += output.i.payload.data.eq(Mux(is_chosen, status_word, features.o.payload | numbers))
        with m.If(taken | given):
            m.d.sync += word.eq(Mux(record_ends, 0, word + 1))
        with m.FSM():
            with m.State("Pass-Rows"):
                m.d.comb += [
                    passing.eq(1),
                    output.i.valid.eq(features.o.valid & ~full),
                    # Features beyond the capacity are taken and dropped: waiting for space would hang the frame.
                    features.o.ready.eq(output.i.ready | full),
                ]
                with m.If(self.o_pending & (exhausted | without_pixels)):
                    m.next = "Send-Status"
            with m.State("Send-Status"):
                m.d.comb += [output.i.valid.eq(is_chosen), output.i.payload.last.eq(record_ends)]
                # Selecting one word out of the whole status takes a clock of its own, to keep the path short.
                m.d.sync += is_chosen.eq(~(is_chosen & output.i.ready))
                with m.If(is_chosen & output.i.ready & record_ends):
                    m.next = "Start-Over"
            with m.State("Start-Over"):
                m.d.comb += sent.eq(1)
                m.next = "Pass-Rows"
        return m

    def _count(self, m: Module, record: Value, *, restart: Value) -> tuple[Signal, Signal, Signal]:
        """Count records up to the capacity: return the count, whether it is reached, and whether it is exceeded."""
        index = Signal(range(self.max_features + 1))
        full = Signal()
        overflow = Signal()
        with m.If(record):
            m.d.sync += overflow.eq(overflow | full)
            with m.If(~full):
                m.d.sync += [index.eq(index + 1), full.eq(index == self.max_features - 1)]
        with m.If(restart):
            m.d.sync += [index.eq(0), full.eq(0), overflow.eq(0)]
        return index, full, overflow

    def _words(self, m: Module, word: Value, index: Value, status: data.View) -> tuple[Value, Signal]:
        """Return a word of a record with nothing but index and frame number, and one of the status, a clock later."""
        numbers = view_signal(record_layout(self.record))
        status_word = Signal(WORD, reset_less=True)
        m.d.sync += status_word.eq(Array(words(status))[word])
        m.d.comb += [numbers.index.eq(index), numbers.frame.eq(status.frame)]
        return Array(words(numbers))[word], status_word

    def _select_rows(self, m: Module, features: stream.Interface, *, restart: Value) -> Value:
        """Pass on the words of the level whose cell row is next; return whether all levels have ended."""
        order = ROW_LEVELS if self.levels == 2 else ROW_LEVELS[:1]
        step = Signal(range(len(order)))
        level = Signal(range(self.levels))
        ended = Signal(self.levels)
        # Levels alternate in a fixed order, whichever has words waiting: the order of features must not depend on time.
        following = Mux(step == len(order) - 1, 0, step + 1)
        item = data.View(RowPayload, Array(source.payload.as_value() for source in self.i_levels)[level])
        valid = Signal()
        for n, source in enumerate(self.i_levels):
            with m.If((level == n) & ~ended[n]):
                m.d.comb += [valid.eq(source.valid), source.ready.eq(source.payload.ends_row | features.ready)]
        row_ends = valid & item.ends_row
        m.d.comb += [features.payload.eq(item.data), features.valid.eq(valid & ~item.ends_row)]
        # A level that has ended is skipped: with odd numbers of cell rows one level ends before the other.
        with m.If(row_ends | ended.bit_select(level, 1)):
            m.d.sync += [step.eq(following), level.eq(Array(order)[following])]
        with m.If(row_ends & item.ends_level):
            m.d.sync += ended.bit_select(level, 1).eq(1)
        with m.If(restart):
            m.d.sync += [step.eq(0), level.eq(ROW_LEVELS[0]), ended.eq(0)]
        return ended.all()

    def _status(self, m: Module, index: Value, overflow: Value, passing: Value, sent: Value) -> tuple[data.View, Value]:
        """Return the status of the frame that has ended, and whether it had no pixels."""
        clock = Signal(32, reset_less=True)
        start = Signal(32, reset_less=True)
        cycles = Signal(32, reset_less=True)
        frame = Signal(32)
        layout = data.StructLayout({"causes": CAUSES, "threshold_code": RESPONSE_CODE.bits, "start": 32})
        end = view_signal(layout, reset_less=True)
        without_pixels = (end.causes & WITHOUT_PIXELS).any()
        m.d.sync += clock.eq(clock + 1)
        # Stops with the last feature: the wait of the status does not count.
        with m.If(passing):
            m.d.sync += cycles.eq(Mux(without_pixels, 0, clock - end.start))
        with m.If(self.i_starts):
            m.d.sync += start.eq(clock)
        with m.If(self.i_ends):
            m.d.sync += [
                self.o_pending.eq(1),
                end.causes.eq(self.i_causes),
                end.threshold_code.eq(self.i_threshold_code),
                end.start.eq(start),
            ]
        with m.If(sent):
            m.d.sync += [self.o_pending.eq(0), frame.eq(frame + 1)]

        # Registers, to keep the path short: a frame has ended a clock before the first word of its status is selected.
        causes = Signal(CAUSES, reset_less=True)
        good = Signal(reset_less=True)
        found = end.causes | Mux(overflow, Cause.TOO_MANY_FEATURES, 0)
        m.d.sync += [causes.eq(found), good.eq(~found.any())]
        status = view_signal(record_layout(FRAME_STATUS, self.record.record_bytes))
        m.d.comb += [
            status.tag.eq(Tag.FRAME_STATUS),
            status.causes.eq(causes),
            status.good.eq(good),
            status.frame.eq(frame),
            status.width.eq(self.i_settings.width_px),
            status.height.eq(self.i_settings.height_px),
            status.features.eq(Mux(good, index, 0)),
            status.threshold.eq(end.threshold_code),
            status.cycles.eq(cycles),
        ]
        return status, without_pixels
