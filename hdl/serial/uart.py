"""A serial port: eight data bits, no parity, one stop bit, lowest bit first."""

from amaranth import Cat, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.config import check_range

DATA_BITS = 8
MIN_CLOCKS_PER_BIT = 4


class UartReceiver(wiring.Component):
    """Turns the level of a pin into bytes.

    Each bit is sampled in its middle. Over the ten bits of a byte the sampling may drift by a quarter of a bit, so the
    clocks of the two ends may differ by 2 %. A byte is output in the middle of its stop bit; the next one follows ten
    bits later at the earliest.

    Parameters
    ----------
    clocks_per_bit : int
        At least 4.
    """

    i_pin: In(1)
    """High when idle; asynchronous."""
    o_valid: Out(1)
    """High for one clock with each byte."""
    o_byte: Out(DATA_BITS)
    o_broken: Out(1)
    """High for one clock where a byte has no stop bit; it is dropped."""

    def __init__(self, *, clocks_per_bit: int) -> None:
        check_range("clocks_per_bit", clocks_per_bit, MIN_CLOCKS_PER_BIT)
        self.clocks_per_bit = clocks_per_bit
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Wait for a start bit, then sample in the middle of each bit."""
        m = Module()
        # Two registers against metastability, and a third to detect the edge.
        pin = Signal(3, init=0b111)
        m.d.sync += pin.eq(Cat(self.i_pin, pin))
        level, before = pin[1], pin[2]
        clock = Signal(range(self.clocks_per_bit))
        bit = Signal(range(DATA_BITS + 2))
        receiving = Signal()
        m.d.sync += [self.o_valid.eq(0), self.o_broken.eq(0)]
        with m.If(~receiving):
            # Half a bit after the edge is the middle of the start bit.
            m.d.sync += [receiving.eq(before & ~level), clock.eq(self.clocks_per_bit // 2 - 1), bit.eq(0)]
        with m.Elif(clock != 0):
            m.d.sync += clock.eq(clock - 1)
        with m.Else():
            m.d.sync += [clock.eq(self.clocks_per_bit - 1), bit.eq(bit + 1)]
            with m.If(bit == 0):
                # A start bit that is over by its middle was a glitch.
                m.d.sync += receiving.eq(~level)
            with m.Elif(bit <= DATA_BITS):
                m.d.sync += self.o_byte.eq(Cat(self.o_byte[1:], level))
            with m.Else():
                m.d.sync += [receiving.eq(0), self.o_valid.eq(level), self.o_broken.eq(~level)]
        return m


class UartTransmitter(wiring.Component):
    """Sends bytes, as ten bits each.

    Parameters
    ----------
    clocks_per_bit : int
        At least 4.
    """

    i: In(stream.Signature(DATA_BITS))
    o_pin: Out(1)
    """High when idle."""

    def __init__(self, *, clocks_per_bit: int) -> None:
        check_range("clocks_per_bit", clocks_per_bit, MIN_CLOCKS_PER_BIT)
        self.clocks_per_bit = clocks_per_bit
        super().__init__()

    def elaborate(self, platform: object) -> Module:
        """Shift the bits out; ones follow the stop bit."""
        m = Module()
        bits = Signal(DATA_BITS + 2, init=-1)
        clock = Signal(range(self.clocks_per_bit))
        left = Signal(range(DATA_BITS + 3))
        m.d.comb += [self.i.ready.eq(left == 0), self.o_pin.eq(bits[0])]
        with m.If(self.i.ready & self.i.valid):
            m.d.sync += [bits.eq(Cat(0, self.i.payload, 1)), left.eq(DATA_BITS + 2), clock.eq(0)]
        with m.Elif(left != 0):
            ends = clock == self.clocks_per_bit - 1
            m.d.sync += clock.eq(Mux(ends, 0, clock + 1))
            with m.If(ends):
                m.d.sync += [bits.eq(Cat(bits[1:], 1)), left.eq(left - 1)]
        return m
