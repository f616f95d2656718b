# amaranth: UnusedElaboratable=no
"""Every tile that the golden model finds is offered, in its order, whatever the pose."""

from typing import Any

import numpy as np

from golden_model.painting.tiles import UNIT_TILES, touched
from hdl.painting.tiles import COEFFICIENT_CYCLES, TileWalker
from sim.simulators.recording import Pauses
from tests.golden_model.painting.poses import homography, pose
from tests.hdl.block_bench import BlockBench
from tests.hdl.painting.payloads import put_pose

SIZE = (90, 70)
TILES = (7, 9)
SETTINGS = {"i_width_px": SIZE[0], "i_height_px": SIZE[1], "i_columns": TILES[0], "i_rows": TILES[1]}


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


def test_the_tiles_are_those_of_the_golden_model() -> None:
    pauses = Pauses(gaps=90, stalls=120, seed=2)
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

    bench = BlockBench(dut, settings=SETTINGS, pauses=pauses, cycle_limit=4000)
    bench.run(send, receive)
    assert found == wanted


def test_a_reset_forgets_the_pose_and_the_way() -> None:
    """In the middle of the way, in a row that leads to the left, and between the columns of a pose."""
    first, last = poses()[0], poses()[-1]
    dut = TileWalker()
    found: list[list[int]] = []

    async def run(ctx: Any) -> None:
        ctx.set(dut.o.ready, 1)
        await put_pose(ctx, bench, dut.i, first)
        await ctx.tick().repeat(25)
        assert not ctx.get(dut.o_idle)
        await bench.pulse(ctx, bench.reset)
        await put_pose(ctx, bench, dut.i, first, columns=2)
        await bench.pulse(ctx, bench.reset)
        assert ctx.get(dut.o_idle)
        ctx.set(dut.o.ready, 0)
        await put_pose(ctx, bench, dut.i, last)
        while not ctx.get(dut.o_idle):
            if ctx.get(dut.o.valid):
                tile = await bench.stream_get(ctx, dut.o)
                found.append([tile.column, tile.row])
            else:
                await ctx.tick()

    bench = BlockBench(dut, settings=SETTINGS, cycle_limit=1200)
    bench.run(run)
    assert found == touched(last, SIZE, TILES).tolist()


def test_every_tile_is_offered_where_the_canvas_is_replaced() -> None:
    dut = TileWalker()
    found: list[list[int]] = []
    cycles = 0

    async def run(ctx: Any) -> None:
        nonlocal cycles
        await put_pose(ctx, bench, dut.i, poses()[3])
        ctx.set(dut.o.ready, 1)
        while not ctx.get(dut.o_idle):
            *_, valid, tile = await ctx.tick().sample(dut.o.valid, dut.o.payload)
            if valid:
                found.append([tile.column, tile.row])
            cycles += 1

    bench = BlockBench(dut, settings={**SETTINGS, "i_replace": 1}, cycle_limit=1000)
    bench.run(run)
    assert found == touched(poses()[3], SIZE, TILES, all_tiles=True).tolist()
    # The last column settles, and the best corner is favoured; then a tile in each clock.
    assert cycles == dut.setup_cycles - UNIT_TILES - 2 * (COEFFICIENT_CYCLES + 1) - 1 + len(found)
