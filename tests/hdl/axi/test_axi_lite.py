"""Accesses become pulses, whatever the order of their channels, and each gets its answer."""

import random
from typing import Any

from hdl.axi.axi_lite import AxiLiteSubordinate, Response
from tests.hdl.axi.manager import read, write
from tests.hdl.block_bench import BlockBench

WORDS = (0, 1, 2, 3, 512, 1023)


def test_reads_and_writes_become_pulses_and_get_their_answers() -> None:
    dut, rng = AxiLiteSubordinate(), random.Random(1)
    written: list[tuple[int, int, int]] = []
    expected: list[tuple[int, int, int]] = []
    reads = [0]

    async def side(ctx: Any) -> None:
        """Answers in the clock of an access, as a register file does."""
        while True:
            word = ctx.get(dut.o_read_word)
            ctx.set(dut.i_data, word * 0x0101_0101 & 0xFFFF_FFFF)
            sampled = (dut.o_write_word, dut.o_data, dut.o_strobe)
            *_, writes, is_read, at, data, strobe = await ctx.tick().sample(dut.o_write, dut.o_read, *sampled)
            reads[0] += is_read
            if writes:
                written.append((at, data, strobe))

    async def run(ctx: Any) -> None:
        for _ in range(60):
            word = rng.choice(WORDS)
            # The two lowest bits are those of a byte in the word.
            address = 4 * word + rng.randrange(4)
            if rng.random() < 0.5:
                data, strobe = rng.getrandbits(32), rng.getrandbits(4)
                expected.append((word, data, strobe))
                assert await write(ctx, dut.bus, address, data, strobe=strobe, rng=rng) == Response.OKAY
            else:
                assert await read(ctx, dut.bus, address) == (word * 0x0101_0101 & 0xFFFF_FFFF, Response.OKAY)

    BlockBench(dut, cycle_limit=1200).run(run, background=[side])
    assert written == expected
    assert reads[0] == 60 - len(expected)


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
