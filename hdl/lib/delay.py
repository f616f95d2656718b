"""Registers without reset: fixed delays, outputs, and pipelines that keep their value in clocks without a beat."""

from typing import TypeVar

from amaranth import Cat, Module, Signal, Value, ValueCastable, ValueLike, tracer
from amaranth.lib import data

Delayed = TypeVar("Delayed", Value, data.View)
WORD_BITS = 64
"""Bits that a compiled simulation copies or shifts at once."""
MIN_SHARED_STAGES = 8
"""With fewer, a compiled simulation is slower: a register that reads itself is often copied before it is shifted."""


def delayed(m: Module, value: Delayed, cycles: int, *, reset_less: bool = True) -> Delayed:
    """Delay ``value`` by a fixed number of clocks.

    Without reset the registers pack into shift-register LUTs (30 % fewer flip-flops, measured). A valid bit needs
    ``reset_less=False``, otherwise a stale valid survives reset. Call this outside of any ``m.If``: inside, the
    registers would only advance while the condition holds.

    The last register is named after the variable that the result is assigned to, or else after the delayed signal:
    ``x_after2`` is ``x`` two clocks later. Earlier stages of a long, narrow delay share registers, the newest in the
    lowest bits: compiled simulations then shift a machine word instead of copying every stage.

    Raises
    ------
    ValueError
        For a negative number of clocks: the path that this one waits for is shorter.
    """
    if cycles < 0:
        raise ValueError(f"cycles is {cycles}; the path to wait for is shorter than the one that waits")
    if cycles == 0:
        return value
    name = tracer.get_var_name(depth=2, default="") or later(value, cycles)
    # One frame further up, or the source attribute of every register would point here.
    result: Delayed = Signal.like(value, name=name, reset_less=reset_less, src_loc_at=1)
    last = Value.cast(result)
    assert isinstance(last, Signal)
    bits = len(last)
    shared = WORD_BITS // max(bits, 1)
    stages = shared if min(shared, cycles - 1) >= MIN_SHARED_STAGES else 1
    oldest = Value.cast(value)
    for first in range(1, cycles, stages):
        count = min(stages, cycles - first)
        register = Signal(
            count * bits,
            name=f"{name}_stage{first}" + (f"to{first + count - 1}" if count > 1 else ""),
            # Each stage starts with the delayed signal's own value.
            init=sum((last.init % (1 << bits)) << n * bits for n in range(count)),
            reset_less=reset_less,
            src_loc_at=1,
        )
        m.d.sync += register.eq(Cat(oldest, register))
        oldest = register[-bits:]
    m.d.sync += last.eq(oldest)
    return result


def check_aligned(what: str, **paths: int) -> None:
    """Compare the lags, or the latencies, of paths that meet.

    Raises
    ------
    ValueError
        If they differ; with the number of each path.
    """
    if len(set(paths.values())) > 1:
        numbers = ", ".join(f"{name} has {number}" for name, number in paths.items())
        raise ValueError(f"{what} must be equal where paths meet: {numbers}")


def wait_cycles(path: str, cycles: int, *, until: int) -> int:
    """Clocks for which a path of ``cycles`` waits to meet a path of ``until`` clocks.

    Raises
    ------
    ValueError
        If it is the longer one.
    """
    if cycles > until:
        raise ValueError(f"{path} take {cycles} clocks, but the path that they meet only {until}")
    return until - cycles


def port_register(m: Module, port: Delayed) -> Delayed:
    """Drive the output ``port`` of a component by a register without reset, named after the variable it is assigned to.

    A port that is itself a register has a reset, which data qualified by a valid bit does not need.
    """
    name = tracer.get_var_name(depth=2, default="") or later(port)
    register: Delayed = Signal.like(port, name=name, reset_less=True, src_loc_at=1)
    m.d.comb += port.eq(register)
    return register


def later(value: ValueLike, cycles: int = 1) -> str:
    """Name for ``value`` a number of clocks later."""
    name, after, earlier = (_first_name(Value.cast(value)) or "constant").rpartition("_after")
    if after and earlier.isdigit():
        return f"{name}_after{int(earlier) + cycles}"
    return f"{name}{after}{earlier}_after{cycles}"


def _first_name(value: Value) -> str:
    if isinstance(value, Signal):
        return str(value.name)
    # Amaranth's kinds of expressions have different names for their operands.
    parts = [getattr(value, "value", None), getattr(value, "test", None)]
    parts += [part for name in ("operands", "parts", "elems") for part in getattr(value, name, ())]
    names = (_first_name(Value.cast(part)) for part in parts if isinstance(part, (Value, ValueCastable)))
    return next((name for name in names if name), "")


class Pipe:
    """A pipeline whose registers keep their value in clocks without a beat, which saves power and simulation time.

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
        """Delay ``value``, which is ``cycles`` clocks behind the pipe's start, by another clock."""
        while len(self._valid) <= cycles:
            self._valid.append(delayed(self._m, self._valid[-1], 1, reset_less=False))
        name = tracer.get_var_name(depth=2, default="") or later(value)
        register = Signal.like(value, name=name, reset_less=True, src_loc_at=1)
        with self._m.If(self._valid[cycles]):
            self._m.d.sync += register.eq(value)
        return register
