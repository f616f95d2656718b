"""The way out of memory: AXI's rules are kept, and no word is lost, made up or changed."""

from pathlib import Path

import pytest
from amaranth import Cat, Elaboratable, Module, Signal
from amaranth.hdl import Assert, Assume, Cover

from golden_model.records import WORD_BYTES
from hdl.axi.axi_read import MAX_OPEN_BURSTS, BurstReader
from hdl.settings import PAGE_BYTES
from tests.formal.proofs import held, in_flight, prove


class _Reads(Elaboratable):
    """Bursts are asked for at any time; the memory takes and gives what it likes, even what nobody has asked for."""

    def __init__(self) -> None:
        self.reader = BurstReader()
        # The lowest bits of a burst's number choose its place in a page.
        self.burst, self.first, self.last, self.word = Signal(6), Signal(4), Signal(4), Signal(2)
        i, o, bus = self.reader.i, self.reader.o, self.reader.bus
        self.ports = [i.valid, self.burst, self.first, self.last, o.ready]
        self.ports += [bus.arready, bus.rvalid, bus.rlast, bus.rresp, self.word]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.reader = reader = self.reader
        i, o, bus, part = reader.i, reader.o, reader.bus, reader.i.payload
        m.d.comb += [part.burst.eq(self.burst), part.first.eq(self.first), part.last.eq(self.last)]
        m.d.comb += [Cat(bus.rdata[0], bus.rdata[-1]).eq(self.word)]
        held(m, Assume, i.valid, i.ready, self.burst, self.first, self.last)
        with m.If(i.valid):
            m.d.comb += Assume(self.first <= self.last)
        held(m, Assert, bus.arvalid, bus.arready, bus.araddr, bus.arlen)
        asks, gives = bus.arvalid & bus.arready, bus.rvalid & bus.rready
        taken = in_flight(m, i.valid & i.ready, gives & bus.rlast, most=MAX_OPEN_BURSTS)
        # Those whose address the memory has seen: it gives no words of another.
        asked = Signal(range(MAX_OPEN_BURSTS + 2))
        m.d.sync += asked.eq(asked + asks - (gives & bus.rlast))
        with m.If(bus.rvalid & (taken != 0)):
            m.d.comb += Assume(asked != 0)
        m.d.comb += [
            Assert(asked + bus.arvalid == taken),
            Assert(reader.o_all_answered == (taken == 0)),
            # A word passes in its clock, and is taken by both sides or by none; one without a burst never.
            Assert(gives == (o.valid & o.ready)),
            Assert(o.valid == (bus.rvalid & (taken != 0))),
            Assert(Cat(o.payload.data[0], o.payload.data[-1]) == self.word),
            Assert(o.payload.failed == bus.rresp.any()),
            Assert(reader.o_error == (gives & bus.rresp.any())),
        ]
        chosen = Signal.like(part)
        with m.If(i.valid & i.ready):
            m.d.sync += chosen.eq(part)
        with m.If(bus.arvalid):
            end = bus.araddr[: (PAGE_BYTES - 1).bit_length()] + (bus.arlen + 1) * WORD_BYTES
            m.d.comb += [
                Assert(bus.araddr == Cat(Signal(3), chosen.first, chosen.burst)),
                Assert(bus.arlen == chosen.last - chosen.first),
                Assert(end <= PAGE_BYTES),
            ]
        m.d.comb += [Cover(taken == MAX_OPEN_BURSTS), Cover(bus.rvalid & reader.o_all_answered), Cover(reader.o_error)]
        return m


@pytest.mark.slow
def test_reads_keep_the_rules(tmp_path: Path) -> None:
    prove(_Reads(), tmp_path)
