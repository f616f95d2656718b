"""A multiplier with the registers that a DSP slice has."""

from amaranth import Const, Module, Shape, Signal, Value
from amaranth.lib.wiring import In, Out

from hdl.lib.component import Component
from hdl.lib.delay import delayed, port_register
from hdl.lib.ecp5 import FACTOR_BITS, Ecp5


class Multiplier(Component):
    """``o_product`` = ``i_a`` × ``i_b``, with operand, multiplier and product register; one product per clock.

    Yosys and Vivado move all three registers into a DSP48 of xc7. Tools that leave them outside let the wires to and
    from the multiplier limit the clock; `Ecp5` instantiates its multiplier for these. No register has a reset.

    Parameters
    ----------
    a, b : Shape
        Shapes of the factors.
    product : Shape
        Shape of the product; it must hold every product.
    """

    i_valid: In(1)
    """There are factors. Stages without valid data keep their value."""
    i_a: Signal
    i_b: Signal
    o_product: Signal

    latency_cycles = 3

    def __init__(self, *, a: Shape, b: Shape, product: Shape) -> None:
        super().__init__(i_a=In(a), i_b=In(b), o_product=Out(product))

    def elaborate(self, platform: object) -> Module:
        """Add the multiplier and its registers, inferred or in the platform's multiplier."""
        m = Module()
        operands_valid = delayed(m, self.i_valid, 1, reset_less=False)
        multiplied = delayed(m, operands_valid, 1, reset_less=False)
        if isinstance(platform, Ecp5):
            loads = (self.i_valid, operands_valid, multiplied)
            platform.multiplier(m, a=self.i_a, b=self.i_b, loads=loads, product=self.o_product)
            return m
        a = Signal.like(self.i_a, reset_less=True)
        b = Signal.like(self.i_b, reset_less=True)
        multiplier = Signal.like(self.o_product, reset_less=True)
        product = port_register(m, self.o_product)
        with m.If(self.i_valid):
            m.d.sync += [a.eq(self.i_a), b.eq(self.i_b)]
        with m.If(operands_valid):
            m.d.sync += multiplier.eq(a * b)
        with m.If(multiplied):
            m.d.sync += product.eq(multiplier)
        return m


def multiply(m: Module, name: str, a: Value, b: Value, *, valid: Value | int = 1) -> Signal:
    """Add a `Multiplier` as the submodule ``name``; return ``a`` × ``b``, ``Multiplier.latency_cycles`` later."""
    m.submodules[name] = multiplier = Multiplier(a=a.shape(), b=b.shape(), product=(a * b).shape())
    m.d.comb += [multiplier.i_valid.eq(valid), multiplier.i_a.eq(a), multiplier.i_b.eq(b)]
    return multiplier.o_product


def multiply_wide(m: Module, platform: object, wide: Value, narrow: Value) -> Value:
    """Return ``wide`` × ``narrow``, two clocks later; a product per clock, no resets. The factors come from registers.

    A factor of 25 bits fits a DSP48 of xc7. For an ECP5 with its narrower multipliers it is cut in two: the
    multipliers' own registers follow their products, and one the sum, since an adder right behind a multiplier limits
    the clock there.
    """
    if isinstance(platform, Ecp5) and len(wide) > FACTOR_BITS:
        low_bits = FACTOR_BITS - 1
        low, high = (
            _multiply_at_once(m, platform, each, narrow) for each in (wide[:low_bits], wide[low_bits:].as_signed())
        )
        # The sum has a bit more than the product needs.
        product = delayed(m, (low + (high << low_bits))[: len(wide) + len(narrow)].as_signed(), 1)
    else:
        product = delayed(m, wide * narrow, 2)
    return product


def _multiply_at_once(m: Module, technology: Ecp5, a: Value, b: Value) -> Signal:
    """Add a multiplier with a product register alone."""
    product = Signal((a * b).shape())
    part = Module()
    technology.multiplier(part, a=a, b=b, loads=(None, None, Const(1)), product=product)
    m.submodules += part
    return product
