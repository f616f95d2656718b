"""Streams through a block in one call, or inputs clock by clock, on `tests.hdl.block_bench`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from amaranth.hdl import ValueLike
from amaranth.lib import wiring

from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench, CycleLimitError, Testbench


def run_streams(
    dut: wiring.Component[Any],
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
        For each output port, the number of payloads to wait for.
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
    bench = BlockBench(dut, settings=settings, pauses=pauses, cycle_limit=cycle_limit)
    received: dict[str, list[Any]] = {name: [] for name in counts}
    sources = [_make_source(bench, name, payloads) for name, payloads in inputs.items()]
    sinks = [_make_sink(bench, name, count, received[name]) for name, count in counts.items()]
    try:
        bench.run(*sources, *sinks)
    except CycleLimitError as error:
        taken = {name: len(payloads) for name, payloads in received.items()}
        raise AssertionError(f"{error}; received: {taken}") from None
    return received


def _make_source(bench: BlockBench, name: str, payloads: Sequence[Any]) -> Testbench:
    async def testbench(ctx: Any) -> None:
        for payload in payloads:
            await bench.stream_put(ctx, getattr(bench.dut, name), payload)

    return testbench


def _make_sink(bench: BlockBench, name: str, count: int, received: list[Any]) -> Testbench:
    async def testbench(ctx: Any) -> None:
        while len(received) < count:
            received.append(await bench.stream_get(ctx, getattr(bench.dut, name)))

    return testbench


def run_clocks(
    dut: wiring.Component[Any],
    inputs: Iterable[Sequence[tuple[ValueLike, Any]]],
    outputs: Sequence[ValueLike],
) -> list[tuple[Any, ...]]:
    """Set inputs clock by clock, and return the outputs of each clock.

    Parameters
    ----------
    dut : Component
        In the domain ``sync``.
    inputs : iterable of sequences of (port, value)
        For each clock, the ports to set; the others keep their values.
    outputs : sequence of ports

    Returns
    -------
    list of tuple
        For each clock, the values of ``outputs`` at its end: those of a block with a latency of L clocks come L entries
        after their inputs.
    """
    rows = list(inputs)
    sampled: list[tuple[Any, ...]] = []

    async def testbench(ctx: Any) -> None:
        for row in rows:
            for port, value in row:
                ctx.set(port, value)
            _, _, *values = await ctx.tick().sample(*outputs)
            sampled.append(tuple(values))

    BlockBench(dut, cycle_limit=len(rows) + 1).run(testbench)
    return sampled
