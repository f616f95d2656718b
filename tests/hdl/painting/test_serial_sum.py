"""Sums of three products equal those of integers, at all extremes; one may be subtracted, or left out."""

from typing import Any

import numpy as np

from golden_model.geometry.fixed_point import ENTRY
from golden_model.painting.pose import POSE
from hdl.painting.serial_sum import TERMS, SerialSum
from tests.hdl.block_bench import BlockBench


def test_sums_are_those_of_integers() -> None:
    """They stay, and are doubled on demand. Three products of the smallest factors still fit; doubled, they do not."""
    rng = np.random.default_rng(8)
    first = rng.integers(ENTRY.min_raw, ENTRY.max_raw, (12, TERMS), endpoint=True)
    second = rng.integers(POSE.min_raw, POSE.max_raw, (12, TERMS), endpoint=True)
    first[:3], second[:2], second[2] = ENTRY.min_raw, POSE.min_raw, POSE.max_raw
    first[3], second[3] = ENTRY.max_raw, POSE.min_raw
    signs = rng.choice([-1, 0, 1, 1], (12, TERMS))
    dut, found = SerialSum(), list[list[int]]()
    bench = BlockBench(dut, cycle_limit=2000)

    async def run(ctx: Any) -> None:
        for n in range(len(first)):
            for bit in range(-1, ENTRY.bits):
                for term in range(TERMS):
                    low = int(rng.integers(1 << POSE.bits - ENTRY.bits))
                    word = int(second[n, term]) if bit >= 0 else (int(first[n, term]) << POSE.bits - ENTRY.bits) | low
                    flags = {"valid": 1, "second": bit >= 0, "first_bit": bit == 0}
                    flags |= {"subtract": signs[n, term] < 0, "skip": signs[n, term] == 0}
                    for name, value in {"word": word, "term": term, **flags}.items():
                        ctx.set(getattr(dut, f"i_{name}"), int(value))
                    await ctx.tick()
            ctx.set(dut.i_valid, 0)
            await ctx.tick().repeat(dut.latency_cycles - 1)
            found.append([ctx.get(dut.o)])
            await bench.pulse(ctx, dut.i_double)
            await ctx.tick().repeat(2)
            found[-1].append(ctx.get(dut.o))

    bench.run(run)
    sums = [sum(map(int, each)) for each in first.astype(object) * second * signs]
    assert [total for total, _ in found] == sums
    small = [n for n, total in enumerate(sums) if abs(total) < 1 << 62]
    assert [found[n][1] for n in small] == [2 * sums[n] for n in small]
    assert len(small) > 6
