# amaranth: UnusedElaboratable=no
"""Every position equals the golden model, one per clock and after any pauses."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.painting.corners import CORNER
from golden_model.painting.positions import positions
from hdl.painting.positions import Positions
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.golden_model.painting import tilted
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_streams
from tests.hdl.painting.payloads import corner_payload

PIXELS = 32 * 32


def tiles() -> NDArray[np.int64]:
    """Level and tilted tiles, half outside the frame, and corners as far apart as a window allows."""
    seen = [
        tilted.corners(tilted.pose((640, 480), zoom=0.5, turn=2.0, tilt=8e-4), np.array([[0, 0]])),
        tilted.corners(tilted.pose((100, 90), zoom=1.3, turn=0.7), np.array([[7, 3]])),
    ]
    rng = np.random.default_rng(1)
    # Whatever the corners, the adders follow: beyond the borders of the largest frame.
    extremes = [rng.integers(0, 127 * CORNER.one, (1, 3, 3, 2)) + first * CORNER.one for first in (-60, 4090)]
    return np.concatenate([*seen, *extremes])


def payloads(corners: NDArray[np.int64]) -> list[dict[str, Any]]:
    return [
        {"corners": corner_payload(each), "window": n % 2, "wide": n // 2 % 2, "blank": 0}
        for n, each in enumerate(corners)
    ]


def rows(results: list[Any]) -> NDArray[np.int64]:
    return np.array([(each.x, each.y) for each in results])


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=200, stalls=130, seed=3)], ids=["free", "pauses"])
def test_positions_equal_the_golden_model(pauses: Pauses) -> None:
    corners = tiles()[: 4 if pauses == NO_PAUSES else 1]
    count = len(corners)
    # Without pauses 1026 clocks a tile, as documented, and one in which the bench stops.
    limit = 1026 * count + 1 if pauses == NO_PAUSES else 3000 * count
    results = run_streams(
        Positions(), {"i": payloads(corners)}, {"o": count * PIXELS}, pauses=pauses, cycle_limit=limit
    )["o"]
    np.testing.assert_array_equal(rows(results), positions(corners).reshape(-1, 2))
    assert [each.window + 2 * each.wide for each in results] == [n % 4 for n in range(count) for _ in range(PIXELS)]
    assert not any(each.blank for each in results)


def test_a_reset_in_any_phase_leaves_nothing_behind() -> None:
    first, second = payloads(tiles()[:2])
    expected = positions(tiles()[1:2]).reshape(-1, 2)
    dut = Positions()
    bench = BlockBench(dut, cycle_limit=3000)
    results: list[Any] = []

    async def run(ctx: Any) -> None:
        for taken in (0, 1, 20, 40, 540):
            ctx.set(dut.i.valid, 1)
            ctx.set(dut.i.payload, first)
            for _ in range(taken):
                await bench.stream_get(ctx, dut.o)
            await bench.pulse(ctx, bench.reset)
            ctx.set(dut.i.payload, second)
            results.append([await bench.stream_get(ctx, dut.o) for _ in range(70)])
            await bench.pulse(ctx, bench.reset)

    bench.run(run)
    for each in results:
        np.testing.assert_array_equal(rows(each), expected[:70])
