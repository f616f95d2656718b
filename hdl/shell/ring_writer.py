"""Writes packets into a ring of buffers in memory, each behind a header that is written last."""

from __future__ import annotations

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import WORD_BYTES
from hdl.axi.axi_write import BURST_BYTES, BURST_WORDS, AxiWriteInterface, AxiWriteSignature, BurstWriter
from hdl.lib.views import view_signal
from hdl.settings import PAGE_BYTES
from hdl.shell.slot import HEADER, HEADER_BYTES, slot_pages
from hdl.streams import WordPayload

FRAME_INFO = data.StructLayout({"number": 32, "time": 64})
"""A frame's number at the camera, and the clock in which it started."""
PAGE_BURSTS_LOG2 = (PAGE_BYTES // BURST_BYTES).bit_length() - 1


class RingWriter(wiring.Component):
    """Takes packets of records, and writes each into the next slot of a ring by AXI4 bursts.

    All bursts have 16 words and start at multiples of their length, so that none crosses 4 KiB; the words behind a
    packet's last one have no strobe. A burst starts only when its words are there, so that it never holds up the
    memory. The header (`hdl.shell.slot.HEADER`) is written when every other burst has been answered: a slot whose
    header has the expected sequence number is complete. Error responses are counted and flagged in the header.

    A packet that finds no free slot is discarded whole and counted; the camera's gate sees to it that this does not
    happen. So is every packet while the ring is off; then the ring starts over at its first slot.

    Throughput is 16 words in 18 clocks as long as the memory accepts them; ``fifo_words`` words wait inside.

    Parameters
    ----------
    record_words : int
        Length of the stream's records.
    max_words : int
        Length of the longest packet; a longer one is cut off and flagged.
    fifo_words : int
        At least two bursts.

    Members
    -------
    i : In(stream of WordPayload)
        Records; a packet ends with its FrameStatus.
    i_info : In(stream of FRAME_INFO)
        One for each packet, not after its first word; a packet without one has number and time 0.
    i_enable : In(1)
        The ring is on and can be written; sampled between packets.
    i_base_page, i_slots, i_slot_pages : In
        Where the ring lies and its shape, in pages of 4 KiB. May change only while ``i_enable`` is 0.
    i_full : In(1)
        Every slot holds a packet that software has not read.
    i_time : In(64)
        Clocks.
    bus : Out(AxiWriteSignature)
    o_written : Out(32)
        Packets in memory since the ring was switched on.
    o_errors, o_lost : Out(16)
        Error responses and packets without a slot since reset; they do not wrap.
    o_ended : Out(1)
        With the clock from which ``o_written`` counts the packet, or in which it has been discarded.
    o_error : Out(1)
        In the clock of an error response.
    o_idle : Out(1)
        No word is inside.
    o_active : Out(1)
        The ring may be written: it is on, or a packet that began before it was switched off is not finished.
    """

    i: stream.Interface
    i_info: stream.Interface
    i_enable: Signal
    i_base_page: Signal
    i_slots: Signal
    i_slot_pages: Signal
    i_full: Signal
    i_time: Signal
    bus: AxiWriteInterface
    o_written: Signal
    o_errors: Signal
    o_lost: Signal
    o_ended: Signal
    o_error: Signal
    o_idle: Signal
    o_active: Signal

    def __init__(self, *, record_words: int, max_words: int, fifo_words: int = 512) -> None:
        self.record_words = record_words
        self.needed_pages = slot_pages(max_words)
        self.fifo_words = fifo_words
        super().__init__(
            {
                "i": In(stream.Signature(WordPayload)),
                "i_info": In(stream.Signature(FRAME_INFO)),
                "i_enable": In(1),
                "i_base_page": In(52),
                "i_slots": In(9),
                "i_slot_pages": In(13),
                "i_full": In(1),
                "i_time": In(64),
                "bus": Out(AxiWriteSignature()),
                "o_written": Out(32),
                "o_errors": Out(16),
                "o_lost": Out(16),
                "o_ended": Out(1),
                "o_error": Out(1),
                "o_idle": Out(1),
                "o_active": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        """Words wait in a queue; a state machine takes them packet by packet."""
        m = Module()
        m.submodules.waiting = waiting = fifo.SyncFIFOBuffered(width=8 * WORD_BYTES + 1, depth=self.fifo_words)
        m.submodules.bursts = bursts = BurstWriter()
        wiring.connect(m, bursts.bus, wiring.flipped(self.bus))
        packet = _Packet(self)
        word, is_last = waiting.r_data[:-1], waiting.r_data[-1]
        takes = waiting.r_rdy & waiting.r_en
        ends = Signal(range(self.fifo_words + 1))
        m.d.sync += ends.eq(ends + (waiting.w_rdy & waiting.w_en & self.i.payload.last) - (takes & is_last))
        m.d.comb += [
            waiting.w_en.eq(self.i.valid),
            waiting.w_data.eq(Cat(self.i.payload.data, self.i.payload.last)),
            self.i.ready.eq(waiting.w_rdy),
            self.o_error.eq(bursts.o_error),
            bursts.i_burst.eq(Cat(packet.burst[:PAGE_BURSTS_LOG2], packet.page + packet.burst[PAGE_BURSTS_LOG2:])),
            # Behind the packet's last word 0, and not what arrives meanwhile: data must not change while they wait.
            bursts.i.payload.data.eq(Mux(packet.finished, 0, word)),
        ]
        with m.If(bursts.o_error):
            m.d.sync += [packet.failed.eq(1), self.o_errors.eq(_saturated(self.o_errors))]
        self._count(m, packet, takes, word)
        m.d.comb += self.o_active.eq(1)
        with m.FSM(name="packet"):
            with m.State("IDLE"):
                self._idle(m, packet, waiting)
            with m.State("WAIT"):
                self._wait(m, packet, bursts, (waiting.r_level >= BURST_WORDS) | ends.any())
            with m.State("RECORDS"):
                self._records(m, packet, waiting, bursts)
            with m.State("DISCARD"):
                m.d.comb += waiting.r_en.eq(1)
                self._discard(m, packet, takes & is_last)
            with m.State("ANSWERS"):
                m.d.sync += packet.burst.eq(0)
                with m.If(bursts.o_all_answered & (packet.burst == 0)):
                    m.d.comb += bursts.i_start.eq(1)
                    # The header must not change while it waits for the memory.
                    m.d.sync += packet.clocks.eq(self.i_time - packet.info.time)
                    m.next = "HEADER"
            with m.State("HEADER"):
                self._header(m, packet, bursts)
            with m.State("ANSWER"), m.If(bursts.o_all_answered):
                m.d.comb += self.o_ended.eq(1)
                self._next_slot(m, packet)
                m.next = "IDLE"
        return m

    def _count(self, m: Module, packet: _Packet, takes: Value, word: Value) -> None:
        """The packet's length, and the first word of its last record, which is the FrameStatus."""
        place = packet.place
        with m.If(takes):
            m.d.sync += [
                packet.length.eq(packet.length + WORD_BYTES),
                place.eq(Mux(place == self.record_words - 1, 0, place + 1)),
            ]
            with m.If(place == 0):
                m.d.sync += packet.status.eq(word)

    def _idle(self, m: Module, packet: _Packet, waiting: fifo.SyncFIFOBuffered) -> None:
        """Start with a packet; a ring that is off starts over."""
        m.d.comb += [self.o_idle.eq(waiting.r_level == 0), self.o_active.eq(packet.is_on)]
        m.d.sync += [
            packet.burst.eq(HEADER_BYTES // BURST_BYTES),
            *(each.eq(0) for each in (packet.finished, packet.overlong, packet.failed, packet.length, packet.place)),
        ]
        m.d.sync += packet.is_on.eq(self.i_enable)
        with m.If(~packet.is_on):
            m.d.sync += [self.o_written.eq(0), packet.slot.eq(0), packet.page.eq(self.i_base_page)]
        with m.If(waiting.r_rdy):
            m.d.comb += self.i_info.ready.eq(1)
            m.d.sync += packet.info.eq(Mux(self.i_info.valid, self.i_info.payload.as_value(), 0))
            m.next = "DISCARD"
            with m.If(packet.is_on & ~self.i_full):
                m.next = "WAIT"
            with m.Elif(packet.is_on):
                m.d.sync += self.o_lost.eq(_saturated(self.o_lost))

    def _wait(self, m: Module, packet: _Packet, bursts: BurstWriter, is_there: Value) -> None:
        """Start the next burst as soon as its words are there."""
        with m.If(packet.burst == self.needed_pages << PAGE_BURSTS_LOG2):
            m.d.sync += packet.overlong.eq(1)
            m.next = "DISCARD"
        with m.Elif(is_there & bursts.o_ready):
            m.d.comb += bursts.i_start.eq(1)
            m.d.sync += packet.burst.eq(packet.burst + 1)
            m.next = "RECORDS"

    def _discard(self, m: Module, packet: _Packet, ends: Value) -> None:
        """A packet without a slot ends here; one that was too long for its slot still gets a header."""
        m.d.comb += self.o_active.eq(packet.is_on | packet.overlong)
        with m.If(ends):
            m.next = "ANSWERS"
            with m.If(~packet.overlong):
                m.d.comb += self.o_ended.eq(1)
                m.next = "IDLE"

    def _records(self, m: Module, packet: _Packet, waiting: fifo.SyncFIFOBuffered, bursts: BurstWriter) -> None:
        """A burst of records; words without strobe behind the last one."""
        m.d.comb += [
            bursts.i.valid.eq(waiting.r_rdy | packet.finished),
            bursts.i.payload.kept.eq(~packet.finished),
            waiting.r_en.eq(bursts.i.ready & ~packet.finished),
        ]
        with m.If(bursts.i.valid & bursts.i.ready & waiting.r_data[-1]):
            m.d.sync += packet.finished.eq(1)
        with m.If(bursts.o_sent):
            m.next = "WAIT"
            with m.If(packet.finished):
                m.next = "ANSWERS"

    def _header(self, m: Module, packet: _Packet, bursts: BurstWriter) -> None:
        """The burst of the header; its fields are those of `hdl.shell.slot.HEADER`."""
        values = {
            "sequence": (self.o_written + 1)[:32],
            "length_bytes": packet.length,
            "number": packet.info.number,
            "flags": Cat(packet.overlong, packet.failed),
            "time": packet.info.time,
            "status": packet.status,
            "clocks": packet.clocks,
            "reserved": Const(0, 32),
        }
        bits = Cat(_resized(m, values[name], 8 * HEADER[name].itemsize) for name in HEADER.names or ())
        beat = Signal(range(BURST_WORDS))
        m.d.comb += [bursts.i.valid.eq(1), bursts.i.payload.kept.eq(beat < len(bits) // (8 * WORD_BYTES))]
        with m.Switch(beat):
            for number in range(len(bits) // (8 * WORD_BYTES)):
                with m.Case(number):
                    m.d.comb += bursts.i.payload.data.eq(bits.word_select(number, 8 * WORD_BYTES))
        with m.If(bursts.i.ready):
            m.d.sync += beat.eq(beat + 1)
        with m.If(bursts.o_sent):
            m.next = "ANSWER"

    def _next_slot(self, m: Module, packet: _Packet) -> None:
        m.d.sync += [
            self.o_written.eq(self.o_written + 1),
            packet.slot.eq(packet.slot + 1),
            packet.page.eq(packet.page + self.i_slot_pages),
        ]
        with m.If(packet.slot == self.i_slots - 1):
            m.d.sync += [packet.slot.eq(0), packet.page.eq(self.i_base_page)]


class _Packet:
    """What is known of the packet under way, and the slot for it."""

    def __init__(self, writer: RingWriter) -> None:
        self.info = view_signal(FRAME_INFO, name="info", reset_less=True)
        self.page = Signal(52)
        self.slot = Signal(9)
        self.burst = Signal(range((writer.needed_pages << PAGE_BURSTS_LOG2) + 1))
        self.length = Signal(32)
        self.place = Signal(range(writer.record_words))
        self.status = Signal(8 * WORD_BYTES, reset_less=True)
        self.clocks = Signal(32, reset_less=True)
        self.finished = Signal()
        self.is_on = Signal()
        self.overlong = Signal()
        self.failed = Signal()


def _saturated(count: Signal) -> Value:
    """The count and one more, or the largest it can hold."""
    return Mux(count.all(), count, count + 1)


def _resized(m: Module, value: Value, bits: int) -> Signal:
    resized = Signal(bits)
    m.d.comb += resized.eq(value)
    return resized
