"""The bench of the block tests fails if a block breaks the stream rules, hangs or sends a wrong payload."""

from typing import Any

import pytest
from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.lib.skid_buffer import SkidBuffer
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench, CycleLimitError
from tests.hdl.drivers import run_clocks


class CountingStream(wiring.Component):
    """Breaks the stream rules: offers the next number in each clock, taken or not."""

    def __init__(self) -> None:
        super().__init__({"o": Out(stream.Signature(8))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.sync += self.o.payload.eq(self.o.payload + 1)
        m.d.comb += self.o.valid.eq(1)
        return m


class Accumulator(wiring.Component):
    """``o`` is the sum of ``i`` over all earlier clocks."""

    def __init__(self) -> None:
        super().__init__({"i": In(8), "o": Out(8)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.sync += self.o.eq(self.o + self.i)
        return m


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=120, stalls=150, seed=6)], ids=["free", "pauses"])
def test_payloads_arrive_in_order(pauses: Pauses) -> None:
    dut = SkidBuffer(shape=8)
    bench = BlockBench(dut, pauses=pauses, cycle_limit=400)

    async def put(ctx: Any) -> None:
        for number in range(50):
            await bench.stream_put(ctx, dut.i, number)

    async def check(ctx: Any) -> None:
        for number in range(50):
            assert await bench.stream_get(ctx, dut.o) == number

    bench.run(put, check)


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


def test_a_signal_that_stays_high_too_long_is_an_error() -> None:
    dut = Accumulator()
    bench = BlockBench(dut, settings={"i": 1})

    async def testbench(ctx: Any) -> None:
        await ctx.tick()
        await bench.wait_until_low(ctx, dut.o, at_most=20)

    with pytest.raises(AssertionError, match="not 0 after 21 cycles"):
        bench.run(testbench)


def test_reset_empties_the_block() -> None:
    dut = SkidBuffer(shape=8)
    bench = BlockBench(dut)

    async def testbench(ctx: Any) -> None:
        await bench.stream_put(ctx, dut.i, 1)
        assert ctx.get(dut.o.valid)
        await bench.pulse(ctx, bench.reset)
        assert not ctx.get(dut.o.valid)
        await bench.stream_put(ctx, dut.i, 2)
        assert await bench.stream_get(ctx, dut.o) == 2

    bench.run(testbench)


def test_outputs_are_those_of_each_clock() -> None:
    dut = Accumulator()
    inputs = [[(dut.i, 1)], [(dut.i, 2)], [], [(dut.i, 0)], []]
    assert run_clocks(dut, inputs, [dut.o]) == [(0,), (1,), (3,), (5,), (5,)]
