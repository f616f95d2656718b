"""A sum or a difference, chosen by a signal, in one adder."""

from amaranth import Cat, Const, Mux, Value


def add_or_subtract(a: Value, b: Value, subtract: Value) -> Value:
    """Return ``a`` + ``b``, or ``a`` - ``b``, of signed values, with one bit more than the wider one.

    Tools build ``Mux(subtract, a - b, a + b)`` of two adders, and a third term for the carry, too. Here a bit below
    the lowest one makes the carry. It is a difference in any case, since Yosys swaps the operands of a sum, and needs
    logic of its own for the first one if that is the multiplexer.
    """
    operand = Cat(~subtract, Mux(subtract, b, ~b)).as_signed()
    return (Cat(Const(0, 1), a).as_signed() - operand) >> 1
