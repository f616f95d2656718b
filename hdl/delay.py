"""Fixed delays."""

from __future__ import annotations

from amaranth import Module, Signal, Value


def delayed(m: Module, value: Value, cycles: int, *, reset_less: bool = True) -> Value:
    """``value`` a fixed number of clocks later.

    Without reset the registers pack into SRLs; a valid bit needs ``reset_less=False``, lest it survive a reset.
    Call it outside of any ``m.If``, which would hold the registers.
    """
    for _ in range(cycles):
        register = Signal.like(value, reset_less=reset_less)
        m.d.sync += register.eq(value)
        value = register
    return value
