"""Tiles come out of memory and go back: each to its place, and nothing is read before it was painted."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.painting.tiles import TILE_PX
from hdl.painting.canvas_port import CanvasPort
from hdl.settings import PAGE_BYTES
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.shell.axi_memory import AxiMemory

BASE, COLUMNS, ROWS = 0x12_3456_7000, 3, 2
Tile = tuple[int, int]


class PortBench:
    """A port with a memory; between old and new pixels some clocks and a fixed change."""

    def __init__(self, *, replace: bool = False, pauses: Pauses = NO_PAUSES, **rules: Any) -> None:
        self.memory = AxiMemory(BASE, COLUMNS * ROWS * PAGE_BYTES, **rules)
        self.dut = CanvasPort()
        self.canvas = self.memory.bytes.reshape(ROWS, COLUMNS, TILE_PX * TILE_PX, 4)
        self.canvas[:] = np.random.default_rng(1).integers(1, 256, self.canvas.shape)
        settings = {"i_replace": replace, "i_page": BASE // PAGE_BYTES, "i_columns": COLUMNS}
        self.bench = BlockBench(self.dut, settings=settings, pauses=pauses, cycle_limit=40_000)
        self.given: list[NDArray[np.uint8]] = []
        self.painted: list[tuple[Tile, int, int]] = []
        self.errors = self.clocks = 0
        self._between: list[dict[str, Any]] = []

    def run(self, tiles: list[Tile], painted: set[Tile]) -> None:
        """Visit tiles; those in ``painted`` are in memory already."""
        count = len(tiles) * TILE_PX * TILE_PX

        async def visit(ctx: Any) -> None:
            for column, row in tiles:
                tile = {"column": column, "row": row}
                await self.bench.stream_put(ctx, self.dut.i, {"tile": tile, "painted": (column, row) in painted})

        async def take(ctx: Any) -> None:
            pixels = []
            for _ in range(count):
                old = await self.bench.stream_get(ctx, self.dut.o)
                pixels.append([*old.colour, old.weight])
                self._between.append({"colour": [255 - each for each in old.colour], "weight": old.weight | 4})
            self.given = list(np.array(pixels, np.uint8).reshape(len(tiles), -1, 4))

        async def paint(ctx: Any) -> None:
            for _ in range(count):
                while not self._between:
                    await ctx.tick()
                await self.bench.stream_put(ctx, self.dut.i_new, self._between.pop(0))
            while not ctx.get(self.dut.o_idle):
                await ctx.tick()

        ports = [self.memory.read_port(self.dut.reads), self.memory.port(self.dut.writes)]
        self.bench.run(visit, take, paint, background=[*ports, self._watch])

    async def _watch(self, ctx: Any) -> None:
        async for *_, painted, error in ctx.tick().sample(self.dut.o_painted, self.dut.o_error):
            self.clocks += 1
            self.errors += error
            if painted.valid:
                self.painted.append(((painted.tile.column, painted.tile.row), painted.least, painted.painted))


def change(old: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.concatenate([255 - old[..., :3], old[..., 3:] | 4], axis=-1)


@pytest.mark.parametrize(
    ("rules", "pauses", "tiles"),
    [
        ({}, NO_PAUSES, [(2, 1), (2, 0)]),
        (
            {"waits": 43, "latency_clocks": 119, "seed": 1},
            Pauses(gaps=40, stalls=40, seed=2),
            [(1, 0), (2, 0)],
        ),
    ],
    ids=["fast", "slow"],
)
def test_tiles_come_and_go(rules: dict[str, Any], pauses: Pauses, tiles: list[Tile]) -> None:
    bench = PortBench(pauses=pauses, **rules)
    before = bench.canvas.copy()
    painted = {(2, 1), (2, 0)}
    bench.run(tiles, painted)
    expected = before.copy()
    for (column, row), given in zip(tiles, bench.given, strict=True):
        old = before[row, column] if (column, row) in painted else np.zeros_like(before[row, column])
        np.testing.assert_array_equal(given, old)
        expected[row, column] = change(old)
    np.testing.assert_array_equal(bench.canvas, expected)
    least = [int(expected[row, column, :, 3].min()) for column, row in tiles]
    assert bench.painted == list(zip(tiles, least, [1] * len(tiles), strict=True))
    # Reading and writing go on beside painting.
    assert rules or bench.clocks < len(tiles) * TILE_PX * TILE_PX + 700


def test_what_is_replaced_is_not_read() -> None:
    bench = PortBench(replace=True)
    bench.run([(1, 1)], {(1, 1)})
    assert not bench.given[0].any()
    assert (bench.canvas[1, 1] == (255, 255, 255, 4)).all()


def test_a_tile_with_an_error_stays_and_may_be_painted_again() -> None:
    """The first was painted before, the second was not."""
    # Late answers: those of a tile's last rows come long after its words have gone.
    bench, tiles = PortBench(errors=5, latency_clocks=200, seed=1), [(2, 0), (0, 1)]
    before = bench.canvas.copy()
    bench.run(tiles, {tiles[0]})
    # A row of a tile is a burst: it is new, or as it was.
    for (column, row), (tile, least, painted) in zip(tiles, bench.painted, strict=True):
        assert tile == (column, row)
        was_painted = tile == tiles[0]
        old = before[row, column]
        new = change(old if was_painted else np.zeros_like(old))
        is_new, is_old = ((bench.canvas[row, column] == each).reshape(TILE_PX, -1).all(axis=1) for each in (new, old))
        assert (is_new | is_old).all()
        assert not is_new.all()
        assert least == 0
        assert painted == was_painted
    assert bench.errors >= bench.memory.error_count > 0
