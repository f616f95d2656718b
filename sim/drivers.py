"""Sources and sinks for block tests in Amaranth's simulator, with seeded gaps and stalls."""

from __future__ import annotations

import random
from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import Any

from amaranth.hdl import Value
from amaranth.lib import stream, wiring
from amaranth.sim import Simulator

from sim.recording import NO_PAUSES, Pauses

CLOCK_S = 1e-8

Testbench = Callable[[Any], Coroutine[Any, Any, None]]


def run_streams(
    dut: wiring.Component,
    inputs: Mapping[str, Sequence[Any]],
    counts: Mapping[str, int],
    *,
    settings: Mapping[str, Any] | None = None,
    pauses: Pauses = NO_PAUSES,
    cycle_limit: int = 10_000,
) -> dict[str, list[Any]]:
    """Stream payloads through a component and return what leaves it.

    Parameters
    ----------
    dut : Component
        In the domain ``sync``.
    inputs : mapping of str to sequence
        For each input port, the payloads to send.
    counts : mapping of str to int
        For each output port, how many payloads to wait for.
    settings : mapping of str to values, optional
        Other input ports, set once.
    pauses : Pauses
        Gaps of the inputs, stalls of the outputs.
    cycle_limit : int

    Returns
    -------
    dict of str to list
        The payloads of each output port, in order.

    Raises
    ------
    AssertionError
        If an output breaks the stream rules (a payload changes or vanishes before it is taken), or the counts are
        not reached within the limit.
    """
    received: dict[str, list[Any]] = {name: [] for name in counts}
    simulator = Simulator(dut)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(_setting(dut, settings or {}))
    for number, (name, payloads) in enumerate(inputs.items()):
        simulator.add_testbench(_source(getattr(dut, name), payloads, pauses, number))
    for number, (name, count) in enumerate(counts.items(), start=len(inputs)):
        simulator.add_testbench(_sink(getattr(dut, name), count, received[name], pauses, number))
    simulator.add_testbench(_limit(cycle_limit, received), background=True)
    simulator.run()
    return received


def _setting(dut: wiring.Component, settings: Mapping[str, Any]) -> Testbench:
    async def testbench(ctx: Any) -> None:
        for name, value in settings.items():
            ctx.set(getattr(dut, name), value)

    return testbench


def _source(port: stream.Interface, payloads: Sequence[Any], pauses: Pauses, number: int) -> Testbench:
    async def testbench(ctx: Any) -> None:
        garbage = Garbage(pauses.seed)
        cycle = 0
        for payload in payloads:
            while pauses.gap(cycle, number):
                garbage.put(ctx, port.payload)
                await ctx.tick()
                cycle += 1
            ctx.set(port.payload, payload)
            ctx.set(port.valid, 1)
            taken = False
            while not taken:
                *_, taken = await ctx.tick().sample(port.ready)
                cycle += 1
            ctx.set(port.valid, 0)
        garbage.put(ctx, port.payload)

    return testbench


def _sink(port: stream.Interface, count: int, received: list[Any], pauses: Pauses, number: int) -> Testbench:
    async def testbench(ctx: Any) -> None:
        cycle, waiting = 0, None
        while len(received) < count:
            ready = not pauses.stall(cycle, number)
            ctx.set(port.ready, ready)
            *_, valid, payload, raw = await ctx.tick().sample(port.valid, port.payload, Value.cast(port.payload))
            cycle += 1
            if waiting is not None and not (valid and raw == waiting):
                raise AssertionError(f"a payload was withdrawn before it was taken, cycle {cycle}")
            waiting = raw if valid and not ready else None
            if valid and ready:
                received.append(payload)
        ctx.set(port.ready, 0)

    return testbench


def _limit(cycle_limit: int, received: Mapping[str, Sequence[Any]]) -> Testbench:
    async def testbench(ctx: Any) -> None:
        for _ in range(cycle_limit):
            await ctx.tick()
        counts = {name: len(payloads) for name, payloads in received.items()}
        raise AssertionError(f"not done within {cycle_limit} cycles; received: {counts}")

    return testbench


class Garbage:
    """Seeded random bits for whatever a port says while it is not valid."""

    def __init__(self, seed: int):
        self._random = random.Random(seed)

    def put(self, ctx: Any, payload: Any) -> None:
        """Set ``payload`` to random bits."""
        bits = Value.cast(payload)
        ctx.set(bits, self._random.getrandbits(len(bits)))
