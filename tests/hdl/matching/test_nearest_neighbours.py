# amaranth: UnusedElaboratable=no
"""The nearest of each row and column equal those of the golden distances, ties included."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.matching import hamming
from hdl.matching.feature_banks import READ_CYCLES
from hdl.matching.nearest_neighbours import RESULT_CYCLES, NearestNeighbours
from tests.hdl.block_bench import BlockBench
from tests.hdl.matching.descriptors import (
    close_together,
    descriptor_ints,
    nearest,
    opposite,
    random_bits,
    search_cycles,
    some_equal,
)


def searched(dut: NearestNeighbours, pairs: list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]) -> list[Any]:
    """Rows and columns of several searches, and how many clocks each took."""
    bench = BlockBench(dut)
    results: list[Any] = []
    descriptors: list[list[Any]] = [[], []]

    async def banks(ctx: Any) -> None:
        addresses = [(0, 0)] * READ_CYCLES
        ports = dut.o_left_address, dut.o_right_address
        async for *_, left, right in ctx.tick().sample(*ports):
            addresses = [(left, right), *addresses[:-1]]
            for port, side, address in zip((dut.i_left, dut.i_right), descriptors, addresses[-1], strict=True):
                ctx.set(port, side[address] if address < len(side) else -1)

    async def run(ctx: Any) -> None:
        for left, right in pairs:
            descriptors[:] = descriptor_ints(left), descriptor_ints(right)
            ctx.set(dut.i_left_count, len(left))
            ctx.set(dut.i_right_count, len(right))
            await bench.pulse(ctx, dut.i_start)
            cycles = await bench.wait_until_low(ctx, dut.o_busy, at_most=search_cycles(dut, len(left), len(right)))
            rows = await read(ctx, dut.i_row_index, dut.o_row, len(left))
            columns = await read(ctx, dut.i_column_index, dut.o_column, len(right))
            results.append((rows, columns, cycles))

    async def read(ctx: Any, index: Any, port: Any, count: Any) -> Any:
        ctx.set(dut.i_read, 1)
        entries = []
        for n in range(count):
            ctx.set(index, n)
            await ctx.tick().repeat(RESULT_CYCLES)
            entries.append((ctx.get(port.best), ctx.get(port.second), ctx.get(port.index)))
        ctx.set(dut.i_read, 0)
        return entries

    bench.run(run, background=[banks])
    return results


@pytest.mark.parametrize(
    ("bits", "lanes", "max_features", "descriptors"),
    [*((8, 2, 11, each) for each in (some_equal, opposite)), (32, 4, 16, close_together), (128, 8, 16, random_bits)],
)
def test_nearest_neighbours_equal_the_golden_distances(
    bits: int, lanes: int, max_features: int, descriptors: Callable[..., Any]
) -> None:
    dut = NearestNeighbours(bits=bits, lanes=lanes, max_features=max_features)
    rng = np.random.default_rng(bits)
    sizes = [(max_features, max_features), (1, 1), (max_features - 1, 3), (2, max_features)]
    both = [descriptors(rng, sum(size), bits) for size in sizes]
    pairs = [(each[:left], each[left:]) for each, (left, _) in zip(both, sizes, strict=True)]
    empty = (1 << bits.bit_length()) - 1
    for (left, right), (rows, columns, cycles) in zip(pairs, searched(dut, pairs), strict=True):
        distance = hamming.distances(left, right)
        assert rows == nearest(distance, empty)
        assert columns == nearest(distance.T, empty)
        assert cycles == search_cycles(dut, len(left), len(right))


@pytest.mark.usefixtures("unused_blocks")
def test_search_cycles_are_those_of_the_lanes() -> None:
    dut = NearestNeighbours(bits=128, lanes=16, max_features=2048)
    for count in (320, 1856, 2048):
        assert search_cycles(dut, count, count) == count * count // 16 + dut.drain_cycles
    assert dut.drain_cycles < 32
    assert search_cycles(dut, 0, 5) == search_cycles(dut, 5, 0) == 0


@pytest.mark.parametrize("sizes", [(0, 5), (5, 0), (0, 0)])
def test_search_without_features_ends_at_once(sizes: tuple[int, int]) -> None:
    dut = NearestNeighbours(bits=8, lanes=2, max_features=8)
    pairs = [(np.zeros((left, 1), np.uint8), np.zeros((right, 1), np.uint8)) for left, right in (sizes, (2, 2))]
    _, (rows, columns, _) = searched(dut, pairs)
    assert rows == columns == [(0, 0, 0), (0, 0, 0)]


@pytest.mark.usefixtures("unused_blocks")
def test_columns_that_come_after_their_distance_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdl.matching.nearest_neighbours.COLUMN_CYCLES", 9)
    with pytest.raises(ValueError, match="columns take 9 clocks, but the path that they meet only 7"):
        NearestNeighbours(bits=8, lanes=2, max_features=8)
