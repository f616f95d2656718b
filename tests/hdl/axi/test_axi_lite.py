"""What waits for nobody, and what stays; accesses of all kinds are in `tests/cocotb/access.py`."""

from typing import Any

from hdl.axi.axi_lite import AxiLiteSubordinate, Response
from tests.hdl.axi.manager import read
from tests.hdl.block_bench import BlockBench


def test_a_read_does_not_wait_for_a_write_whose_answer_nobody_takes() -> None:
    dut = AxiLiteSubordinate()
    writes = [0]

    async def watch(ctx: Any) -> None:
        async for *_, is_write in ctx.tick().sample(dut.o_write):
            writes[0] += is_write

    async def run(ctx: Any) -> None:
        bus = dut.bus
        for port in (bus.awvalid, bus.wvalid):
            ctx.set(port, 1)
        ctx.set(bus.bready, 0)
        await ctx.tick().repeat(6)
        assert ctx.get(bus.bvalid)
        # The next write has been accepted, and waits for the answer to the first.
        assert not ctx.get(bus.awready)
        assert not ctx.get(bus.wready)
        assert (await read(ctx, bus, 4))[1] == Response.OKAY

    BlockBench(dut).run(run, background=[watch])
    assert writes == [1]


def test_a_read_answer_that_nobody_takes_stays() -> None:
    dut = AxiLiteSubordinate()

    async def run(ctx: Any) -> None:
        bus = dut.bus
        ctx.set(bus.arvalid, 1)
        for data in (1, 2):
            ctx.set(dut.i_data, data)
            await ctx.tick().repeat(4)
            # The next read has been accepted, and waits for this answer.
            assert (ctx.get(bus.rvalid), ctx.get(bus.rdata), ctx.get(bus.arready)) == (1, 1, 0)
        ctx.set(bus.rready, 1)
        answers = [(await ctx.tick().sample(bus.rdata).until(bus.rvalid))[-1] for _ in range(2)]
        assert answers == [1, 2]

    BlockBench(dut, cycle_limit=40).run(run)


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
