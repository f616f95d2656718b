"""Fixed delays, and pipelines that rest without beats."""

from __future__ import annotations

from typing import TypeVar

from amaranth import Module, Signal, Value
from amaranth.lib import data

Delayed = TypeVar("Delayed", Value, data.View)


def delayed(m: Module, value: Delayed, cycles: int, *, reset_less: bool = True) -> Delayed:
    """``value`` a fixed number of clocks later.

    Without reset the registers pack into SRLs; a valid bit needs ``reset_less=False``, lest it survive a reset.
    Call it outside of any ``m.If``, which would hold the registers.
    """
    for _ in range(cycles):
        register = Signal.like(value, reset_less=reset_less)
        m.d.sync += register.eq(value)
        value = register
    return value


class Pipe:
    """Registers that hold where there is no beat.

    Parameters
    ----------
    m : Module
    valid : Value
        Whether there is a beat at the pipe's start.
    """

    def __init__(self, m: Module, valid: Value) -> None:
        self._m = m
        self._valid = [valid]

    def registered(self, value: Value, cycles: int) -> Signal:
        """``value``, which is ``cycles`` behind the pipe's start, a clock later."""
        while len(self._valid) <= cycles:
            self._valid.append(delayed(self._m, self._valid[-1], 1, reset_less=False))
        register = Signal.like(value, reset_less=True)
        with self._m.If(self._valid[cycles]):
            self._m.d.sync += register.eq(value)
        return register
