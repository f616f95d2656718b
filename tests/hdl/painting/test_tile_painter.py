# amaranth: UnusedElaboratable=no
"""The path of a pixel: positions, sampling and blending paint tiles as the golden model does, one pixel per clock."""

from typing import Any

import numpy as np
from amaranth import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from golden_model.painting.blending import blend
from golden_model.painting.positions import positions
from golden_model.painting.sampling import sample
from hdl.painting.blending import Blending
from hdl.painting.positions import LOADED_TILE, Positions
from hdl.painting.sampling import PIXEL, WINDOW_WRITE, Sampling
from hdl.painting.tiles import FRAME_SIDE
from tests.golden_model.painting import tilted
from tests.hdl.block_bench import BlockBench
from tests.hdl.painting.payloads import corner_payload, pixel_payload, pixel_row

SIZE = (57, 43)
TILE_CYCLES = 1026
"""As `Positions` says."""


class PixelPath(wiring.Component):
    """The three blocks, and old pixels that are there when they are needed."""

    i_write: In(WINDOW_WRITE)
    i_width_px: In(FRAME_SIDE)
    i_height_px: In(FRAME_SIDE)
    i: In(stream.Signature(LOADED_TILE))
    i_old: In(stream.Signature(PIXEL))
    o: Out(stream.Signature(PIXEL))

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.positions = places = Positions()
        m.submodules.sampling = samples = Sampling()
        m.submodules.blending = blends = Blending()
        wiring.connect(m, wiring.flipped(self.i), places.i)
        wiring.connect(m, places.o, samples.i)
        wiring.connect(m, blends.o, wiring.flipped(self.o))
        both = samples.o.valid & self.i_old.valid
        m.d.comb += [
            samples.i_write.eq(self.i_write),
            samples.i_width_px.eq(self.i_width_px),
            samples.i_height_px.eq(self.i_height_px),
            blends.i.valid.eq(both),
            blends.i.payload.old.eq(self.i_old.payload),
            blends.i.payload.new.eq(samples.o.payload),
            samples.o.ready.eq(both & blends.i.ready),
            self.i_old.ready.eq(both & blends.i.ready),
        ]
        return m


def test_tiles_half_outside_the_frame_follow_each_other() -> None:
    rng = np.random.default_rng(3)
    frame = rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    H = tilted.pose(SIZE, zoom=0.9, turn=0.6, tilt=2e-4, tiles=2)
    corners = tilted.corners(H, np.array([[0, 0], [1, 1]]))
    old = rng.integers(0, 256, (len(corners), 32, 32, 4), dtype=np.uint8)
    old[..., 3] = rng.choice([0, 5, 12, 30], old.shape[:3])
    colours, weights = sample(frame, positions(corners))
    assert 0.2 < (weights > 0).mean() < 0.8
    settings = {"i_width_px": SIZE[0], "i_height_px": SIZE[1]}
    dut = PixelPath()
    bench = BlockBench(dut, settings=settings, cycle_limit=6000)
    results: list[list[int]] = []
    clocks: list[int] = []

    async def send(ctx: Any) -> None:
        for y, x in np.ndindex(SIZE[1], SIZE[0] // 2 + 1):
            pair = np.pad(frame[y], ((0, 1), (0, 0)))[2 * x : 2 * x + 2].tolist()
            ctx.set(dut.i_write, {"valid": 1, "y": y, "x": 32 + x, "pixels": pair, "kept": [1, 1]})
            await ctx.tick()
        ctx.set(dut.i_write.valid, 0)
        for each in corners:
            await bench.stream_put(ctx, dut.i, {"corners": corner_payload(each), "window": 1, "blank": 0})

    async def send_old(ctx: Any) -> None:
        for pixel in old.reshape(-1, 4):
            await bench.stream_put(ctx, dut.i_old, pixel_payload(pixel[:3], pixel[3]))

    async def receive(ctx: Any) -> None:
        while len(results) < old.size // 4:
            results.append(pixel_row(await bench.stream_get(ctx, dut.o)))

    async def count(ctx: Any) -> None:
        async for _, _, offered, taken in ctx.tick().sample(dut.i.valid, dut.o.valid & dut.o.ready):
            clocks.append(bool(offered) + 2 * bool(taken))

    bench.run(send, send_old, receive, background=[count])
    np.testing.assert_array_equal(np.array(results).reshape(old.shape), blend(old, colours, weights))
    offered, taken = (np.flatnonzero(np.array(clocks) & bit) for bit in (1, 2))
    latency = Positions.latency_cycles + Sampling.latency_cycles + Blending.latency_cycles
    assert taken[0] - offered[0] == latency
    assert taken[-1] - taken[0] == TILE_CYCLES + 1024 - 1
