"""A register stage for a stream that breaks every combinational path."""

from amaranth import Module, Mux, ShapeLike, Signal
from amaranth.lib import stream
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component


class SkidBuffer(Component):
    """Passes a stream on; neither side's signals depend on the other side in the same clock.

    Two places are written and read in turn. ``ready`` and ``valid`` are registers, and a register selects the payload:
    a late ``ready`` of the output moves only a pointer and enables no wide register. The throughput is one payload per
    clock. After reset the buffer is empty.

    Parameters
    ----------
    shape : ShapeLike
        Shape of the payload.
    """

    i: stream.Interface
    o: stream.Interface

    latency_cycles = 1

    def __init__(self, *, shape: ShapeLike) -> None:
        self.shape = shape
        super().__init__(i=In(stream.Signature(shape)), o=Out(stream.Signature(shape)))

    def elaborate(self, platform: object) -> Module:
        """Two places, the pointers to them, and the registers for ``ready`` and ``valid``."""
        m = Module()
        places = [Signal(self.shape, name=f"place{n}", reset_less=True) for n in range(2)]
        write = Signal()
        read = Signal()
        # `ready` is 0 after reset: a payload taken in the clock of the reset would be lost.
        ready = Signal()
        m.d.comb += [self.i.ready.eq(ready), self.o.payload.eq(Mux(read, places[1], places[0]))]
        for n, place in enumerate(places):
            # A free place takes whatever comes; its content counts only once the pointer has moved on.
            with m.If(ready & (write == n)):
                m.d.sync += place.eq(self.i.payload)
        arrives, leaves = self.i.valid & ready, self.o.valid & self.o.ready
        m.d.sync += [write.eq(write ^ arrives), read.eq(read ^ leaves)]
        # With one payload inside, the pointers differ; with none or two they are equal.
        differ = write ^ read
        m.d.sync += [
            self.o.valid.eq(arrives | (self.o.valid & (~leaves | ~differ))),
            ready.eq(leaves | ~self.o.valid | (differ & ~arrives)),
        ]
        return m
