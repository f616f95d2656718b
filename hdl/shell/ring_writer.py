"""Writes packets into a ring of buffers in memory; the header in front of each is written last."""

from amaranth import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import WORD_BYTES
from hdl.axi.axi_write import AXI_WRITE, BURST_BYTES, BURST_WORDS, PAGE_BURSTS_LOG2, BurstWriter
from hdl.lib.views import view_signal
from hdl.shell.slot import HEADER, HEADER_BYTES, slot_pages
from hdl.streams import WordPayload

FRAME_INFO = data.StructLayout({"number": 32, "time": 64})
"""A frame's number at the camera, and the clock in which it started."""


class _Packet:
    """State of the packet in progress, and its slot."""

    def __init__(self, needed_pages: int, record_words: int) -> None:
        self.info = view_signal(FRAME_INFO, name="info", reset_less=True)
        # Addresses of 64 bits without the 12 of a page.
        self.page = Signal(52)
        self.slot = Signal(9)
        self.burst = Signal(range((needed_pages << PAGE_BURSTS_LOG2) + 1))
        self.length = Signal(32)
        self.place = Signal(range(record_words))
        self.status = Signal(8 * WORD_BYTES, reset_less=True)
        self.clocks = Signal(32, reset_less=True)
        self.finished = Signal()
        self.is_on = Signal()
        self.overlong = Signal()
        self.failed = Signal()


class RingWriter(wiring.Component):
    """Writes each packet of records into the next slot of a ring, by AXI4 bursts.

    All bursts have 16 words and start at multiples of their length, so that none crosses 4 KiB; words behind the end of
    the packet have no strobe. A burst starts only when all its words have arrived, so that it never blocks the memory.
    The header (`hdl.shell.slot.HEADER`) follows when every other burst has its response: a slot whose header has the
    expected sequence number is complete. Error responses are counted and flagged in the header.

    A packet without a free slot is discarded whole and counted; the camera's gate prevents this. While the ring is off,
    every packet is discarded, and the ring restarts at its first slot.

    Throughput is 16 words in 18 clocks while the memory accepts them; ``fifo_words`` words wait inside.

    Parameters
    ----------
    record_words : int
        Length of the stream's records.
    max_words : int
        Length of the longest packet; a longer one is cut off and flagged.
    fifo_words : int
        At least two bursts.
    """

    i: In(stream.Signature(WordPayload))
    """Records; a packet ends with its FrameStatus."""
    i_info: In(stream.Signature(FRAME_INFO))
    """One for each packet, at its first word at the latest; a packet without one has number and time 0."""
    i_enable: In(1)
    """The ring is on and can be written; sampled between packets."""
    i_base_page: In(52)
    """The ring's position in pages of 4 KiB. May change only while ``i_enable`` is 0, as the next two."""
    i_slots: In(9)
    """Number of slots."""
    i_slot_pages: In(13)
    """Length of a slot in pages."""
    i_full: In(1)
    """Every slot holds a packet that software has not read."""
    i_time: In(64)
    """Clocks since reset."""
    bus: Out(AXI_WRITE)
    o_written: Out(32)
    """Packets in memory since the ring was switched on."""
    o_errors: Out(16)
    """Error responses since reset; stays at the largest value."""
    o_lost: Out(16)
    """Packets without a slot since reset; stays at the largest value."""
    o_ended: Out(1)
    """High in the clock before ``o_written`` counts the packet, or in which a packet has been discarded."""
    o_error: Out(1)
    """High in the clock of an error response."""
    o_idle: Out(1)
    """No word is inside."""
    o_active: Out(1)
    """The ring may be written: it is on, or a packet that began before it was switched off is not finished."""

    def __init__(self, *, record_words: int, max_words: int, fifo_words: int = 512) -> None:
        self.record_words = record_words
        self.needed_pages = slot_pages(max_words)
        self.fifo_words = fifo_words
        self.bursts = BurstWriter()
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """A queue of words, and a state machine that takes them packet by packet."""
        m = Module()
        m.submodules.waiting = waiting = fifo.SyncFIFOBuffered(width=8 * WORD_BYTES + 1, depth=self.fifo_words)
        m.submodules.bursts = bursts = self.bursts
        wiring.connect(m, bursts.bus, wiring.flipped(self.bus))
        packet = _Packet(self.needed_pages, self.record_words)
        word, is_last = waiting.r_data[:-1], waiting.r_data[-1]
        takes = waiting.r_rdy & waiting.r_en
        # Packets' ends in the queue: with one of them, a burst need not wait for 16 words.
        ends = Signal(range(self.fifo_words + 1))
        m.d.sync += ends.eq(ends + (waiting.w_rdy & waiting.w_en & self.i.payload.last) - (takes & is_last))
        wiring.connect(m, wiring.flipped(self.i), waiting.w_stream)
        m.d.comb += [
            self.o_error.eq(bursts.o_error),
            bursts.i_burst.eq(Cat(packet.burst[:PAGE_BURSTS_LOG2], packet.page + packet.burst[PAGE_BURSTS_LOG2:])),
            # 0 behind the packet's last word, not what arrives meanwhile: AXI data must not change while they wait.
            bursts.i.payload.data.eq(Mux(packet.finished, 0, word)),
        ]
        with m.If(bursts.o_error):
            m.d.sync += [packet.failed.eq(1), self.o_errors.eq(count_up(self.o_errors))]
        self._count(m, packet, takes, word)
        # Only `_idle` and `_discard` say otherwise.
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
            # The header makes the slot valid, so everything else has to be in memory before it.
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
                m.d.sync += [
                    self.o_written.eq(self.o_written + 1),
                    packet.slot.eq(packet.slot + 1),
                    packet.page.eq(packet.page + self.i_slot_pages),
                ]
                with m.If(packet.slot == self.i_slots - 1):
                    m.d.sync += [packet.slot.eq(0), packet.page.eq(self.i_base_page)]
                m.next = "IDLE"
        return m

    def _count(self, m: Module, packet: _Packet, takes: Value, word: Value) -> None:
        """Add up the packet's length, and keep the first word of its last record, which is the FrameStatus."""
        place = packet.place
        with m.If(takes):
            m.d.sync += [
                packet.length.eq(packet.length + WORD_BYTES),
                place.eq(Mux(place == self.record_words - 1, 0, place + 1)),
            ]
            with m.If(place == 0):
                m.d.sync += packet.status.eq(word)

    def _idle(self, m: Module, packet: _Packet, waiting: fifo.SyncFIFOBuffered) -> None:
        """Choose a state for the next packet; restart a ring that is off."""
        m.d.comb += [self.o_idle.eq(waiting.r_level == 0), self.o_active.eq(packet.is_on)]
        m.d.sync += [
            # The header's burst is left out until the end.
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
                m.d.sync += self.o_lost.eq(count_up(self.o_lost))

    def _wait(self, m: Module, packet: _Packet, bursts: BurstWriter, has_words: Value) -> None:
        """Start the next burst as soon as its words have arrived."""
        with m.If(packet.burst == self.needed_pages << PAGE_BURSTS_LOG2):
            m.d.sync += packet.overlong.eq(1)
            m.next = "DISCARD"
        with m.Elif(has_words & bursts.o_ready):
            m.d.comb += bursts.i_start.eq(1)
            m.d.sync += packet.burst.eq(packet.burst + 1)
            m.next = "RECORDS"

    def _discard(self, m: Module, packet: _Packet, ends: Value) -> None:
        """Drop words up to the packet's end; a packet that was too long for its slot still gets a header."""
        m.d.comb += self.o_active.eq(packet.is_on | packet.overlong)
        with m.If(ends):
            m.next = "ANSWERS"
            with m.If(~packet.overlong):
                m.d.comb += self.o_ended.eq(1)
                m.next = "IDLE"

    def _records(self, m: Module, packet: _Packet, waiting: fifo.SyncFIFOBuffered, bursts: BurstWriter) -> None:
        """Send a burst of records; words behind the packet's last one have no strobe."""
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
        """Send the header's burst; its fields are those of `hdl.shell.slot.HEADER`."""
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
        bits = Cat(_resize(m, values[name], 8 * HEADER[name].itemsize) for name in HEADER.names or ())
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


def count_up(count: Signal) -> Value:
    """One more than the count, or its largest value."""
    return Mux(count.all(), count, count + 1)


def _resize(m: Module, value: Value, bits: int) -> Signal:
    resized = Signal(bits)
    m.d.comb += resized.eq(value)
    return resized
