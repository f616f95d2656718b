"""Mutual matches equal the golden model, whatever stalls."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.matching import hamming
from hdl.matching.mutual_neighbours import MutualNearestNeighbours
from hdl.matching.nearest_neighbours import RESULT_CYCLES
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.matching.descriptors import close_together, nearest, random_bits, some_equal


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
