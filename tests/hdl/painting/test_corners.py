# amaranth: UnusedElaboratable=no
"""Every tile comes back with the golden model's corners, in any order of tiles, for one pose after the other."""

from typing import Any

import numpy as np

from golden_model.painting.corners import project
from hdl.painting.corners import CornerProjector
from sim.simulators.recording import Pauses
from tests.golden_model.painting.poses import homography, pose
from tests.hdl.block_bench import BlockBench
from tests.hdl.painting.payloads import put_pose

SIZE = (640, 480)
LEVEL = pose(homography(SIZE, (900, 700), turn=0.7, zoom=1.1, tilt=(1e-4, 3e-4)))
TILTED = pose(homography(SIZE, (900, 700), turn=2, tilt=(4e-3, -3e-3)))
CASES = [
    # In the walker's order, and against it.
    (LEVEL, [(27, 20), (28, 20), (28, 21), (26, 22), (27, 20)]),
    # Before, across and behind the horizon; just before it, with corners beyond the format; before it again.
    (TILTED, [(27, 21), (4, 1), (0, 100), (19, 19), (27, 22)]),
    (pose(homography(SIZE, (4000, 4000), zoom=2)), [(127, 126), (127, 127), (0, 0)]),
]


def test_corners_are_those_of_the_golden_model() -> None:
    pauses = Pauses(gaps=90, stalls=120, seed=2)
    dut = CornerProjector()
    found: list[Any] = []

    async def send(ctx: Any) -> None:
        for each, tiles in CASES:
            await put_pose(ctx, bench, dut.i_pose, each)
            for tile in tiles:
                await bench.stream_put(ctx, dut.i, dict(zip(("column", "row"), tile, strict=True)))

    async def receive(ctx: Any) -> None:
        for _, tiles in CASES:
            for _ in tiles:
                got = await bench.stream_get(ctx, dut.o)
                corners = [[corner.x, corner.y] for corner in got.corners]
                found.append(((got.tile.column, got.tile.row), got.behind, corners))

    bench = BlockBench(dut, pauses=pauses, cycle_limit=8000)
    bench.run(send, receive)
    wanted = []
    for each, tiles in CASES:
        corners, behind = project(each, np.array(tiles))
        wanted += list(zip(tiles, behind, corners.reshape(-1, 9, 2).tolist(), strict=True))
    found = [(tile, behind, np.zeros((9, 2), int).tolist() if behind else corners) for tile, behind, corners in found]
    assert found == wanted
    assert [behind for _, behind, _ in found][5:10] == [0, 1, 1, 1, 0]


def test_a_reset_forgets_pose_and_tile() -> None:
    """On the way to a tile, in a division, and in a pose; then a tile takes 9 times 25 clocks and its way."""
    dut = CornerProjector()

    async def run(ctx: Any) -> None:
        for clocks in (20, 160):
            await put_pose(ctx, bench, dut.i_pose, TILTED)
            await bench.stream_put(ctx, dut.i, {"column": 30, "row": 40})
            await ctx.tick().repeat(clocks)
            await bench.pulse(ctx, bench.reset)
            assert not ctx.get(dut.i.ready)
        await put_pose(ctx, bench, dut.i_pose, TILTED, columns=2)
        await bench.pulse(ctx, bench.reset)
        await put_pose(ctx, bench, dut.i_pose, LEVEL)
        await bench.stream_put(ctx, dut.i, {"column": 3, "row": 0})
        clocks = 0
        while not ctx.get(dut.o.valid):
            await ctx.tick()
            clocks += 1
        got = ctx.get(dut.o.payload)
        corners, _ = project(LEVEL, np.array([(3, 0)]))
        assert [[corner.x, corner.y] for corner in got.corners] == corners.reshape(-1, 2).tolist()
        assert clocks == dut.tile_cycles + 2 * 3

    bench = BlockBench(dut, cycle_limit=3000)
    bench.run(run)


def test_a_tile_goes_before_a_pose_that_comes_with_it() -> None:
    dut = CornerProjector()
    found: list[list[list[int]]] = []

    async def send_poses(ctx: Any) -> None:
        await put_pose(ctx, bench, dut.i_pose, LEVEL)
        # Both are offered while the first tile is projected.
        await ctx.tick().repeat(3)
        await put_pose(ctx, bench, dut.i_pose, TILTED)

    async def send_tiles(ctx: Any) -> None:
        for column in (3, 4):
            await bench.stream_put(ctx, dut.i, {"column": column, "row": 0})

    async def receive(ctx: Any) -> None:
        for _ in range(2):
            got = await bench.stream_get(ctx, dut.o)
            found.append([[corner.x, corner.y] for corner in got.corners])

    bench = BlockBench(dut, cycle_limit=2000)
    bench.run(send_poses, send_tiles, receive)
    corners, _ = project(LEVEL, np.array([(3, 0), (4, 0)]))
    assert found == corners.reshape(2, -1, 2).tolist()
