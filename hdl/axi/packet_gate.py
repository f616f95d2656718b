"""Passes or discards whole packets of records, and captures their FrameStatus."""

from __future__ import annotations

from amaranth import Cat, Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import FRAME_STATUS, WORD_BYTES
from hdl.streams import WordPayload, record_layout


class PacketGate(wiring.Component):
    """Passes whole packets or discards whole packets, and reports the FrameStatus of each.

    Throughput is a word a clock; the switch takes a clock before each packet.

    Members
    -------
    i : In(stream of WordPayload)
        Records; a packet ends with its FrameStatus.
    i_enable : In(1)
        Whether the next packet passes; sampled between packets only, so that none is cut.
    o : Out(stream of WordPayload)
    o_done : Out(1)
        One clock after the last word of a packet left or was discarded.
    o_status : Out(FrameStatus)
        Of the last packet; valid from ``o_done`` on.
    """

    i: stream.Interface
    i_enable: Signal
    o: stream.Interface
    o_done: Signal
    o_status: data.View

    def __init__(self, *, record_bytes: int) -> None:
        self.record_words = record_bytes // WORD_BYTES
        self._layout = record_layout(FRAME_STATUS)
        super().__init__(
            {
                "i": In(stream.Signature(WordPayload)),
                "i_enable": In(1),
                "o": Out(stream.Signature(WordPayload)),
                "o_done": Out(1),
                "o_status": Out(self._layout),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """A switch that changes only between packets, and a shift register for the last record."""
        m = Module()
        passes = Signal()
        under_way = Signal()
        word = Signal(range(self.record_words))
        status = Signal(self._layout.size)
        m.d.comb += [
            self.o.valid.eq(self.i.valid & under_way & passes),
            self.o.payload.eq(self.i.payload),
            self.i.ready.eq(under_way & (self.o.ready | ~passes)),
            self.o_status.eq(status),
        ]
        m.d.sync += self.o_done.eq(0)
        with m.If(~under_way):
            m.d.sync += [passes.eq(self.i_enable), under_way.eq(self.i.valid)]
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += word.eq(word + 1)
            with m.If(word == self.record_words - 1):
                m.d.sync += word.eq(0)
            # A status is padded to the length of the other records; only its own words are kept.
            with m.If(word < self._layout.size // (8 * WORD_BYTES)):
                m.d.sync += status.eq(Cat(status, self.i.payload.data)[8 * WORD_BYTES :])
            with m.If(self.i.payload.last):
                m.d.sync += [self.o_done.eq(1), under_way.eq(0)]
        return m
