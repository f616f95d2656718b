"""AXI4 writes with 64-bit addresses and 64-bit data: the channels, and a manager that writes fixed-length bursts."""

from amaranth import Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.records import WORD_BYTES
from hdl.axi.axi_lite import Response
from hdl.settings import PAGE_BYTES

BURST_WORDS = 16
"""Not longer, because the memory ports of a Zynq-7000 are AXI3, whose bursts end at 16 words."""
BURST_BYTES = BURST_WORDS * WORD_BYTES
BURST_LOG2 = (BURST_BYTES - 1).bit_length()
PAGE_BURSTS_LOG2 = (PAGE_BYTES // BURST_BYTES).bit_length() - 1
MAX_OUTSTANDING = 15
INCREMENTING = 1
"""AWBURST of a burst whose addresses rise."""
MODIFIABLE = 0b0010
"""AWCACHE: an interconnect may change the width. Not bufferable: the response then comes from the memory itself, and
every reader sees the burst once it has arrived."""
BURST_WORD = data.StructLayout({"data": 8 * WORD_BYTES, "kept": 1})
"""A word of a burst; it is written only where ``kept``."""


ADDRESS = {"addr": Out(64), "len": Out(8), "size": Out(3), "burst": Out(2), "cache": Out(4), "prot": Out(3)}
"""What an address channel says of a burst; its signals have the prefix ``aw`` or ``ar``."""
AXI_WRITE = wiring.Signature(
    {
        **{f"aw{name}": member for name, member in ADDRESS.items()},
        "awvalid": Out(1),
        "awready": In(1),
        "wdata": Out(8 * WORD_BYTES),
        "wstrb": Out(WORD_BYTES),
        "wlast": Out(1),
        "wvalid": Out(1),
        "wready": In(1),
        "bresp": In(2),
        "bvalid": In(1),
        "bready": Out(1),
    }
)
"""Write address, write data and write response; directions are the manager's.

There are no IDs: responses come in the order of the bursts.
"""


class BurstWriter(wiring.Component):
    """Writes bursts of 16 words, one after the other, at multiples of their length: none crosses 4 KiB.

    Address and data are offered side by side, since a memory may wait for data before it accepts the address. Up to
    `MAX_OUTSTANDING` bursts may be without a response; ``o_ready`` stays low until one of them has it. A reset drops
    bursts in progress: software clears first, and waits until `clearing` in STATUS is 0.
    """

    i_start: In(1)
    """Start a burst; ignored unless ``o_ready``."""
    i_burst: In(64 - BURST_LOG2)
    """Its address in bursts, with ``i_start``."""
    i: In(stream.Signature(BURST_WORD))
    """Its words, taken from the clock after ``i_start`` on."""
    bus: Out(AXI_WRITE)
    o_ready: Out(1)
    """A burst may start."""
    o_sent: Out(1)
    """Address and words of every burst have been taken."""
    o_all_answered: Out(1)
    """Every burst has been sent and answered."""
    o_error: Out(1)
    """A response other than OKAY comes in this clock."""

    def elaborate(self, platform: object) -> Module:
        """Send address and data independently, and count the responses."""
        m = Module()
        bus, word = self.bus, self.i.payload
        burst = Signal.like(self.i_burst, reset_less=True)
        sending = Signal()
        beat = Signal(range(BURST_WORDS))
        outstanding = Signal(range(MAX_OUTSTANDING + 1))
        m.d.comb += [
            bus.awaddr.eq(burst << BURST_LOG2),
            bus.awlen.eq(BURST_WORDS - 1),
            bus.awsize.eq((WORD_BYTES - 1).bit_length()),
            bus.awburst.eq(INCREMENTING),
            bus.awcache.eq(MODIFIABLE),
            # awprot stays 0: unprivileged, secure, data.
            bus.wdata.eq(word.data),
            bus.wstrb.eq(word.kept.replicate(WORD_BYTES)),
            bus.wlast.eq(beat == BURST_WORDS - 1),
            bus.wvalid.eq(sending & self.i.valid),
            self.i.ready.eq(sending & bus.wready),
            self.o_sent.eq(~bus.awvalid & ~sending),
            self.o_ready.eq(self.o_sent & (outstanding != MAX_OUTSTANDING)),
            # What has not been sent cannot have been answered, whatever a broken memory says.
            self.o_all_answered.eq(self.o_sent & (outstanding == 0)),
            # A response is only counted, so that it never has to wait.
            bus.bready.eq(1),
            self.o_error.eq(bus.bvalid & (bus.bresp != Response.OKAY)),
        ]
        starts = self.i_start & self.o_ready
        # Starts and responses may meet in one clock.
        m.d.sync += outstanding.eq(outstanding + starts - bus.bvalid)
        with m.If(starts):
            m.d.sync += [burst.eq(self.i_burst), bus.awvalid.eq(1), sending.eq(1)]
        with m.If(bus.awvalid & bus.awready):
            m.d.sync += bus.awvalid.eq(0)
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [beat.eq(beat + 1), sending.eq(~bus.wlast)]
        return m
