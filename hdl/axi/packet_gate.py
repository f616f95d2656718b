"""A gate that passes or discards whole packets, captures their FrameStatus, and completes those that break off."""

from amaranth import Cat, Module, Mux, ResetInserter, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import FRAME_STATUS, WORD_BYTES, Cause, Tag
from hdl.lib.skid_buffer import SkidBuffer
from hdl.streams import WORD, WordPayload, record_layout, words

CLOSING_RECORDS = 2
"""Records by which a packet that breaks off may be longer: the one that was begun, and its FrameStatus."""
_STATUS = record_layout(FRAME_STATUS)


class PacketGate(wiring.Component):
    """Passes or discards whole packets, and reports the FrameStatus of each.

    ``i_clear`` breaks off the packet in progress. Words already offered must still be taken: AXI4-Stream forbids to
    withdraw them. Then zeros complete the record, and a FrameStatus (`Cause.CLEARED`) ends the packet, which may
    thus be longer by `CLOSING_RECORDS`. Only then is the next packet accepted. A packet of which nothing has been
    offered is dropped.

    Throughput is one word per clock; before each packet the switch takes another clock.

    Parameters
    ----------
    record_bytes : int
        Length of the stream's records.
    """

    i: In(stream.Signature(WordPayload))
    """Records; a packet ends with its FrameStatus. Its ready does not depend on its valid."""
    i_enable: In(1)
    """Whether the next packet passes; sampled between packets only, so that none is cut."""
    i_clear: In(1)
    """The source breaks off in this clock, and continues with a new packet."""
    o: Out(stream.Signature(WordPayload))
    o_done: Out(1)
    """One clock after the last word of a packet left or was discarded; not after a packet that was broken off."""
    o_closing: Out(1)
    """A packet that was broken off is not complete."""
    o_status: Out(_STATUS)
    """The last packet's status; valid from ``o_done`` on."""

    latency_cycles = SkidBuffer.latency_cycles
    """From input to output, while the output does not stall; the first word of a packet takes another clock."""
    buffer: SkidBuffer
    """The register stage in front."""

    def __init__(self, *, record_bytes: int) -> None:
        self.record_words = record_bytes // WORD_BYTES
        # It keeps a late ready of the DMA out of the blocks in front.
        self.buffer = SkidBuffer(shape=WordPayload)
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """A switch that changes between packets only, a shift register for the last record, and the closing words."""
        m = Module()
        passes = Signal()
        under_way = Signal()
        closing = self.o_closing
        closing_status = Signal()
        forgets = Signal()
        advances = Signal()
        in_packet = Signal()
        word = Signal(range(self.record_words))
        status = Signal(_STATUS.size, reset_less=True)
        buffer, waiting = self.buffer, self.buffer.o
        m.submodules.buffer = ResetInserter(forgets)(buffer)
        record_ends, fills = word == self.record_words - 1, closing & ~waiting.valid
        m.d.comb += [
            buffer.i.valid.eq(self.i.valid & ~closing),
            buffer.i.payload.eq(self.i.payload),
            self.i.ready.eq(buffer.i.ready & ~closing),
            self.o.valid.eq((waiting.valid | closing) & under_way & passes),
            self.o.payload.eq(waiting.payload),
            waiting.ready.eq(under_way & (self.o.ready | ~passes)),
            advances.eq((waiting.valid | closing) & waiting.ready),
            in_packet.eq(under_way & passes & ~(advances & self.o.payload.last)),
            # What the buffer holds behind a closed packet's last word was sent before the clear.
            forgets.eq(Mux(closing, advances & self.o.payload.last, self.i_clear & ~in_packet)),
            self.o_status.eq(status),
        ]
        cleared = _STATUS.const({"tag": Tag.FRAME_STATUS, "causes": Cause.CLEARED})
        with m.If(fills):
            m.d.comb += [
                self.o.payload.data.eq(Mux(word == 0, words(cleared)[0], 0)),
                self.o.payload.last.eq(closing_status & record_ends),
            ]
        m.d.sync += self.o_done.eq(0)
        with m.If(~under_way):
            m.d.sync += [passes.eq(self.i_enable), under_way.eq(waiting.valid)]
        with m.If(advances):
            m.d.sync += word.eq(Mux(record_ends, 0, word + 1))
            # A status is padded to the length of the other records; only its own words are kept.
            with m.If(word < _STATUS.size // WORD.width):
                m.d.sync += status.eq(Cat(status, waiting.payload.data)[WORD.width :])
            with m.If(fills & (word == 0)):
                m.d.sync += closing_status.eq(1)
            with m.If(self.o.payload.last):
                # A packet that breaks off belongs to no frame, so it raises no event.
                m.d.sync += [self.o_done.eq(~closing), under_way.eq(0), closing.eq(0), closing_status.eq(0)]
        with m.If(self.i_clear & ~closing):
            m.d.sync += [self.o_done.eq(0), closing.eq(in_packet)]
            with m.If(~in_packet):
                m.d.sync += [under_way.eq(0), word.eq(0)]
        return m
