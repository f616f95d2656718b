# amaranth: UnusedElaboratable=no
"""Plans equal the golden model over several frames, and every tile that is dropped is counted for its reason."""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.painting.corners import CORNER
from golden_model.painting.windows import are_too_large, are_wide, bounding_boxes, can_win, cut_to_frame
from hdl.painting.windows import WindowPlanner
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.golden_model.painting import tilted
from tests.hdl.block_bench import BlockBench
from tests.hdl.painting.payloads import corner_payload

PLACE_BITS = 2
"""So few that memory is soon cleared."""
TILES = tilted.all_tiles(1 << PLACE_BITS)
SIZE = (153, 101)
CAUSES = ("o_behind", "o_too_large", "o_cannot_win")
BOX = ("left", "top", "right", "bottom")


@pytest.fixture(autouse=True)
def _small_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdl.painting.windows.PLACE_BITS", PLACE_BITS)


class Plan(NamedTuple):
    """A plan without its corners; a blank one without its box."""

    tile: int
    painted: bool
    blank: bool
    wide: bool
    box: list[int]


class Canvas:
    """What the planner should remember and answer."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.counts: Counter[str] = Counter()
        self.clear()

    def clear(self) -> None:
        self.least = np.zeros(len(TILES), int)
        self.painted = np.zeros(len(TILES), bool)

    def plan(self, corners: NDArray[np.int64], behind: NDArray[np.bool_], *, replace: bool) -> list[Plan]:
        boxes = bounding_boxes(corners)
        cut = cut_to_frame(boxes, *self.size)
        large, wins = are_too_large(boxes) & ~behind, can_win(boxes, *self.size, self.least)
        blank = behind | large | ~can_win(boxes, *self.size, np.zeros(len(boxes), int))
        dropped = (behind | large | ~wins) & (not replace)
        causes = (behind, large, dropped & ~behind & ~large)
        self.counts.update({name: int(each.sum()) for name, each in zip(CAUSES, causes, strict=True)})
        wide = are_wide(cut) & ~blank
        return [
            Plan(n, bool(self.painted[n]), bool(blank[n]), bool(wide[n]), [] if blank[n] else cut[n].tolist())
            for n in np.flatnonzero(~dropped).tolist()
        ]

    def paint(self, tile: int, least: int) -> bool:
        """Returns whether it is painted: as if the memory failed at each first painting with a least weight of 0."""
        self.least[tile] = least
        self.painted[tile] |= least > 0
        return bool(self.painted[tile])


def place(tile: NDArray[np.int64]) -> dict[str, int]:
    column, row = tile.tolist()
    return {"column": column, "row": row}


def poses(size: tuple[int, int]) -> list[NDArray[np.int64]]:
    """Corners of all tiles at some zooms and headings, one of them too large, and at the limits of the format."""
    seen = [
        tilted.corners(tilted.pose(size, zoom=zoom, turn=turn, tilt=tilt, tiles=1 << PLACE_BITS), TILES)
        for zoom, turn, tilt in ((1.2, 0.3, 0), (4.2, 0.0, 0), (2, 2.2, 4e-4), (0.7, 4.0, -8e-4), (1.2, 0.35, 0))
    ]
    seen[2][3, 1, 1, 0], seen[3][5, 2, 0, 1] = CORNER.max_raw, CORNER.min_raw
    seen[3][6:8] = np.array([CORNER.max_raw, CORNER.min_raw])[:, None, None, None]
    return seen


def run(
    dut: WindowPlanner, size: tuple[int, int], *, replace: bool = False, pauses: Pauses = NO_PAUSES, clears: int = -1
) -> tuple[list[Plan], list[Plan], Canvas, Counter[str]]:
    """Plans and expected plans of some frames, what is expected on the canvas, and the causes of dropped tiles."""
    rng = np.random.default_rng(size)
    canvas = Canvas(size)
    plans: list[Plan] = []
    expected: list[Plan] = []
    counts: Counter[str] = Counter()
    offered: list[list[dict[str, int]]] = []
    settings = {"i_width_px": size[0], "i_height_px": size[1], "i_replace": replace}
    bench = BlockBench(dut, settings=settings, pauses=pauses, cycle_limit=6000)

    async def send(ctx: Any) -> None:
        for number, corners in enumerate(poses(size)):
            if number == clears:
                await bench.pulse(ctx, dut.i_clear)
                canvas.clear()
            behind = rng.random(len(TILES)) < 0.1
            due = canvas.plan(corners, behind, replace=replace)
            expected.extend(due)
            offered[:] = [corner_payload(each) for each in corners]
            for tile, each, hidden in zip(TILES, offered, behind, strict=True):
                await bench.stream_put(ctx, dut.i, {"tile": place(tile), "corners": each, "behind": int(hidden)})
            # The tiles are painted in another order.
            for n in [plan.tile for plan in reversed(due)]:
                least = int(rng.choice([0, 1, 20, 40, 50, 255]))
                painted = canvas.paint(n, least)
                ctx.set(dut.i_painted, {"valid": 1, "tile": place(TILES[n]), "least": least, "painted": painted})
                await ctx.tick()
            ctx.set(dut.i_painted.valid, 0)

    async def receive(ctx: Any) -> None:
        while True:
            plan = await bench.stream_get(ctx, dut.o)
            tile = plan.tile.row << PLACE_BITS | plan.tile.column
            assert [{"x": each.x, "y": each.y} for each in plan.corners] == offered[tile]
            box = [] if plan.blank else [getattr(plan, side) for side in BOX]
            plans.append(Plan(tile, bool(plan.painted), bool(plan.blank), bool(plan.wide), box))

    async def count(ctx: Any) -> None:
        async for _, _, *pulses in ctx.tick().sample(*(getattr(dut, name) for name in CAUSES)):
            counts.update(dict(zip(CAUSES, pulses, strict=True)))

    bench.run(send, background=[receive, count])
    return plans, expected, canvas, counts


@pytest.mark.parametrize(("size", "replace"), [(SIZE, False), ((1100, 1031), True)], ids=["canvas", "replace"])
def test_plans_equal_the_golden_model_frame_after_frame(size: tuple[int, int], replace: bool) -> None:
    plans, expected, canvas, counts = run(WindowPlanner(), size, replace=replace)
    assert plans == expected
    assert counts == canvas.counts
    assert min(counts["o_behind"], counts["o_too_large"]) > 0
    assert bool(counts["o_cannot_win"]) != replace
    assert {True, False} == {plan.painted for plan in plans} == {plan.wide for plan in plans}
    # Stabilised video has a plan for every tile of every frame.
    assert {True, False} == {plan.blank for plan in plans} if replace else not any(plan.blank for plan in plans)
    assert len(plans) == 5 * len(TILES) or not replace


def test_plans_wait_and_a_clear_forgets_the_canvas() -> None:
    pauses = Pauses(gaps=120, stalls=180, seed=3)
    plans, expected, canvas, counts = run(WindowPlanner(), SIZE, pauses=pauses, clears=3)
    assert plans == expected
    assert counts == canvas.counts


def test_a_tile_takes_28_clocks_and_a_reset_in_any_phase_clears_the_canvas() -> None:
    dut = WindowPlanner()
    bench = BlockBench(dut, settings={"i_width_px": SIZE[0], "i_height_px": SIZE[1]}, cycle_limit=1500)
    corners = [corner_payload(each) for each in poses(SIZE)[0]]
    first, second = ({"tile": place(TILES[n]), "corners": corners[n], "behind": 0} for n in (5, 6))
    plans: list[Plan] = []
    clocks: list[int] = []

    async def take(ctx: Any) -> None:
        clocks.append(0)
        while not ctx.get(dut.o.valid):
            await ctx.tick()
            clocks[-1] += 1
        plan = await bench.stream_get(ctx, dut.o)
        tile = plan.tile.row << PLACE_BITS | plan.tile.column
        plans.append(Plan(tile, bool(plan.painted), bool(plan.blank), bool(plan.wide), []))

    async def run(ctx: Any) -> None:
        for clocks_before in (1, 4, 20, 40):
            ctx.set(dut.i.payload, first)
            ctx.set(dut.i.valid, 1)
            await ctx.tick().repeat(clocks_before)
            painted = {"valid": clocks_before > len(TILES), "tile": place(TILES[6]), "least": 200, "painted": 1}
            ctx.set(dut.i_painted, painted)
            await ctx.tick()
            ctx.set(dut.i_painted.valid, 0)
            await bench.pulse(ctx, bench.reset)
            await bench.wait_until_low(ctx, dut.o_clearing, at_most=len(TILES))
            for payload in (first, second):
                ctx.set(dut.i.payload, payload)
                await take(ctx)

    bench.run(run)
    assert plans == [Plan(n, painted=False, blank=False, wide=False, box=[]) for n in (5, 6)] * 4
    assert clocks == [dut.latency_cycles] * 8 == [27] * 8
