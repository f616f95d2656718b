"""A register stage of a stream that breaks every combinational path."""

from __future__ import annotations

from amaranth import Module, ShapeLike, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.delay import port_register


class SkidBuffer(wiring.Component):
    """Pass a stream on, with ``valid``, payload and ``ready`` all from registers.

    ``ready`` reaches the input one clock late, so one more payload may arrive while the output is stalled; a second
    register stores it. The throughput is one payload a clock. After reset the buffer is empty.

    Parameters
    ----------
    shape : ShapeLike
        Of the payload.

    Members
    -------
    i, o : stream

    Attributes
    ----------
    latency_cycles : int
    """

    i: stream.Interface
    o: stream.Interface

    latency_cycles = 1

    def __init__(self, *, shape: ShapeLike) -> None:
        self.shape = shape
        super().__init__({"i": In(stream.Signature(shape)), "o": Out(stream.Signature(shape))})

    def elaborate(self, platform: object) -> Module:
        """The output register, and the register for the payload that arrives during a stall."""
        m = Module()
        aside = Signal(self.shape, reset_less=True)
        payload = port_register(m, self.o.payload)
        waiting = Signal()
        # `ready` is 0 after reset: a payload taken in the clock of the reset would be lost.
        ready = Signal()
        m.d.comb += self.i.ready.eq(ready)
        with m.If(ready):
            m.d.sync += aside.eq(self.i.payload)
        with m.If(self.o.ready | ~self.o.valid):
            m.d.sync += [self.o.valid.eq(waiting | (self.i.valid & ready)), waiting.eq(0), ready.eq(1)]
            with m.If(waiting):
                m.d.sync += payload.eq(aside)
            with m.Else():
                m.d.sync += payload.eq(self.i.payload)
        with m.Elif(self.i.valid & ready):
            m.d.sync += [waiting.eq(1), ready.eq(0)]
        return m
