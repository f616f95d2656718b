"""The bench of block tests: Amaranth's simulator with a clock, a cycle limit, reset, gaps and stalls."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from amaranth import ResetInserter, Signal
from amaranth.hdl import ShapeCastable, Value
from amaranth.lib import wiring
from amaranth.sim import Simulator

from sim.benches.rows import CLOCK_S
from sim.simulators.recording import NO_PAUSES, Pauses

Testbench = Callable[[Any], Coroutine[Any, Any, None]]


class CycleLimitError(AssertionError):
    """A simulation took more clocks than its limit."""


@dataclass
class _StreamState:
    """A stream's number for the pauses, its clocks so far, and the payload that waits to be taken."""

    number: int
    cycle: int = 0
    waiting: int | None = None


class BlockBench:
    """Runs testbenches around one block; they send and receive its streams with the methods here.

    Parameters
    ----------
    dut : Component
        In the domain ``sync``.
    settings : mapping of str to values, optional
        Input ports that are set once, before the testbenches start.
    pauses : Pauses
        Gaps of `stream_put`, stalls of `stream_get`.
    cycle_limit : int
        A simulation that takes longer fails.

    Attributes
    ----------
    reset : Signal
        Resets the whole block while it is 1.
    """

    def __init__(
        self,
        dut: wiring.Component[Any],
        *,
        settings: Mapping[str, Any] | None = None,
        pauses: Pauses = NO_PAUSES,
        cycle_limit: int = 10_000,
    ) -> None:
        self.dut = dut
        self.reset = Signal()
        self._settings = settings or {}
        self._pauses = pauses
        self._cycle_limit = cycle_limit
        self._garbage = Random(pauses.seed)
        self._streams: dict[int, _StreamState] = {}

    def run(self, *testbenches: Testbench, background: Sequence[Testbench] = ()) -> None:
        """Run until each of the testbenches has returned; those in the background stop with them.

        Raises
        ------
        CycleLimitError
            If that takes more clocks than the limit.
        """
        simulator = Simulator(ResetInserter(self.reset)(self.dut))
        simulator.add_clock(CLOCK_S)
        # In each clock the simulator continues testbenches in the order in which they were added: those in the
        # background have seen a clock before a testbench decides on it.
        simulator.add_testbench(self._apply_settings)
        for testbench in (self._limit_cycles, *background):
            simulator.add_testbench(testbench, background=True)
        for testbench in testbenches:
            simulator.add_testbench(testbench)
        simulator.run()

    async def _apply_settings(self, ctx: Any) -> None:
        for name, value in self._settings.items():
            ctx.set(getattr(self.dut, name), value)

    async def _limit_cycles(self, ctx: Any) -> None:
        cycles = 0
        async for _ in ctx.tick():
            cycles += 1
            if cycles == self._cycle_limit:
                break
        raise CycleLimitError(f"not done within {self._cycle_limit} cycles")

    async def stream_put(self, ctx: Any, port: Any, payload: Any) -> None:
        """Offer ``payload`` until it is taken, perhaps after a gap, in which the payload's bits are random.

        Parameters
        ----------
        port : stream interface
            An input of the block.
        payload : value
            As the port's payload takes it.
        """
        state = self._find_state(port)
        while self._pauses.gap(state.cycle, state.number):
            bits = Value.cast(port.payload)
            ctx.set(bits, self._garbage.getrandbits(len(bits)))
            await ctx.tick()
            state.cycle += 1
        ctx.set(port.payload, payload)
        ctx.set(port.valid, 1)
        async for *_, taken in ctx.tick().sample(port.ready):
            state.cycle += 1
            if taken:
                break
        ctx.set(port.valid, 0)

    async def stream_get(self, ctx: Any, port: Any) -> Any:
        """Take one payload of an output, with stalls; afterwards the port is not ready.

        Raises
        ------
        AssertionError
            If the block withdraws or changes a payload before it is taken.
        """
        state = self._find_state(port)
        ready = not self._pauses.stall(state.cycle, state.number)
        ctx.set(port.ready, ready)
        async for *_, valid, bits in ctx.tick().sample(port.valid, Value.cast(port.payload)):
            state.cycle += 1
            if state.waiting is not None and not (valid and bits == state.waiting):
                raise AssertionError(f"a payload was withdrawn before it was taken, cycle {state.cycle}")
            state.waiting = bits if valid and not ready else None
            if valid and ready:
                ctx.set(port.ready, 0)
                shape = port.payload.shape()
                return shape.from_bits(bits) if isinstance(shape, ShapeCastable) else bits
            # Each set lets the whole block settle.
            if ready == self._pauses.stall(state.cycle, state.number):
                ready = not ready
                ctx.set(port.ready, ready)
        raise AssertionError("the clock has stopped")

    def _find_state(self, port: Any) -> _StreamState:
        # Streams are numbered in the order of their first use, which the simulator repeats in every run.
        return self._streams.setdefault(id(port), _StreamState(len(self._streams)))

    @staticmethod
    async def pulse(ctx: Any, port: Any) -> None:
        """Set ``port`` to 1 for one clock."""
        ctx.set(port, 1)
        await ctx.tick()
        ctx.set(port, 0)

    async def wait_until_low(self, ctx: Any, port: Any, *, at_most: int | None = None) -> int:
        """Wait until ``port`` is 0, and return how many clocks that took.

        Raises
        ------
        AssertionError
            If it took more than ``at_most``.
        """
        cycles = 0
        while ctx.get(port):
            await ctx.tick()
            cycles += 1
            assert at_most is None or cycles <= at_most, f"not 0 after {cycles} cycles"
        return cycles
