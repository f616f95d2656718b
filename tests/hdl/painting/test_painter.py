"""The whole painter, with a camera and a memory that waits, is late and fails: every byte is the model's.

It stands for tests of its parts, whose wrong lines it notices in samples: `tile_painter`, `corners`, `windows`,
`window_reader` and `canvas_port`.
"""

import itertools
from dataclasses import asdict, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.geometry.fixed_point import quantise
from golden_model.painting import painter as golden
from golden_model.painting.pose import Placement, Poses
from golden_model.painting.timing import painting_cycles
from sim.benches.memory import MemoryRules
from sim.benches.painter import PainterBench, Report
from tests.golden_model.painting import tilted
from tests.golden_model.painting.test_painter import integers

SIZE, COLUMNS, ROWS = (75, 58), 5, 4
LARGE = (170, 150)
"""It holds more than one wide window."""
SLOW = MemoryRules(waits=43, latency_clocks=119, seed=1)
FRAME_CLOCKS = 200_000
"""Limit."""


def frame(seed: int, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3)).astype(np.uint8)


def homographies(count: int, seed: int) -> list[NDArray[np.float64]]:
    """Any heading, zooms from 0.5 to 2, tilts up to a horizon in the frame, places on, across and off the canvas."""
    rng = np.random.default_rng(seed)
    result = []
    for n in range(count):
        zoom, tilt = 2 ** rng.uniform(-1, 1), rng.uniform(-1, 1) * rng.choice([0, 1e-4, 1.4e-2])
        H = tilted.pose(SIZE, zoom=zoom, turn=rng.uniform(0, 6.3), tilt=tilt, tiles=0)
        move = np.eye(3)
        move[:2, 2] = -rng.uniform(-40, (COLUMNS * 32 + 40, ROWS * 32 + 40)) - 5000 * (n % 9 == 8)
        result.append(H @ move)
    return result


def wide_looks() -> list[NDArray[np.float64]]:
    """`LARGE` frames in the middle of the canvas: tiles need up to 93 px of them."""
    looks = itertools.product((1.3, 1.7, 2.0), np.radians([0, 20, 45, 90]))
    return [tilted.pose(LARGE, zoom=zoom, turn=turn, tiles=4) for zoom, turn in looks]


def start(
    size: tuple[int, int] = SIZE, *, replaces: bool = False, rules: MemoryRules = SLOW
) -> tuple[PainterBench, golden.Painter]:
    """A bench whose canvas is clear, and a model."""
    bench = PainterBench(width_px=size[0], height_px=size[1], columns=COLUMNS, rows=ROWS, replace=replaces, rules=rules)
    bench.pages[:] = 0
    return bench, golden.Painter(COLUMNS, ROWS, replace=replaces)


def counted(report: Report) -> dict[str, int]:
    counts = asdict(report)
    del counts["cycle"], counts["frame"]
    return counts


def model_counts(counts: golden.Counts) -> dict[str, int]:
    return asdict(counts) | {"failed": 0, "has_errors": 0}


@pytest.mark.parametrize(("replaces", "count"), [(False, 27), (True, 12)], ids=["canvas", "stabilised"])
def test_every_byte_is_the_models(replaces: bool, count: int) -> None:
    bench, model = start(replaces=replaces)
    seen = dict.fromkeys(asdict(golden.Counts(0, 0, 0, 0, 0)), 0)
    for number, H in enumerate(homographies(count, seed=5), 1):
        picture = frame(number)
        bench.show(picture)
        bench.place(quantise(H[np.newaxis])[0], number)
        (report,) = bench.run(FRAME_CLOCKS, reports=number)
        expected = model.paint(picture, integers(H))
        assert (report.frame, counted(report)) == (number, model_counts(expected))
        np.testing.assert_array_equal(bench.pages, model.pages, f"frame {number}")
        seen = {name: count + seen[name] for name, count in asdict(expected).items()}
    # Every branch was taken.
    assert all(count > 0 for name, count in seen.items() if name != "cannot_win" or not replaces), seen
    assert (bench.violations, bench.errors, bench.events) == (0, 0, {})
    assert bench.is_idle


def test_clocks_are_as_predicted_where_memory_never_waits() -> None:
    """And more where it does, but never less."""
    poses = homographies(9, seed=5)
    for size, looks, replaces, rules in (
        *((SIZE, poses, replaces, MemoryRules()) for replaces in (False, True)),
        *((LARGE, wide_looks()[::5], replaces, MemoryRules()) for replaces in (False, True)),
        (SIZE, poses, False, SLOW),
    ):
        bench, model = start(size, replaces=replaces, rules=rules)
        for number, H in enumerate(looks, 1):
            bench.show(frame(number, size))
            while not bench.is_idle:
                bench.run(500)
            began = bench.cycle
            bench.place(quantise(H[np.newaxis])[0], number)
            (report,) = bench.run(FRAME_CLOCKS, reports=number)
            predicted = painting_cycles(model.plan(size, integers(H)), COLUMNS, ROWS)
            model.paint(frame(number, size), integers(H))
            assert report.cycle - began >= predicted
            assert rules == SLOW or report.cycle - began == predicted


@pytest.mark.parametrize("replaces", [False, True], ids=["canvas", "stabilised"])
def test_at_zooms_up_to_2_and_any_heading_no_tile_is_left_out(replaces: bool) -> None:
    """Wide windows and others in turns; the second of two frames comes while the first is painted."""
    bench, model = start(LARGE, replaces=replaces)
    poses = wide_looks()[::2]
    for number in range(1, len(poses), 2):
        pair = {n: poses[n - 1] for n in (number, number + 1)}
        for n, H in pair.items():
            bench.show(frame(n, LARGE))
            bench.place(quantise(H[np.newaxis])[0], n)
        for report, (n, H) in zip(bench.run(FRAME_CLOCKS, reports=number + 1), pair.items(), strict=True):
            expected = model.paint(frame(n, LARGE), integers(H))
            assert (report.frame, counted(report)) == (n, model_counts(expected))
            assert report.too_large == 0 < report.painted
        np.testing.assert_array_equal(bench.pages, model.pages, f"frame {number + 1}")
    assert (bench.violations, bench.errors, bench.events) == (0, 0, {})


def test_frames_and_poses_meet_by_their_numbers() -> None:
    bench, model = start()
    places = homographies(9, seed=6)
    elements = [quantise(H[np.newaxis])[0] for H in places]
    # A pose whose frame has passed, one for each of two frames, none for the third, one for the fourth.
    bench.place(elements[0], 0)
    for number in (1, 2, 4):
        bench.place(elements[number], number)
    for number in (1, 2, 3, 4):
        bench.show(frame(number))
        bench.run(30_000)
    assert [report.frame for report in bench.reports] == [1, 2, 4]
    for number in (1, 2, 4):
        model.paint(frame(number), integers(places[number]))
    np.testing.assert_array_equal(bench.canvas, model.memory)
    assert bench.events == {"unmatched": 1, "unplaced": 1}
    # Frames of another size and frames for which no pose comes: the camera is never made to wait.
    bench.show(frame(5)[:-3])
    for number in (6, 7, 8):
        bench.show(frame(number))
    bench.run(40_000)
    assert bench.events == {"unmatched": 1, "unplaced": 1, "cut": 2, "skipped": 1}
    assert bench.is_idle


def test_poses_are_composed_and_refused() -> None:
    bench, model = start()
    poses, small = Poses(max_links=2), np.eye(3)
    small[:2] = [[1.01, 0.02, 1.5], [-0.02, 1.01, -2.5]]
    step, singular = quantise(small[np.newaxis])[0], np.ones((3, 3), np.int32)
    anchor = quantise(tilted.pose(SIZE, zoom=1, turn=0.5, tiles=4)[np.newaxis])[0]
    bench.set(max_links=2)
    # One link, a pose that is none, a link behind it, one too many; and the host's again.
    sent = [(anchor, None), (step, 1), (singular, None), (step, 2), (step, 4), (anchor, None)]
    for number, (elements, reference) in enumerate(sent, 1):
        picture = frame(number)
        bench.show(picture)
        bench.place(elements, number, reference=reference)
        bench.run(40_000)
        pose, _ = poses.place(Placement(number, reference or 0, elements, composed=reference is not None))
        if pose is not None:
            model.paint(picture, pose)
    assert [report.frame for report in bench.reports] == [1, 2, 4, 6]
    assert bench.events == {"refused": 2, "unplaced": 2}
    np.testing.assert_array_equal(bench.canvas, model.memory)


@pytest.mark.parametrize("nowhere", [False, True], ids=["refused here", "refused by the estimator"])
def test_a_refused_pose_costs_its_own_frame_alone(nowhere: bool) -> None:
    """Also while another frame is painted: the one behind it finds the place in which the refused one waited free."""
    bench, model = start()
    places = homographies(4, seed=6)
    elements = [quantise(H[np.newaxis])[0] for H in places]
    for number in (1, 2, 3):
        bench.show(frame(number))
        if number != 2:
            bench.place(elements[number], number)
        elif nowhere:
            bench.set(nowhere_frame=2, nowhere_valid=1)
            bench.run(1)
            bench.set(nowhere_valid=0)
        else:
            bench.place(elements[2], 2, reference=77)
        bench.run(5_000)
    assert not bench.reports, "the first one is still being painted"
    bench.run(FRAME_CLOCKS, reports=2)
    assert [report.frame for report in bench.reports] == [1, 3]
    assert bench.events == {"unplaced": 1} | ({} if nowhere else {"refused": 1})
    for number in (1, 3):
        model.paint(frame(number), integers(places[number]))
    np.testing.assert_array_equal(bench.canvas, model.memory)


def test_a_page_that_memory_refused_is_not_shown() -> None:
    bench, model = start(replaces=True)
    for number, H in enumerate(homographies(3, seed=5), 1):
        bench.show(frame(number))
        bench.run(20_000)
        bench.follow(replace(SLOW, failures=12 if number == 2 else 0, seed=3))
        bench.place(quantise(H[np.newaxis])[0], number)
        (report,) = bench.run(FRAME_CLOCKS, reports=number)
        bench.follow(SLOW)
        bench.run(2)
        assert report.has_errors == (number == 2)
        if number != 2:
            model.paint(frame(number), integers(H))
        assert bench.shown == model.shown
        np.testing.assert_array_equal(bench.pages[bench.shown], model.memory)


def test_a_clear_forgets_the_canvas_and_the_poses() -> None:
    bench, _ = start()
    bench.set(max_links=9)
    places = homographies(3, seed=7)
    for number, H in enumerate(places, 1):
        if number == 3:
            bench.set(clear=1)
            bench.run(1)
            bench.set(clear=0)
            # What lies in memory does not matter any more.
            bench.canvas[:] = 77
            bench.place(np.eye(3, dtype=np.int32) << 23, number, reference=2)
        bench.show(frame(number))
        bench.place(quantise(H[np.newaxis])[0], number)
        bench.run(FRAME_CLOCKS, reports=number)
    fresh = golden.Painter(COLUMNS, ROWS)
    fresh.paint(frame(3), integers(places[2]))
    changed = (bench.canvas != 77).any(axis=(2, 3, 4))
    assert changed.any()
    np.testing.assert_array_equal(bench.canvas[changed], fresh.memory[changed])
    assert bench.events == {"refused": 1}


def test_switched_off_nothing_waits_and_poses_are_still_composed() -> None:
    bench, model = start()
    anchor = quantise(tilted.pose(SIZE, zoom=1, turn=0.5, tiles=4)[np.newaxis])[0]
    bench.set(max_links=2)
    # The first frame waits for its pose, and the camera stops in the second.
    bench.show(frame(1), frame(2)[:30])
    bench.run(20_000)
    was_idle = bench.is_idle
    bench.set(enable=0)
    bench.run(500)
    assert (was_idle, bench.is_idle) == (False, True)
    bench.place(anchor, 1)
    bench.place(np.eye(3, dtype=np.int32) << 23, 2, reference=1)
    bench.run(20_000)
    assert bench.events == {"cut": 1, "unmatched": 2}
    assert bench.is_idle
    bench.set(enable=1)
    bench.show(frame(3))
    bench.place(np.eye(3, dtype=np.int32) << 23, 3, reference=2)
    (report,) = bench.run(FRAME_CLOCKS, reports=1)
    poses = Poses()
    poses.place(Placement(1, 0, anchor, composed=False))
    for number in (2, 3):
        pose, _ = poses.place(Placement(number, number - 1, np.eye(3, dtype=np.int64) << 23, composed=True))
    assert pose is not None
    model.paint(frame(3), pose)
    assert report.frame == 3
    np.testing.assert_array_equal(bench.canvas, model.memory)


@pytest.mark.parametrize("wide", [False, True], ids=["narrow", "wide"])
def test_a_memory_that_fails_spoils_no_pixel(wide: bool) -> None:
    """What was not read or not written stays as it was; afterwards all is well."""
    size, place = (LARGE, wide_looks()[6]) if wide else (SIZE, homographies(1, seed=8)[0])
    bench, _ = start(size)
    # So many that some of the tiles fail: a wide window takes many more bursts.
    fails = replace(SLOW, failures=2 if wide else 12, seed=2)
    # One colour: whatever is painted of it, and however often, is that colour.
    level = np.full((size[1], size[0], 3), 90, np.uint8)
    elements = quantise(place[np.newaxis])[0]
    for number in range(1, 8):
        bench.show(level)
        bench.run(40_000)
        bench.follow(fails)
        bench.place(elements, number)
        bench.run(80_000, reports=number)
        bench.follow(SLOW)
    assert len(bench.reports) == 7
    assert any(report.failed for report in bench.reports)
    assert all(report.has_errors for report in bench.reports)
    painted = bench.canvas[..., 3] > 0
    assert painted.any()
    assert (bench.canvas[painted][:, :3] == 90).all()
    # A frame that could not be written is lost.
    bench.follow(fails)
    bench.show(level)
    bench.run(40_000)
    bench.follow(SLOW)
    assert bench.events == {"lost": 1}
    bench.show(level)
    bench.place(elements, 9)
    (report,) = bench.run(FRAME_CLOCKS, reports=8)
    model = golden.Painter(COLUMNS, ROWS)
    counts = model.paint(level, integers(place))
    assert (report.frame, report.offered, report.failed, report.has_errors) == (9, counts.offered, 0, 0)
    assert bench.violations == 0


@pytest.mark.parametrize(
    ("size", "first", "stops"),
    [(SIZE, homographies(1, seed=9)[0], (3_000, 18_500, 21_000)), (LARGE, wide_looks()[6], (36_000, 41_000, 46_500))],
    ids=["narrow", "wide"],
)
def test_a_reset_in_a_frame_leaves_nothing_behind(
    size: tuple[int, int], first: NDArray[np.float64], stops: tuple[int, ...]
) -> None:
    bench, model = start(size)
    second = homographies(2, seed=9)[1]
    for clocks in stops:
        bench.show(frame(1, size))
        bench.place(quantise(first[np.newaxis])[0], 1)
        bench.run(clocks)
        bench.reset()
    bench.canvas[:] = 0
    bench.show(frame(2, size))
    bench.place(quantise(second[np.newaxis])[0], 1)
    assert [report.frame for report in bench.run(FRAME_CLOCKS, reports=1)] == [1]
    model.paint(frame(2, size), integers(second))
    np.testing.assert_array_equal(bench.canvas, model.memory)
