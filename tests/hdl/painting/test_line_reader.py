"""Pictures of the canvas beside a painter that works: none is torn, and each ends where it should."""

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.geometry.fixed_point import quantise
from golden_model.painting.line_reader import show
from tests.golden_model.painting.test_painter import integers
from tests.hdl.painting.test_painter import COLUMNS, ROWS, frame, homographies, start

BORDER = 0x123456


def check_pictures(pixels: NDArray[np.int64], states: list[NDArray[np.uint8]], lines: int, *, torn: bool) -> None:
    """Compare what a display has got with what was shown some time; with ``torn`` each tile by itself."""
    shape = (-1, lines, COLUMNS * 32)
    assert len(pixels) > 3 * np.prod(shape[1:])
    first, last = (pixels >> bit & 1 for bit in (24, 25))
    np.testing.assert_array_equal(np.flatnonzero(first), np.arange(0, len(pixels), lines * COLUMNS * 32))
    np.testing.assert_array_equal(np.flatnonzero(last), np.arange(COLUMNS * 32 - 1, len(pixels), COLUMNS * 32))
    shown = np.array([show(state, lines, BORDER) for state in states])
    parts = (
        [np.s_[:]]
        if not torn
        else [np.s_[y : y + 32, x : x + 32] for y, x in np.ndindex(lines, COLUMNS * 32) if y % 32 == x % 32 == 0]
    )
    for part in parts:
        known = {state[part].tobytes() for state in shown}
        seen = {picture[part].tobytes() for picture in (pixels & 0xFFFFFF).reshape(shape)}
        assert seen <= known


@pytest.mark.parametrize("reads", [30, pytest.param(5_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("replaces", [False, True], ids=["canvas", "stabilised"])
def test_what_is_held_is_whole_and_stays(replaces: bool, reads: int) -> None:
    """Read at random moments for random times: no tile is torn, and of stabilised video no page has two frames.

    Nor of the pictures on a display, which waits at random, too. A hold that lasts costs frames, which are counted; the
    poses go on.
    """
    bench, model = start(replaces=replaces)
    lines = 32 * ROWS - 9
    bench.set(pictures_valid=1, pictures_columns=COLUMNS, pictures_lines=lines, pictures_border=BORDER)
    bench.display(60)
    rng, shown, next_frame, snapshots = (
        np.random.default_rng(4),
        list[tuple[NDArray[np.uint8], NDArray[np.float64]]](),
        0,
        [],
    )
    for read in range(reads):
        row = int(rng.integers(ROWS))
        bench.set(holds_0_valid=1, holds_0_row=row)
        bench.run(2)
        while not bench.held:
            bench.run(50)
        part = bench.pages[bench.shown] if replaces else bench.pages[0, row]
        snapshots.append((row, part.copy()))
        bench.run(int(rng.integers(50_000 if read % 9 == 0 else 3_000)))
        np.testing.assert_array_equal(part, snapshots[-1][1])
        bench.set(holds_0_valid=0)
        for _ in range(int(rng.integers(3, 9))):
            if bench.cycle > next_frame:
                next_frame = bench.cycle + 12_000
                (H,) = homographies(1, seed=len(shown))
                shown.append((frame(len(shown)), H))
                bench.show(shown[-1][0])
                bench.place(quantise(H[np.newaxis])[0], len(shown))
            bench.run(int(rng.integers(1_500)))
    bench.set(pictures_valid=0)
    while not bench.is_idle or len(bench.pixels) % (lines * COLUMNS * 32):
        bench.run(30_000)
    states = [model.memory.copy()]
    for report in bench.reports:
        picture, H = shown[report.frame - 1]
        model.paint(picture, integers(H))
        states.append(model.memory.copy())
    np.testing.assert_array_equal(bench.pages, model.pages)
    assert bench.shown == model.shown
    pages = {state.tobytes() for state in states}
    tiles = {(row, n, state[row, n].tobytes()) for state in states for row, n in np.ndindex(ROWS, COLUMNS)}
    for row, part in snapshots:
        whole = (
            part.tobytes() in pages if replaces else {(row, n, tile.tobytes()) for n, tile in enumerate(part)} <= tiles
        )
        assert whole
    check_pictures(bench.pixels, states, lines, torn=not replaces)
    # Neither an empty canvas alone, nor nothing but what is painted.
    assert len({part.tobytes() for _, part in snapshots}) > 2
    events = bench.events
    given_up = events.get("unplaced", 0) + events.get("skipped", 0)
    assert given_up == len(shown) - len(bench.reports)
    # A refused pose leaves its frame without one; the last one's pose waits for a later frame.
    assert given_up - events.get("unmatched", 0) - events.get("refused", 0) in {0, 1}
    assert given_up > 0 or not replaces
    assert (bench.violations, bench.is_idle) == (0, True)


def test_a_picture_ends_where_it_should_whatever_stops() -> None:
    """The display in mid-line, the reader, a reset: no burst stays open, and what is not read is the border."""
    bench, _ = start()
    rng = np.random.default_rng(3)
    bench.pages[:] = rng.integers(0, 256, bench.pages.shape)
    for number in range(12):
        # After a reset the painter forgets its canvas.
        bench.run(20_000)
        columns, lines = int(rng.integers(1, 6)), int(rng.integers(1, 65))
        tiles = bench.pages.reshape(-1, 32, 32, 4)[: 2 * columns].reshape(2, columns, 32, 32, 4)
        expected, before = show(tiles, lines, BORDER).ravel(), len(bench.pixels)
        bench.set(stop=0, pictures_valid=1, pictures_columns=columns, pictures_lines=lines, pictures_border=BORDER)
        bench.display(int(rng.choice([0, 60, 200])))
        bench.run(int(rng.integers(1, 3 * len(expected))))
        bench.display(256)
        bench.run(3_000)
        assert bench.is_idle
        if number % 3 == 2:
            bench.set(pictures_valid=0)
            bench.reset()
            continue
        bench.set(stop=1)
        bench.run(9)
        bench.display(0)
        bench.run(len(expected) + 9)
        pixels = bench.pixels[before:]
        first, last = (np.flatnonzero(pixels >> bit & 1) for bit in (24, 25))
        assert first.tolist() == list(range(0, len(pixels), len(expected)))
        assert last.tolist() == list(range(32 * columns - 1, len(pixels), 32 * columns))
        *whole, cut = (pixels & 0xFFFFFF).reshape(-1, len(expected))
        assert all(np.array_equal(picture, expected) for picture in whole)
        left_out = np.cumsum(cut != expected) > 0
        assert (cut[left_out] == BORDER).all()
    assert bench.violations == 0
