"""Inputs clock by clock, on `tests.hdl.block_bench`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from amaranth.hdl import ValueLike
from amaranth.lib import wiring

from tests.hdl.block_bench import BlockBench


def run_clocks(
    dut: wiring.Component[Any], inputs: Iterable[Sequence[tuple[ValueLike, Any]]], outputs: Sequence[ValueLike]
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
