"""Sums of three products equal those of integers, at all extremes; one may be subtracted, or left out."""

from typing import Any

import numpy as np

from golden_model.geometry.fixed_point import ENTRY
from golden_model.painting.pose import POSE
from hdl.painting.serial_sum import TERMS, SerialSum
from tests.hdl.block_bench import BlockBench


def test_sums_are_those_of_integers() -> None:
    rng = np.random.default_rng(8)
    first = rng.integers(ENTRY.min_raw, ENTRY.max_raw, (12, TERMS), endpoint=True)
    second = rng.integers(POSE.min_raw, POSE.max_raw, (12, TERMS), endpoint=True)
    first[:3], second[:2], second[2] = ENTRY.min_raw, POSE.min_raw, POSE.max_raw
    first[3], second[3] = ENTRY.max_raw, POSE.min_raw
    subtracted, skipped = rng.integers(-1, TERMS, (2, 12))
    dut = SerialSum()
    found: list[int] = []

    async def run(ctx: Any) -> None:
        for n in range(len(first)):
            for bit in range(-1, ENTRY.bits):
                for term in range(TERMS):
                    low = int(rng.integers(1 << POSE.bits - ENTRY.bits))
                    word = int(second[n, term]) if bit >= 0 else (int(first[n, term]) << POSE.bits - ENTRY.bits) | low
                    ctx.set(dut.i_word, word)
                    ctx.set(dut.i_valid, 1)
                    ctx.set(dut.i_term, term)
                    ctx.set(dut.i_second, bit >= 0)
                    ctx.set(dut.i_first_bit, bit == 0)
                    ctx.set(dut.i_subtract, int(term == subtracted[n]))
                    ctx.set(dut.i_skip, int(term == skipped[n]))
                    await ctx.tick()
            ctx.set(dut.i_valid, 0)
            await ctx.tick().repeat(dut.latency_cycles - 1)
            found.append(ctx.get(dut.o))
            # It stays, and is doubled on demand.
            await bench.pulse(ctx, dut.i_double)
            await ctx.tick().repeat(2)
            found.append(ctx.get(dut.o) >> 1)

    bench = BlockBench(dut, cycle_limit=2000)
    bench.run(run)
    terms = np.arange(TERMS)
    signs = np.where(terms == subtracted[:, None], -1, 1) * (terms != skipped[:, None])
    # Three products of the smallest factors still fit; doubled, they would not.
    wanted = [
        sum(int(a) * int(b) * int(sign) for a, b, sign in zip(*each, strict=True))
        for each in zip(first, second, signs, strict=True)
    ]
    assert found[::2] == wanted
    doubled = [each for n, each in enumerate(found[1::2]) if abs(wanted[n]) < 1 << 62]
    assert doubled == [each for each in wanted if abs(each) < 1 << 62]
    assert len(doubled) > 6
