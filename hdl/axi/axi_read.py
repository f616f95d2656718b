"""AXI4 reads with 64-bit addresses and 64-bit data: the channels, and a manager that reads bursts of up to 16 words."""

from amaranth import Cat, Const, Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import WORD_BYTES
from hdl.axi.axi_lite import Response
from hdl.axi.axi_write import ADDRESS, BURST_LOG2, BURST_WORDS, INCREMENTING, MODIFIABLE

MAX_OPEN_BURSTS = 8
"""As many as a memory port of a Zynq-7000 accepts."""
BURST_PART = data.StructLayout({"burst": 64 - BURST_LOG2, "first": range(BURST_WORDS), "last": range(BURST_WORDS)})
"""Words ``first`` to ``last`` of the 16 at a multiple of their length, whose address in bursts is ``burst``.

Whatever the part, no burst crosses 4 KiB.
"""
READ_WORD = data.StructLayout({"data": 8 * WORD_BYTES, "failed": 1})
"""A word from memory; ``failed``: it came with an error response, and means nothing."""


AXI_READ = wiring.Signature(
    {
        **{f"ar{name}": member for name, member in ADDRESS.items()},
        "arvalid": Out(1),
        "arready": In(1),
        "rdata": In(8 * WORD_BYTES),
        "rresp": In(2),
        "rlast": In(1),
        "rvalid": In(1),
        "rready": Out(1),
    }
)
"""Read address and read data; directions are the manager's.

There are no IDs: words come in the order of the bursts.
"""


class BurstReader(wiring.Component):
    """Reads bursts; their words come in order, one a clock while the memory gives them.

    Up to `MAX_OPEN_BURSTS` may be under way. Words that are not taken make the memory wait, so ask only for what there
    is room for. A reset forgets bursts under way, whose words would then come in front of others: software clears
    first, and the owner asks for nothing more and takes every word until ``o_all_answered``.
    """

    i: In(stream.Signature(BURST_PART))
    """What to read."""
    o: Out(stream.Signature(READ_WORD))
    """Its words; they pass in the clock in which the memory gives them."""
    bus: Out(AXI_READ)
    o_all_answered: Out(1)
    """Every burst has been read."""
    o_error: Out(1)
    """A word comes with a response other than OKAY in this clock."""

    def elaborate(self, platform: object) -> Module:
        """Offer an address until it is taken, and count the bursts."""
        m = Module()
        bus, part = self.bus, self.i.payload
        open_bursts = Signal(range(MAX_OPEN_BURSTS + 1))
        takes = self.i.valid & self.i.ready
        ends = bus.rvalid & bus.rready & bus.rlast
        m.d.comb += [
            bus.arsize.eq((WORD_BYTES - 1).bit_length()),
            bus.arburst.eq(INCREMENTING),
            bus.arcache.eq(MODIFIABLE),
            # arprot stays 0: unprivileged, secure, data.
            self.i.ready.eq((~bus.arvalid | bus.arready) & (open_bursts != MAX_OPEN_BURSTS)),
            self.o_all_answered.eq(open_bursts == 0),
            # Nobody waits for a word that no burst has asked for, whatever a broken memory offers.
            self.o.valid.eq(bus.rvalid & ~self.o_all_answered),
            self.o.payload.data.eq(bus.rdata),
            self.o.payload.failed.eq(bus.rresp != Response.OKAY),
            bus.rready.eq(self.o.ready & ~self.o_all_answered),
            self.o_error.eq(bus.rvalid & bus.rready & self.o.payload.failed),
        ]
        m.d.sync += open_bursts.eq(open_bursts + takes - ends)
        with m.If(takes):
            m.d.sync += [
                bus.arvalid.eq(1),
                bus.araddr.eq(Cat(Const(0, (WORD_BYTES - 1).bit_length()), part.first, part.burst)),
                bus.arlen.eq(part.last - part.first),
            ]
        with m.Elif(bus.arready):
            m.d.sync += bus.arvalid.eq(0)
        return m
