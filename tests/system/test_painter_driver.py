"""The exported driver of the painter over the whole simulated build: past frames are anchors of later ones."""

from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from golden_model.geometry.fixed_point import quantise
from golden_model.painting import painter as golden
from golden_model.painting.pose import Placement, Poses, placement_of
from hdl.settings import REQUESTED, matched_frame_settings
from sim.benches.camera import CameraBench
from sim.benches.exported import host_programs
from tests.system.test_camera_painter import BUILD, COLUMNS, CONFIG, PACE, ROWS, SIZE_PX, SLOTS, SLOW, THRESHOLD, views

FRAMES = 9
ANCHORS, LATE = {1, 4}, 2
"""The host learns where these frames lie when it has the record of a frame that comes so much later."""

pytestmark = pytest.mark.slow


def pose_of(number: int) -> Array:
    """Where a view lies on a canvas that shows the scene turned a little."""
    return np.array([[1, 0.02, -20 - 5 * number], [-0.02, 1, 6 - 2 * number], [0, 0, 1]])


def start(columns: int, rows: int, **options: Any) -> tuple[CameraBench, Any, Any]:
    """A build that is on, its rings and its painter."""
    bench = CameraBench(BUILD, length_bytes=1 << 21, camera=PACE, rules=SLOW)
    settings = matched_frame_settings(CONFIG, *SIZE_PX, gray_input=False) | {"threshold_code": THRESHOLD}
    with host_programs(BUILD) as load:
        requested = {name: settings[name] for name in (*REQUESTED, "gray_input")} | vars(CONFIG.estimator)
        rings = load("skymosaic_rings").RingReader(bench, requested, slots=SLOTS)
        painter = load("skymosaic_painter").Painter(rings.registers, columns, rows, **options)
    painter.start()
    bench.show(*views(FRAMES))
    return bench, rings, painter


def placement_set(registers: Any) -> Placement:
    """What the host has set last."""
    words = [registers.read(f"pose_h{row}{column}") for row, column in np.ndindex(3, 3)]
    elements, number = np.array(words, np.uint32).view(np.int32).reshape(3, 3), registers.read("pose_frame")
    return Placement(number, number, elements, composed=False)


def test_steady_video_is_painted_where_the_path_says() -> None:
    """Frame by frame, and without a black border."""
    bench, rings, painter = start(3, 2, steady={"crop": 0.3})
    model, images, shown = golden.Painter(3, 2, replace=True), views(FRAMES), 0
    while (frame := rings.next_frame(0.05)) is not None:
        painter.follow(frame)
        number = int(frame.homography["frame"])
        rings.release()
        if frame.homography["causes"]:
            continue
        bench.run(40_000)
        pose, _ = Poses().place(placement_set(rings.registers))
        assert pose is not None
        model.paint(images[number], pose)
        np.testing.assert_array_equal(painter.tiles, model.memory, err_msg=str(number))
        assert painter.picture()[..., 3].all()
        shown += 1
    assert shown == painter.counts()["frames_painted"] == FRAMES - 1
    painter.close()
    assert (bench.violations, bench.open_bursts) == (0, 0)
    bench.close()


def test_the_canvas_is_that_of_the_anchors() -> None:
    images = views(FRAMES)
    bench, rings, painter = start(COLUMNS, ROWS)
    poses, model, counted = Poses(), golden.Painter(COLUMNS, ROWS), []
    while (frame := rings.next_frame(0.05)) is not None:
        painter.follow(frame)
        number, found = int(frame.homography["frame"]), placement_of(frame.homography)
        pose = None if found is None else poses.place(found)[0]
        if pose is not None:
            model.paint(images[number], pose)
        rings.release()
        if number - LATE in ANCHORS:
            counted.append(painter.anchor(number - LATE, pose_of(number - LATE)))
            placement = placement_set(rings.registers)
            # Links of the chip have carried it on: they are exact to a fraction of a pixel.
            assert np.abs(placement.elements - quantise(pose_of(number)[np.newaxis])[0]).max() < 100
            placed, _ = poses.place(placement)
            # A frame without a pose of the chip's has waited for this one.
            if pose is None and placed is not None:
                model.paint(images[number], placed)
    assert counted == [True, True]
    assert painter.counts()["frames_painted"] == FRAMES - (min(ANCHORS) + LATE)
    np.testing.assert_array_equal(painter.tiles, model.memory)
    assert (painter.picture()[..., 3] > 0).mean() > 0.2
    painter.close()
    rings.close()
    assert (bench.violations, bench.open_bursts) == (0, 0)
    bench.close()
