"""AXI4-Lite subordinate: one word at a time, no combinational path from input to output."""

import enum

from amaranth import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.delay import port_register

ADDRESS_BITS = 12
"""A block of 4 KB, the smallest that AXI interconnects decode."""


class Response(enum.IntEnum):
    """BRESP and RRESP."""

    OKAY = 0
    SLVERR = 2


_ADDRESS = {"addr": Out(ADDRESS_BITS), "prot": Out(3), "valid": Out(1), "ready": In(1)}
AXI_LITE = wiring.Signature(
    {
        **{f"aw{name}": member for name, member in _ADDRESS.items()},
        "wdata": Out(32),
        "wstrb": Out(4),
        "wvalid": Out(1),
        "wready": In(1),
        "bresp": In(2),
        "bvalid": In(1),
        "bready": Out(1),
        **{f"ar{name}": member for name, member in _ADDRESS.items()},
        "rdata": In(32),
        "rresp": In(2),
        "rvalid": In(1),
        "rready": Out(1),
    }
)
"""The five channels with 32-bit data; directions are the manager's."""


class AxiLiteSubordinate(wiring.Component):
    """Turns accesses into pulses: address and data are valid in the clock in which ``o_write`` or ``o_read`` is high.

    Writes and reads are independent. Each accepts its next access when the previous response has been taken. Every
    response is OKAY: an error would end the process that reads a wrong address, and on a 64-bit ARM stop Linux for a
    write (an SError).
    """

    bus: In(AXI_LITE)
    o_write: Out(1)
    """High for one clock per write."""
    o_read: Out(1)
    """High for one clock per read."""
    o_write_word: Out(ADDRESS_BITS - 2)
    """Word address of the write."""
    o_read_word: Out(ADDRESS_BITS - 2)
    """Word address of the read."""
    o_data: Out(32)
    """Write data."""
    o_strobe: Out(4)
    """Byte strobes of the write data."""
    i_data: In(32)
    """Read data, in the clock of ``o_read``."""

    def elaborate(self, platform: object) -> Module:
        """One state machine for writes, one for reads."""
        m = Module()
        m.d.comb += [self.bus.bresp.eq(Response.OKAY), self.bus.rresp.eq(Response.OKAY)]
        self._writes(m)
        self._reads(m)
        return m

    def _writes(self, m: Module) -> None:
        """Accept address and data in any order; when both are there, write and respond."""
        bus = self.bus
        has_address = Signal()
        has_data = Signal()
        word = port_register(m, self.o_write_word)
        data = port_register(m, self.o_data)
        strobe = port_register(m, self.o_strobe)
        # Low during reset: an access accepted then would never get a response.
        running = Signal()
        m.d.sync += running.eq(1)
        m.d.comb += [
            bus.awready.eq(running & ~has_address),
            bus.wready.eq(running & ~has_data),
            # One response register: a write waits until the manager has taken the response before.
            self.o_write.eq(has_address & has_data & ~bus.bvalid),
        ]
        with m.If(bus.awvalid & bus.awready):
            m.d.sync += [has_address.eq(1), word.eq(bus.awaddr[2:])]
        with m.If(bus.wvalid & bus.wready):
            m.d.sync += [has_data.eq(1), data.eq(bus.wdata), strobe.eq(bus.wstrb)]
        with m.If(bus.bready):
            m.d.sync += bus.bvalid.eq(0)
        with m.If(self.o_write):
            m.d.sync += [has_address.eq(0), has_data.eq(0), bus.bvalid.eq(1)]

    def _reads(self, m: Module) -> None:
        bus = self.bus
        has_address = Signal()
        running = Signal()
        word = port_register(m, self.o_read_word)
        data = port_register(m, bus.rdata)
        m.d.sync += running.eq(1)
        m.d.comb += [bus.arready.eq(running & ~has_address), self.o_read.eq(has_address & ~bus.rvalid)]
        with m.If(bus.arvalid & bus.arready):
            m.d.sync += [has_address.eq(1), word.eq(bus.araddr[2:])]
        with m.If(bus.rready):
            m.d.sync += bus.rvalid.eq(0)
        with m.If(self.o_read):
            m.d.sync += [has_address.eq(0), bus.rvalid.eq(1), data.eq(self.i_data)]
