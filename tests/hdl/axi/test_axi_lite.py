"""A reset; `tests/formal/test_export.py` proves that accesses are answered, `tests/cocotb/access.py` that they act."""

from typing import Any

from hdl.axi.axi_lite import AxiLiteSubordinate
from tests.hdl.block_bench import BlockBench


def test_nothing_is_accepted_during_reset() -> None:
    """It would never get an answer."""
    dut = AxiLiteSubordinate()
    bench, bus = BlockBench(dut), dut.bus
    ready = (bus.awready, bus.wready, bus.arready)

    async def run(ctx: Any) -> None:
        await ctx.tick().repeat(3)
        assert [ctx.get(each) for each in ready] == [1, 1, 1]
        ctx.set(bench.reset, 1)
        await ctx.tick()
        for _ in range(3):
            assert [ctx.get(each) for each in ready] == [0, 0, 0]
            await ctx.tick()
        ctx.set(bench.reset, 0)
        await ctx.tick()
        assert [ctx.get(each) for each in ready] == [1, 1, 1]

    bench.run(run)
