"""The bench of the block tests fails if a block breaks the stream rules, hangs or sends a wrong payload."""

from typing import Any

import pytest
from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import Out

from hdl.lib.skid_buffer import SkidBuffer
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench, CycleLimitError


class CountingStream(wiring.Component):
    """Breaks the stream rules: offers the next number in each clock, taken or not."""

    def __init__(self) -> None:
        super().__init__({"o": Out(stream.Signature(8))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.sync += self.o.payload.eq(self.o.payload + 1)
        m.d.comb += self.o.valid.eq(1)
        return m


def test_a_payload_that_changes_while_stalled_is_an_error() -> None:
    dut = CountingStream()
    bench = BlockBench(dut, pauses=Pauses(stalls=200, seed=1))

    async def testbench(ctx: Any) -> None:
        for _ in range(20):
            await bench.stream_get(ctx, dut.o)

    with pytest.raises(AssertionError, match="a payload was withdrawn before it was taken"):
        bench.run(testbench)


def test_a_simulation_that_exceeds_its_limit_is_stopped() -> None:
    dut = SkidBuffer(shape=8)
    bench = BlockBench(dut, cycle_limit=30)

    async def wait_for_ever(ctx: Any) -> None:
        await bench.stream_get(ctx, dut.o)

    with pytest.raises(CycleLimitError, match="not done within 30 cycles"):
        bench.run(wait_for_ever)
