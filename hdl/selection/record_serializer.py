"""Converts the features of a level into the words of their records."""

from amaranth import Array, Module, Mux, Signal
from amaranth.lib import stream
from amaranth.lib.wiring import In, Out

from golden_model.feature.ilbp import DescriptorPattern
from golden_model.records import Tag
from hdl.feature.extractor import feature_or_end
from hdl.lib.component import Component
from hdl.lib.views import view_signal
from hdl.streams import RowPayload, record_layout, words


class FeatureWords(Component):
    """Feature records of one level, one word per clock; index and frame number are still 0.

    The path from the selection is combinational: the selection holds a feature until its last word has been taken.

    Parameters
    ----------
    pattern : DescriptorPattern
    level : {0, 1}
    """

    i: stream.Interface
    """Stream of `hdl.feature.extractor.feature_or_end`."""
    o: Out(stream.Signature(RowPayload))

    def __init__(self, *, pattern: DescriptorPattern, level: int) -> None:
        self.level = level
        self._record = record_layout(pattern.record)
        super().__init__(i=In(stream.Signature(feature_or_end(pattern))))

    def elaborate(self, platform: object) -> Module:
        """Lay out the record and send its words one after another."""
        m = Module()
        record = view_signal(self._record)
        feature = self.i.p.feature
        m.d.comb += [record.tag.eq(Tag.FEATURE), record.level.eq(self.level)]
        m.d.comb += [record[name].eq(feature[name]) for name, _ in feature.shape()]
        word = Signal(range(len(words(record))))
        # The end of a row takes a single word, whose data means nothing.
        last = self.i.p.ends_row | (word == len(words(record)) - 1)
        m.d.comb += [
            self.o.valid.eq(self.i.valid),
            self.o.p.data.eq(Array(words(record))[word]),
            self.o.p.ends_row.eq(self.i.p.ends_row),
            self.o.p.ends_level.eq(self.i.p.ends_level),
            self.i.ready.eq(self.o.ready & last),
        ]
        with m.If(self.o.valid & self.o.ready):
            m.d.sync += word.eq(Mux(last, 0, word + 1))
        return m
