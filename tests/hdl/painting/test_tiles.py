# amaranth: UnusedElaboratable=no
"""Every tile that the golden model finds is offered, in its order, whatever the pose."""

from typing import Any

import numpy as np
import pytest

from golden_model.painting.tiles import touched
from hdl.painting.tiles import TileWalker
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.golden_model.painting.poses import homography, pose
from tests.hdl.block_bench import BlockBench
from tests.hdl.painting.payloads import put_pose

SIZE = (90, 70)
TILES = (7, 9)


def poses() -> list[np.ndarray]:
    """Level, turned, far too large, with a horizon across the canvas, wholly behind it, and off the canvas."""
    middle = (100, 130)
    horizon = homography(SIZE, middle, turn=2, tilt=(4e-3, -9e-3))
    assert horizon[2] @ (0, 280, 1) < 0 < horizon[2] @ (100, 130, 1)
    return [
        pose(each)
        for each in (
            homography(SIZE, middle, turn=0.3, zoom=1.3),
            homography(SIZE, middle, turn=-2.2, zoom=0.25),
            horizon,
            -homography(SIZE, middle),
            homography(SIZE, (500, -90), turn=1),
            homography(SIZE, (0, 0), turn=4, zoom=2),
        )
    ]


@pytest.mark.parametrize("pauses", [NO_PAUSES, Pauses(gaps=90, stalls=120, seed=2)], ids=["free", "pauses"])
def test_the_tiles_are_those_of_the_golden_model(pauses: Pauses) -> None:
    given = poses()
    tiles = [touched(each, SIZE, TILES).tolist() for each in given]
    wanted = [tile for each in tiles for tile in each]
    assert [len(each) for each in tiles[3:5]] == [0, 0]
    dut = TileWalker()
    found: list[list[int]] = []

    async def send(ctx: Any) -> None:
        for each in given:
            await put_pose(ctx, bench, dut.i, each)

    async def receive(ctx: Any) -> None:
        for _ in wanted:
            tile = await bench.stream_get(ctx, dut.o)
            found.append([tile.column, tile.row])

    settings = {"i_width_px": SIZE[0], "i_height_px": SIZE[1], "i_columns": TILES[0], "i_rows": TILES[1]}
    bench = BlockBench(dut, settings=settings, pauses=pauses, cycle_limit=4000)
    bench.run(send, receive)
    assert found == wanted
