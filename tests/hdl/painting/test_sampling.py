# amaranth: UnusedElaboratable=no
"""Colours and weights equal the golden model wherever a window lies, and while the other one is written."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.painting.positions import POSITION
from golden_model.painting.sampling import sample
from hdl.painting.sampling import Sampling
from sim.simulators.recording import NO_PAUSES, Pauses
from tests.hdl.block_bench import BlockBench
from tests.hdl.painting.payloads import pixel_row

COUNT = 80
BOXES = {
    # Size of the frame; left, top, right, bottom of the window.
    "a whole frame of odd size": ((45, 37), (0, 0, 44, 36)),
    "the largest width of two windows, across a multiple of 128": ((640, 480), (301, 237, 364, 278)),
    "a wide window at the right border": ((639, 480), (511, 187, 638, 199)),
    "the last corner of the largest frame": ((4096, 4096), (4063, 4070, 4095, 4095)),
    "the largest weights of 1080 lines": ((1920, 1080), (950, 530, 970, 550)),
    "a column at the right border": ((1031, 1100), (1029, 600, 1030, 640)),
}


def settings_of(size: tuple[int, int]) -> dict[str, int]:
    return {"i_width_px": size[0], "i_height_px": size[1]}


def draw(size: tuple[int, int], box: tuple[int, int, int, int], seed: int) -> tuple[Pixels, NDArray[np.int64]]:
    """The frame's pixels in the box, and positions in it and, beyond the border of the frame, around it."""
    rng = np.random.default_rng(seed)
    left, top, right, bottom = np.array(box)
    colours = rng.integers(0, 256, (bottom - top + 1, right - left + 1, 3), dtype=np.uint8)
    colours[rng.random(colours.shape) < 0.3] = 255
    colours[rng.random(colours.shape) < 0.3] = 0
    least = np.where([left == 0, top == 0], -5, [left, top])
    most = np.where([right == size[0] - 1, bottom == size[1] - 1], [right + 5, bottom + 5], [right, bottom])
    at = rng.integers(least * POSITION.one, most * POSITION.one, (COUNT, 2))
    # Whole pixels and the last step before the next one.
    at[::4] &= -POSITION.one
    at[1::4] |= POSITION.one - 1
    return colours, at


def expected(size: tuple[int, int], box: tuple[int, int, int, int], colours: Pixels, at: NDArray[np.int64]) -> Any:
    """Colours and weights of the golden model; of the frame only the pixels in the box are made."""
    left, top, right, bottom = box
    frame = np.lib.stride_tricks.as_strided(np.zeros(3, np.uint8), (size[1], size[0], 3), (0, 0, 1))
    _, weights = sample(frame, at)
    part = np.zeros((size[1], right - left + 3, 3), np.uint8)
    part[top : bottom + 1, : right - left + 1] = colours
    inside, _ = sample(part, at - (left * POSITION.one, 0))
    return np.where(weights[:, None] > 0, inside, 0), weights


def is_wide(box: tuple[int, int, int, int]) -> bool:
    return box[2] - box[0] >= 64


async def write(ctx: Any, port: Any, window: int, box: tuple[int, int, int, int], colours: Pixels) -> None:
    """Write a box in words of two pixels, as they come from memory."""
    left, top, right, bottom = box
    wide = is_wide(box)
    ctx.set(port.valid, 1)
    for y in range(top, bottom + 1):
        for x in range(left & ~1, right + 1, 2):
            kept = [int(left <= each <= right) for each in (x, x + 1)]
            pair = [
                colours[y - top, each - left].tolist() if left <= each <= right else [170] * 3 for each in (x, x + 1)
            ]
            column = x // 2 % 64 if wide else x // 2 % 32 + 32 * window
            ctx.set(port, {"valid": 1, "y": y % 128, "x": column, "pixels": pair, "kept": kept})
            await ctx.tick()
    ctx.set(port.valid, 0)


async def put(
    ctx: Any, bench: BlockBench, window: int, at: NDArray[np.int64], *, wide: bool = False, blank: bool = False
) -> None:
    for x, y in at.tolist():
        await bench.stream_put(ctx, bench.dut.i, {"x": x, "y": y, "window": window, "wide": wide, "blank": blank})


async def get(ctx: Any, bench: BlockBench, results: list[list[int]], count: int) -> None:
    for _ in range(count):
        results.append(pixel_row(await bench.stream_get(ctx, bench.dut.o)))


def assert_equal(results: list[list[int]], colours: NDArray[np.int64], weights: NDArray[np.int64]) -> None:
    received = np.array(results)
    np.testing.assert_array_equal(received[:, 3], weights)
    np.testing.assert_array_equal(received[weights > 0, :3], colours[weights > 0])


@pytest.mark.parametrize(
    ("name", "pauses"),
    [*((name, NO_PAUSES) for name in BOXES), ("a whole frame of odd size", Pauses(gaps=100, stalls=140, seed=9))],
)
def test_pixels_equal_the_golden_model(name: str, pauses: Pauses) -> None:
    size, box = BOXES[name]
    colours, at = draw(size, box, seed=len(name))
    dut = Sampling()
    bench = BlockBench(dut, settings=settings_of(size), pauses=pauses, cycle_limit=10_000)
    results: list[list[int]] = []

    async def send(ctx: Any) -> None:
        await write(ctx, dut.i_write, 1, box, colours)
        await put(ctx, bench, 1, at, wide=is_wide(box))

    async def receive(ctx: Any) -> None:
        await get(ctx, bench, results, COUNT)

    bench.run(send, receive)
    assert_equal(results, *expected(size, box, colours, at))
    assert {bool(weight) for *_, weight in results} == {True, False} or name.startswith("the largest")


def test_blank_positions_weigh_nothing_and_a_reset_forgets_what_is_under_way() -> None:
    size, box = BOXES["a whole frame of odd size"]
    colours, at = draw(size, box, seed=4)
    dut = Sampling()
    bench = BlockBench(dut, settings=settings_of(size), cycle_limit=3000)
    blank: list[list[int]] = []
    results: list[list[int]] = []

    async def run(ctx: Any) -> None:
        await write(ctx, dut.i_write, 0, box, colours)
        await put(ctx, bench, 0, at[:10], blank=True)
        await get(ctx, bench, blank, 10)
        for count in (1, 6, 14):
            await put(ctx, bench, 0, at[:count])
            await bench.pulse(ctx, bench.reset)
            await put(ctx, bench, 0, at[20:26])
            await get(ctx, bench, results, 6)

    bench.run(run)
    assert not any(weight for *_, weight in blank)
    for n in range(3):
        after = (each[20:26] for each in expected(size, box, colours, at))
        assert_equal(results[6 * n : 6 * n + 6], *after)
