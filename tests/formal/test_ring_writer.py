"""The way into memory: AXI's rules are kept, and nothing is written outside of the ring or into a slot being read."""

from pathlib import Path

import pytest
from amaranth import Cat, Elaboratable, Module, Mux, Signal, Value
from amaranth.hdl import Assert, Assume, Cover

from golden_model.records import WORD_BYTES
from hdl.axi.axi_write import BURST_BYTES, BURST_WORDS, MAX_OUTSTANDING, BurstWriter
from hdl.settings import PAGE_BYTES
from hdl.shell.ring_writer import RingWriter
from tests.formal.proofs import held, prove

BASE_PAGE, SLOTS = 5, 2


class _Memory:
    """A memory that takes what it likes, and answers every burst once, at any time after its last word."""

    def __init__(self) -> None:
        self.awready, self.wready, self.answers, self.fails = (Signal(name=name) for name in ("aw", "w", "b", "fails"))
        self.ports = [self.awready, self.wready, self.answers, self.fails]

    def connect(self, m: Module, bus: object, *, stable: Value) -> Signal:
        """Check the rules on ``bus``; ``stable`` must not change while it waits. Returns the bursts not answered."""
        m.d.comb += [
            bus.awready.eq(self.awready),
            bus.wready.eq(self.wready),
            bus.bvalid.eq(self.answers),
            bus.bresp.eq(Cat(0, self.fails)),
        ]
        held(m, Assert, bus.awvalid, bus.awready, bus.awaddr)
        held(m, Assert, bus.wvalid, bus.wready, stable, bus.wlast)
        addressed, written, beat = Signal(range(MAX_OUTSTANDING + 2)), Signal(range(MAX_OUTSTANDING + 2)), Signal(4)
        ends = bus.wvalid & bus.wready & bus.wlast
        addresses = bus.awvalid & bus.awready
        m.d.sync += [addressed.eq(addressed + addresses - self.answers), written.eq(written + ends - self.answers)]
        with m.If(bus.wvalid & bus.wready):
            m.d.sync += beat.eq(beat + 1)
        m.d.comb += [
            Assume(~self.answers | ((addressed != 0) & (written != 0))),
            Assert((addressed <= MAX_OUTSTANDING) & (written <= MAX_OUTSTANDING)),
            Assert((bus.awlen == BURST_WORDS - 1) & (bus.awsize == (WORD_BYTES - 1).bit_length())),
        ]
        with m.If(bus.wvalid):
            # Data of one burst only, whether its address waits or has been taken; the last of 16 words says so.
            m.d.comb += [Assert(addressed + bus.awvalid == written + 1), Assert(bus.wlast == (beat == BURST_WORDS - 1))]
        with m.If(bus.awvalid):
            # Bursts at multiples of their length do not cross 4 KiB.
            m.d.comb += Assert(bus.awaddr % BURST_BYTES == 0)
        assert PAGE_BYTES % BURST_BYTES == 0
        return addressed


class _Bursts(Elaboratable):
    """Bursts start whenever they may; their words come at any time and stay until they are taken."""

    def __init__(self) -> None:
        self.bursts, self.memory = BurstWriter(), _Memory()
        self.valid, self.bit, self.start, self.kept = (Signal(name=name) for name in ("valid", "bit", "start", "kept"))
        self.burst = Signal(2)
        self.ports = [*self.memory.ports, self.valid, self.bit, self.start, self.kept, self.burst]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.bursts = bursts = self.bursts
        m.d.comb += [
            bursts.i.valid.eq(self.valid),
            bursts.i.payload.data.eq(self.bit),
            bursts.i.payload.kept.eq(self.kept),
            bursts.i_start.eq(self.start),
            bursts.i_burst.eq(self.burst),
        ]
        held(m, Assume, self.valid, bursts.i.ready, self.bit, self.kept)
        bus = bursts.bus
        opened = self.memory.connect(m, bus, stable=Cat(bus.wdata[0], bus.wstrb))
        chosen = Signal(2)
        with m.If(self.start & bursts.o_ready):
            m.d.sync += chosen.eq(self.burst)
        with m.If(bus.awvalid):
            m.d.comb += Assert(bus.awaddr == chosen * BURST_BYTES)
        with m.If(bus.wvalid):
            m.d.comb += Assert((bus.wdata == self.bit) & (bus.wstrb == Mux(self.kept, 0xFF, 0)))
        with m.If(bursts.o_all_answered):
            m.d.comb += Assert((opened == 0) & ~bus.awvalid & ~bus.wvalid)
        m.d.comb += [Cover(bursts.o_sent & (chosen == 3)), Cover(bursts.o_error)]
        # The address is in no hurry, and the data do not wait for it.
        m.d.comb += Cover(bus.wvalid & bus.wready & bus.wlast & bus.awvalid & ~bus.awready)
        return m


class _Ring(Elaboratable):
    """Packets of any length, a ring that is switched off and on, a reader that frees slots or never does.

    What the memory answers has no part in where a burst goes: it may answer anything, at any time while bursts are
    open.
    """

    def __init__(self) -> None:
        self.writer = RingWriter(record_words=2, max_words=2, fifo_words=2 * BURST_WORDS)
        self.valid, self.last, self.enable, self.reads = (Signal(name=n) for n in ("valid", "last", "enable", "reads"))
        bus, self.answers = self.writer.bus, Signal()
        self.ports = [self.valid, self.last, self.enable, self.reads, bus.awready, bus.wready, self.answers, bus.bresp]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.writer = writer = self.writer
        unread, counted = Signal(2), Signal()
        m.d.comb += [
            writer.i.valid.eq(self.valid),
            writer.i.payload.last.eq(self.last),
            writer.i_enable.eq(self.enable),
            writer.i_base_page.eq(BASE_PAGE),
            writer.i_slots.eq(SLOTS),
            writer.i_slot_pages.eq(1),
            writer.i_full.eq(unread >= SLOTS),
        ]
        # A packet that is discarded has no header.
        ended = writer.o_ended & counted
        with m.If(writer.o_ended):
            m.d.sync += counted.eq(0)
        with m.Elif(writer.bus.awvalid):
            m.d.sync += counted.eq(1)
        with m.If(ended & ~(self.reads & (unread != 0))):
            m.d.sync += unread.eq(unread + 1)
        with m.Elif(self.reads & (unread != 0) & ~ended):
            m.d.sync += unread.eq(unread - 1)
        bus = writer.bus
        held(m, Assert, bus.awvalid, bus.awready, bus.awaddr)
        page = bus.awaddr[12:]
        with m.If(bus.awvalid):
            m.d.comb += [
                Assert((page == BASE_PAGE) | (page == BASE_PAGE + 1)),
                Assert(page[0] == (BASE_PAGE + writer.o_written)[0]),
                Assert(unread < SLOTS),
            ]
        m.d.comb += [Assert(unread <= SLOTS), Cover(bus.wvalid & bus.wready & bus.wlast)]
        # What a reset waits for; `_Bursts` shows that nothing is open then.
        answered = writer.bursts.o_all_answered
        m.d.comb += [bus.bvalid.eq(self.answers & ~answered), Assert(~writer.o_idle | answered)]
        return m


@pytest.mark.slow
def test_bursts_keep_the_rules(tmp_path: Path) -> None:
    prove(_Bursts(), tmp_path)


@pytest.mark.slow
def test_a_ring_is_never_left_and_no_slot_is_overwritten(tmp_path: Path) -> None:
    prove(_Ring(), tmp_path)
