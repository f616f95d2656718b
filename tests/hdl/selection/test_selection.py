# amaranth: UnusedElaboratable=no
"""Selection of one level keeps the golden model's features in its order, under any back-pressure.

It stands for tests of its parts, whose wrong lines it notices in samples: `cell_ranking` and `row_buffer`.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from amaranth.lib.data import Const
from numpy.typing import NDArray

from golden_model.feature.ilbp import PATTERNS
from golden_model.selection import selection
from hdl.selection.selection import CellSelection, RasterSelection
from sim.simulators.recording import Pauses
from tests.hdl.block_bench import BlockBench

PATTERN = PATTERNS["thesis-ilbp-1"]
WIDTH_PX, HEIGHT_PX = 104, 80
SPACING_PX = 2
"""Distance of candidates in a line; with two pixels per clock they may come in every clock."""
FLIGHT_CYCLES = 5
"""Clocks from frame admission to the selection."""
CYCLE_LIMIT = 60_000
IN_FLIGHT = 4


def candidate_plane(rng: np.random.Generator, responses: NDArray[np.int64]) -> NDArray[np.uint16]:
    """A (H, W) plane of response codes, candidates of a line at least `SPACING_PX` apart."""
    plane = np.zeros((HEIGHT_PX, WIDTH_PX), np.uint16)
    plane[:, ::SPACING_PX] = responses[:, ::SPACING_PX]
    plane[:, ::SPACING_PX] *= rng.random((HEIGHT_PX, -(-WIDTH_PX // SPACING_PX))) < 0.03
    return plane


@pytest.fixture
def planes() -> list[NDArray[np.uint16]]:
    """Planes with few or many different responses, with one candidate, with none, and with equal responses only."""
    rng = np.random.default_rng(31)
    shape = HEIGHT_PX, WIDTH_PX
    falling = np.arange(HEIGHT_PX * WIDTH_PX, 0, -1).reshape(shape)
    lone = np.zeros(shape, np.uint16)
    lone[77, 102] = 1
    return [
        candidate_plane(rng, rng.integers(1, 1 << 15, shape)),
        candidate_plane(rng, rng.integers(1, 4, shape)),
        lone,
        np.zeros(shape, np.uint16),
        candidate_plane(rng, np.full(shape, 0x7FFF)),
        candidate_plane(rng, falling),
        candidate_plane(rng, falling[::-1]),
    ]


def events(plane: NDArray[np.uint16], cell_px: int | None) -> Iterator[Any]:
    """Fields of the beats that the selection gets for a frame, in raster order."""
    height, width = plane.shape
    for y in range(height):
        ends_level = y == height - 1
        ends_row = ends_level or (cell_px is not None and y % cell_px == cell_px - 1)
        beats = {int(x): {"x": int(x), "present": 1, "feature": feature(plane, x, y)} for x in np.flatnonzero(plane[y])}
        if ends_row:
            # The line's last beat may hold a feature, too.
            last = width - SPACING_PX
            beats[last] = {"x": last, **beats.get(last, {}), "ends_row": 1, "ends_level": int(ends_level)}
        yield from beats.values()


def feature(plane: NDArray[np.uint16], x: np.int64, y: int) -> dict[str, int]:
    """A feature that differs from all others."""
    return {"response": int(plane[y, x]), "x": int(x), "y": int(y), "descriptor": int(x * 7 + y * 3) & 0xFF}


def golden(plane: NDArray[np.uint16], cell_px: int | None, per_cell: int | None) -> list[Any]:
    """The expected output: features, and for the end of each row whether it is the last."""
    if cell_px is None:
        return [*(feature(plane, x, y) for x, y in zip(*selection.raster(plane), strict=True)), True]
    assert per_cell is not None
    x, y = selection.best_of_cells(plane, cell_px, per_cell)
    rows = -(-plane.shape[0] // cell_px)
    leaving = []
    for row in range(rows):
        leaving += [feature(plane, *at) for at in zip(x, y, strict=True) if at[1] // cell_px == row]
        leaving.append(row == rows - 1)
    return leaving


class SelectionBench:
    """The pipeline in front of a selection with its frame admission, and the stream behind it."""

    def __init__(
        self,
        dut: CellSelection | RasterSelection,
        *,
        pauses: Pauses,
        settings: dict[str, Any] | None = None,
        spacing_cycles: int = SPACING_PX,
    ) -> None:
        self.dut = dut
        self.spacing_cycles = spacing_cycles
        self.pauses = pauses
        self.bench = BlockBench(dut, settings=settings, pauses=pauses, cycle_limit=CYCLE_LIMIT)
        self.received: list[Any] = []
        self.added = 0
        self.waited_cycles = 0

    def run(self, play: Callable[..., Any]) -> None:
        self.bench.run(play, background=[self._take])

    async def send(self, ctx: Any, beats: list[dict[str, Any]] | Iterator[Any], *, cells: bool) -> None:
        for number, beat in enumerate(beats):
            # As many features as are in flight still arrive.
            if "ends_row" in beat if cells else number % IN_FLIGHT == 0:
                while ctx.get(self.dut.o_busy):
                    self.waited_cycles += 1
                    await self._tick(ctx)
            if cells and "ends_row" in beat:
                ctx.set(self.dut.i_reserve, 1)
                await self._tick(ctx)
                ctx.set(self.dut.i_reserve, 0)
                for _ in range(FLIGHT_CYCLES):
                    await self._tick(ctx)
            ctx.set(self.dut.i, beat)
            await self._tick(ctx)
            ctx.set(self.dut.i, {"feature": {"response": 0x5555}})
            # Between the end of a row and the next feature there is a border, however close features are.
            wait_cycles = max(self.spacing_cycles, 2 * ("ends_row" in beat)) - 1
            for _ in range(wait_cycles + self.pauses.gap(number)):
                await self._tick(ctx)

    async def drain(self, ctx: Any, ends: int) -> None:
        while sum(item is True for item in self.received) < ends:
            await self._tick(ctx)

    async def _tick(self, ctx: Any) -> None:
        *_, added = await ctx.tick().sample(self.dut.o_added)
        self.added += added

    async def _take(self, ctx: Any) -> None:
        while True:
            self.received.append(plain(await self.bench.stream_get(ctx, self.dut.o)))


def plain(payload: Const) -> bool | dict[str, int]:
    """A feature as `feature` writes it, or the end of a row as `golden` does."""
    if payload.ends_row:
        return bool(payload.ends_level)
    assert not payload.ends_level
    return {name: payload.feature[name] for name in ("response", "x", "y", "descriptor")}


FREE = Pauses()
STALLED = Pauses(gaps=60, stalls=240, seed=4)


@pytest.mark.parametrize(
    ("cell_log2", "per_cell", "pauses", "spacing_cycles"), [(5, 5, STALLED, 1), (6, 8, STALLED, 2), (7, 1, FREE, 2)]
)
def test_cells_keep_their_best_in_order(
    planes: list[NDArray[np.uint16]], cell_log2: int, per_cell: int, pauses: Pauses, spacing_cycles: int
) -> None:
    dut = CellSelection(pattern=PATTERN, width_px=WIDTH_PX, spacing_cycles=spacing_cycles)
    settings = {"i_cell_log2": cell_log2, "i_per_cell": per_cell}
    bench = SelectionBench(dut, pauses=pauses, settings=settings, spacing_cycles=spacing_cycles)

    async def play(ctx: Any) -> None:
        for plane in planes:
            await bench.send(ctx, events(plane, 1 << cell_log2), cells=True)
        await bench.drain(ctx, len(planes))

    bench.run(play)
    expected = [item for plane in planes for item in golden(plane, 1 << cell_log2, per_cell)]
    assert bench.received == expected
    assert bench.added == sum(isinstance(item, dict) for item in expected)
    assert bench.waited_cycles > 0 or pauses is FREE


@pytest.mark.parametrize("pauses", [FREE, STALLED])
def test_raster_selection_keeps_everything(planes: list[NDArray[np.uint16]], pauses: Pauses) -> None:
    planes = [planes[0], planes[2], planes[3]]
    bench = SelectionBench(RasterSelection(pattern=PATTERN, depth=16, in_flight=IN_FLIGHT), pauses=pauses)

    async def play(ctx: Any) -> None:
        for plane in planes:
            await bench.send(ctx, events(plane, None), cells=False)
        await bench.drain(ctx, len(planes))

    bench.run(play)
    expected = [item for plane in planes for item in golden(plane, None, None)]
    assert bench.received == expected
    assert bench.added == sum(isinstance(item, dict) for item in expected)
    assert (bench.waited_cycles > 0) == (pauses is STALLED)


@pytest.mark.parametrize("cells", [True, False])
def test_a_feature_leaves_after_exactly_the_latency(cells: bool) -> None:
    dut: CellSelection | RasterSelection
    settings: dict[str, int]
    if cells:
        dut, settings = CellSelection(pattern=PATTERN, width_px=WIDTH_PX), {"i_cell_log2": 5, "i_per_cell": 1}
    else:
        dut, settings = RasterSelection(pattern=PATTERN, depth=16, in_flight=IN_FLIGHT), {}
    bench = SelectionBench(dut, pauses=FREE, settings=settings)

    async def play(ctx: Any) -> None:
        ctx.set(dut.i, {"x": 30, "present": 1, "ends_row": 1, "ends_level": 1, "feature": {"response": 9}})
        await ctx.tick()
        ctx.set(dut.i, {})
        for _ in range(dut.latency_cycles - 1):
            assert not ctx.get(dut.o.valid)
            await ctx.tick()
        assert ctx.get(dut.o.valid)

    bench.run(play)


def test_reset_in_the_middle_of_a_frame_leaves_nothing_behind(planes: list[NDArray[np.uint16]]) -> None:
    dut = CellSelection(pattern=PATTERN, width_px=WIDTH_PX)
    bench = SelectionBench(dut, pauses=FREE, settings={"i_cell_log2": 5, "i_per_cell": 4})
    broken = list(events(planes[4], 32))

    async def play(ctx: Any) -> None:
        await bench.send(ctx, broken[: len(broken) // 2], cells=True)
        await bench.bench.pulse(ctx, bench.bench.reset)
        bench.received.clear()
        await bench.send(ctx, events(planes[0], 32), cells=True)
        await bench.drain(ctx, 1)

    bench.run(play)
    assert bench.received == golden(planes[0], 32, 4)


def test_impossible_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="width_px is 0; it must be a whole number from 1 on"):
        CellSelection(pattern=PATTERN, width_px=0)
    with pytest.raises(ValueError, match="in_flight is 16; it must be a whole number from 0 to 15"):
        RasterSelection(pattern=PATTERN, depth=16, in_flight=16)
