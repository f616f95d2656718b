# amaranth: UnusedElaboratable=no
"""Bit counts, nearest neighbours and mutual matches equal the golden model, ties included."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from amaranth.hdl import Fragment
from numpy.typing import NDArray

from golden_model.matching import hamming
from hdl.lib.popcount import Popcount
from hdl.matching.feature_banks import READ_CYCLES
from hdl.matching.mutual_neighbours import MutualNearestNeighbours
from hdl.matching.nearest_neighbours import RESULT_CYCLES, NearestNeighbours
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_clocks


def some_equal(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    return rng.integers(0, 256, (4, bits // 8), dtype=np.uint8)[rng.integers(0, 4, count)]


def close_together(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    """One descriptor with a few bits changed: the distances are small, and many are equal."""
    flips = rng.random((count, bits)) < 2 / bits
    return rng.integers(0, 256, bits // 8, dtype=np.uint8) ^ np.packbits(flips, axis=1)


def opposite(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    """Descriptors of all zeros or all ones: the largest distance can also be the smallest."""
    return np.repeat(rng.choice([0, 255], (count, 1)), bits // 8, axis=1).astype(np.uint8)


def random_bits(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    return rng.integers(0, 256, (count, bits // 8), dtype=np.uint8)


def descriptor_ints(descriptors: NDArray[np.uint8]) -> list[Any]:
    return [int.from_bytes(descriptor.tobytes(), "little") for descriptor in descriptors]


def nearest(distance: NDArray[np.integer], empty: int) -> list[tuple[int, int, int]]:
    """``(best, second, index)`` of each row, ``empty`` for a missing second."""
    result = []
    for row in distance.astype(int):
        index = int(row.argmin())
        others = np.delete(row, index)
        result.append((int(row[index]), int(others.min()) if len(others) else empty, index))
    return result


@pytest.mark.parametrize(("bits", "lanes"), [(3, 2), (8, 3), (24, 2), (32, 1), (128, 2), (256, 2)])
def test_popcount_counts_the_ones_of_each_lane(bits: int, lanes: int) -> None:
    dut = Popcount(bits=bits, lanes=lanes)
    rng = np.random.default_rng(bits)
    inputs = rng.random((40, bits, lanes)) < rng.random((40, 1, lanes))
    inputs[0], inputs[1] = 0, 1
    valid = rng.random(40) < 0.7
    valid[:2] = True
    values = (inputs << np.arange(lanes)).sum(axis=2).tolist()
    rows = [
        [(dut.i_valid, bool(is_valid)), *zip(dut.i_planes, planes, strict=True)]
        for is_valid, planes in zip(valid, values, strict=True)
    ]
    rows += [[]] * dut.latency_cycles  # the last planes stay at the inputs
    counts = run_clocks(dut, rows, dut.o_counts)[dut.latency_cycles :]
    # A count stays until the next valid input.
    last_valid = np.maximum.accumulate(np.where(valid, np.arange(40), 0))
    np.testing.assert_array_equal(counts, inputs.sum(axis=1)[last_valid])


def test_popcount_refuses_too_few_bits() -> None:
    with pytest.raises(ValueError, match="bits is 2"):
        Popcount(bits=2, lanes=1)


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
            cycles = await bench.wait_until_low(ctx, dut.o_busy, at_most=dut.search_cycles(len(left), len(right)))
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


@pytest.mark.parametrize("descriptors", [random_bits, some_equal, close_together, opposite], ids=lambda f: f.__name__)
@pytest.mark.parametrize(("bits", "lanes", "max_features"), [(32, 4, 32), (8, 2, 21), (128, 8, 16)])
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
        assert cycles == dut.search_cycles(len(left), len(right))


def test_search_cycles_are_those_of_the_lanes() -> None:
    dut = NearestNeighbours(bits=128, lanes=16, max_features=2048)
    Fragment.get(dut, None)  # otherwise Amaranth warns that its parts are unused
    for count in (320, 1856, 2048):
        assert dut.search_cycles(count, count) == count * count // 16 + dut.drain_cycles
    assert dut.drain_cycles < 32
    assert dut.search_cycles(0, 5) == dut.search_cycles(5, 0) == 0


@pytest.mark.parametrize("sizes", [(0, 5), (5, 0), (0, 0)])
def test_search_without_features_ends_at_once(sizes: tuple[int, int]) -> None:
    dut = NearestNeighbours(bits=8, lanes=2, max_features=8)
    pairs = [(np.zeros((left, 1), np.uint8), np.zeros((right, 1), np.uint8)) for left, right in (sizes, (2, 2))]
    _, (rows, columns, _) = searched(dut, pairs)
    assert rows == columns == [(0, 0, 0), (0, 0, 0)]


@pytest.mark.parametrize(
    ("lanes", "max_features", "message"), [(3, 8, "lanes is 3"), (1, 8, "lanes is 1"), (16, 8, "lanes is 16")]
)
def test_an_impossible_number_of_lanes_is_refused(lanes: int, max_features: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        NearestNeighbours(bits=8, lanes=lanes, max_features=max_features)


@pytest.mark.usefixtures("unused_blocks")
def test_columns_that_come_after_their_distance_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdl.matching.nearest_neighbours.RESULT_CYCLES", 9)
    with pytest.raises(ValueError, match="columns take 9 clocks, but the path that they meet only 7"):
        NearestNeighbours(bits=8, lanes=2, max_features=8)


def walked(
    dut: MutualNearestNeighbours, distance: NDArray[np.integer], pauses: Pauses
) -> list[tuple[list[tuple[Any, Any, Any, Any]], int]]:
    """The pairs and the clocks of two walks over the results of a search."""
    empty = (1 << dut.bits.bit_length()) - 1
    results = {"row": nearest(distance, empty), "column": nearest(distance.T, empty)}
    bench = BlockBench(dut, pauses=pauses, cycle_limit=2 * 400)
    walks, pairs = [], list[Any]()

    async def memories(ctx: Any) -> None:
        reading = {"row": [0] * RESULT_CYCLES, "column": [0] * RESULT_CYCLES}
        async for *_, read, row, column in ctx.tick().sample(dut.o_read, dut.o_row_index, dut.o_column_index):
            for name, port, address in (("row", dut.i_row, row), ("column", dut.i_column, column)):
                if read:
                    reading[name] = [address, *reading[name][:-1]]
                entries, answered = results[name], reading[name][-1]
                best, second, index = entries[answered] if answered < len(entries) else (0, 0, 0)
                ctx.set(port, {"best": best, "second": second, "index": index})

    async def run(ctx: Any) -> None:
        ctx.set(dut.i_left_count, len(distance))
        for _ in range(2):
            await bench.pulse(ctx, dut.i_start)
            pairs.clear()
            cycles = await bench.wait_until_low(ctx, dut.o_busy, at_most=399)
            walks.append((pairs.copy(), cycles))

    async def take(ctx: Any) -> None:
        while True:
            pair = await bench.stream_get(ctx, dut.o)
            pairs.append((pair.left, pair.right, pair.distance, pair.margin))

    bench.run(run, background=[memories, take])
    return walks


@pytest.mark.parametrize("stalls", [0, 150])
@pytest.mark.parametrize("descriptors", [random_bits, some_equal, close_together], ids=lambda f: f.__name__)
@pytest.mark.parametrize("sizes", [(30, 32), (32, 7), (1, 1), (1, 2), (2, 1)])
def test_mutual_matches_equal_the_golden_model(
    sizes: tuple[int, int], descriptors: Callable[..., Any], stalls: int
) -> None:
    rng = np.random.default_rng(5)
    each = descriptors(rng, sum(sizes), 32)
    distance = hamming.distances(each[: sizes[0]], each[sizes[0] :])
    expected = list(zip(*(column.tolist() for column in hamming.mutual_matches(distance, 32)), strict=True))
    dut = MutualNearestNeighbours(bits=32, max_features=32)
    # One clock for each row, the latency of two reads, and two more clocks until the last pair is taken.
    last_pair = expected[-1][0] if expected else 0
    walk_cycles = 2 * RESULT_CYCLES + max(sizes[0], last_pair + 3)
    for pairs, cycles in walked(dut, distance, Pauses(stalls=stalls, seed=3)):
        assert pairs == expected
        if not stalls:
            assert cycles == walk_cycles
