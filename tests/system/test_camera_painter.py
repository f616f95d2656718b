"""The camera build with its painter, through the exported drivers: what homographies and poses paint is the model's."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Pixels
from golden_model.config import EstimatorConfig
from golden_model.geometry.fixed_point import quantise
from golden_model.painting import painter as golden
from golden_model.painting.line_reader import show
from golden_model.painting.pose import Placement, Poses, placement_of
from golden_model.painting.tiles import TILE_PX
from hdl.build import BUILDS
from hdl.settings import REQUESTED, matched_frame_settings
from sim.benches.camera import CameraBench, CameraTiming
from sim.benches.exported import host_programs
from sim.benches.memory import MemoryRules
from sim.scene import make_pair

SIZE_PX, COLUMNS, ROWS, SLOTS = (128, 96), 8, 6, 4
CONFIG = dataclasses.replace(BUILDS["tiny"].config, estimator=EstimatorConfig(passes=4, min_cells=2, min_inliers=8))
BUILD = dataclasses.replace(BUILDS["tiny"], config=CONFIG, shell="camera", video_bits=24, painter=True)
THRESHOLD = 7000
"""As many corners as there is room for."""
PACE = CameraTiming(line_blank=20, frame_blank=30_000, jitter=9, steps=3, period=4)
"""Time enough to paint each frame before the next one."""
SLOW = MemoryRules(waits=43, latency_clocks=119, seed=4)
COUNTS = (
    *("frames_painted", "frames_last", "frames_cut", "frames_lost", "frames_skipped", "frames_unplaced"),
    *("pose_refused", "pose_unmatched", "pose_lost", "pose_ignored", "tiles_behind", "tiles_too_large", "tiles_failed"),
)
LINES, BORDER = 13, 0x123456
"""Few, so that a display keeps no page for long."""
START = np.array([[1, 0.02, -40], [-0.02, 1, -30], [0, 0, 1]])
"""From the canvas to the first frame."""
LATE = 2
"""The host learns where a frame lies when it has the record of a frame that comes so much later."""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def programs() -> Iterator[Any]:
    """The exported drivers, with the map of this build."""
    with host_programs(BUILD) as load:
        yield load


def views(count: int) -> list[Pixels]:
    """Views of a scene that move, in colour."""
    scene = make_pair(seed=9, size=(240, 140)).images[0]
    return [scene[2 * n : 2 * n + SIZE_PX[1], 5 * n : 5 * n + SIZE_PX[0]].copy() for n in range(count)]


class Host:
    """A host that sets the painter up, reads the rings, and has the golden model paint beside it."""

    def __init__(
        self, programs: Any, rules: MemoryRules, *, camera: CameraTiming = PACE, replace: bool = False
    ) -> None:
        self.bench = CameraBench(BUILD, length_bytes=1 << 21, camera=camera, rules=rules)
        settings = matched_frame_settings(CONFIG, *SIZE_PX, gray_input=False) | {"threshold_code": THRESHOLD}
        settings = {name: settings[name] for name in (*REQUESTED, "gray_input")} | vars(CONFIG.estimator)
        self.rings = programs("skymosaic_rings").RingReader(self.bench, settings, slots=SLOTS)
        self.registers, self.replace = self.rings.registers, replace
        options = {"replace": replace, "picture_lines": LINES, "picture_border": BORDER}
        self.painter = programs("skymosaic_painter").Painter(self.registers, COLUMNS, ROWS, **options)
        self.canvas = self.painter._canvas.reshape(-1, ROWS, COLUMNS, TILE_PX, TILE_PX, 4)
        self.begin()

    def begin(self) -> None:
        """With an empty canvas, and the pose of the first frame."""
        self.painter.start()
        self.model, self.poses = golden.Painter(COLUMNS, ROWS, replace=self.replace), Poses()
        self.frames: list[Pixels] = []
        (elements,) = quantise(START[np.newaxis])
        named = zip(np.ndindex(3, 3), elements.ravel().tolist(), strict=True)
        self.registers.write(**{f"pose_h{row}{column}": value & 0xFFFF_FFFF for (row, column), value in named})
        # It waits for the first frame, for which the driver would wait.
        self.registers.write(pose_frame=0, pose_set=1)
        self.first_pose, _ = self.poses.place(Placement(0, 0, elements, composed=False))

    def wait_for(self, field: str, value: int) -> None:
        for _ in range(100):
            if self.registers.read(field) == value:
                return
            self.bench.run(500)
        raise AssertionError(f"{field} does not become {value}")

    def anchor(self, frame: int, H: Any) -> None:
        """Say where a past frame lies; the model takes the pose that the driver sets."""
        assert self.painter.anchor(frame, H)
        words = [self.registers.read(f"pose_h{row}{column}") for row, column in np.ndindex(3, 3)]
        elements, number = np.array(words, np.uint32).view(np.int32).reshape(3, 3), self.registers.read("pose_frame")
        self.poses.place(Placement(number, number, elements, composed=False))

    def show(self, *frames: Pixels) -> None:
        self.frames += frames
        self.bench.show(*frames)

    def next_record(self) -> Any:
        frame = self.rings.next_frame(0.05)
        if frame is None:
            return None
        self.painter.follow(frame)
        record = frame.homography.copy()
        self.rings.release()
        return record

    def paint(self, frame: int, pose: Any) -> None:
        self.model.paint(self.frames[frame], pose)

    def fly(self, anchors: dict[int, Any]) -> int:
        """Read all records, and say where some lie; returns how many frames the model has painted."""
        self.paint(0, self.first_pose)
        count = 1
        while (record := self.next_record()) is not None:
            placement = placement_of(record)
            pose = self.poses.place(placement)[0] if placement is not None else None
            if pose is not None:
                self.paint(int(record["frame"]), pose)
                count += 1
            if (past := int(record["frame"]) - LATE) in anchors:
                self.anchor(past, anchors[past])
        self.bench.run(60_000)
        return count

    def counts(self) -> dict[str, int]:
        """All counts that are not 0."""
        found = {name: self.registers.read(name) for name in COUNTS}
        return {name: value for name, value in found.items() if value}


@pytest.mark.parametrize("replace", [False, True], ids=["canvas", "stabilised"])
def test_frames_are_painted_where_homographies_and_anchors_say(programs: Any, replace: bool) -> None:
    host = Host(programs, SLOW, replace=replace)
    host.show(*views(9))
    # An anchor that moves the canvas, which all later frames follow.
    moved = START @ np.array([[1, 0, 9.0], [0, 1, -4], [0, 0, 1]])
    assert host.fly({2: np.array([[1, 0, 10.0], [0, 1, 4], [0, 0, 1]]) @ moved}) == 9
    np.testing.assert_array_equal(host.canvas, host.model.pages)
    np.testing.assert_array_equal(host.painter.tiles, host.model.memory)
    # On a display, too: the last whole picture.
    picture_px = LINES * COLUMNS * TILE_PX
    host.bench.run(6 * picture_px)
    begun, pixels = host.registers.read("pictures_begun"), host.bench.pixels
    assert begun == -(-len(pixels) // picture_px) > 2
    assert (pixels >> 24 & 1).nonzero()[0].tolist() == list(range(0, len(pixels), picture_px))
    last = pixels[: len(pixels) // picture_px * picture_px][-picture_px:].reshape(LINES, -1)
    np.testing.assert_array_equal(last & 0xFFFFFF, show(host.model.memory, LINES, BORDER))
    assert (last >> 25).sum() == LINES == (last[:, -1] >> 25).sum()
    repeated = host.registers.read("pages_repeated")
    assert (repeated > 0, repeated <= begun) == (replace, True)
    # The frame on which the anchor was carried had been painted.
    assert host.counts() == {"frames_painted": 9, "frames_last": 8, "pose_unmatched": 1}
    assert (host.model.memory[..., 3] > 0).mean() > 0.2
    assert (host.bench.violations, host.registers.read("painter_errors")) == (0, 0)
    host.rings.close()
    assert host.bench.open_bursts == 0
    # A clear does not cut the picture.
    host.bench.run(2 * picture_px)
    pixels = host.bench.pixels
    assert (pixels >> 24 & 1).nonzero()[0].tolist() == list(range(0, len(pixels), picture_px))
    assert (len(pixels) % picture_px, host.bench.open_bursts) == (0, 0)
    host.bench.close()


def test_a_camera_that_is_unplugged_in_a_frame_holds_nothing_up(programs: Any) -> None:
    """The painter can be switched off and cleared, and a clear of everything ends, too."""
    host = Host(programs, MemoryRules())
    whole = views(3)
    host.show(whole[0])
    host.bench.show(whole[1][:40])
    host.bench.run(200_000)
    assert host.registers.read("painter_idle") == 0
    host.registers.write(painter_enable=0)
    host.wait_for("painter_idle", 1)
    assert host.counts() == {"frames_painted": 1, "frames_cut": 1}
    host.registers.write(painter_clear=1)
    host.wait_for("painter_clear", 0)
    host.registers.write(painter_enable=1)
    host.wait_for("painter_idle", 1)
    host.bench.show(whole[1][:40])
    host.bench.run(100_000)
    assert host.registers.read("painter_idle") == 0
    host.rings.close()
    assert host.bench.open_bursts == 0
    host.rings.restart()
    host.begin()
    # The camera's next frame cuts the last one off.
    host.show(*whole)
    assert host.fly({}) == 3
    np.testing.assert_array_equal(host.canvas, host.model.pages)
    assert host.bench.violations == 0
    host.bench.close()


def test_a_camera_too_fast_for_the_painter_loses_frames_that_are_counted(programs: Any) -> None:
    """Each frame is painted, skipped, given up or still waits; and what is painted is where it belongs."""
    host = Host(programs, SLOW, camera=dataclasses.replace(PACE, frame_blank=100))
    host.show(*views(12))
    painted: list[int] = []
    poses = {0: host.first_pose}
    while len(host.bench.last_pixels) < 12 or host.registers.read("homographies_written") > len(poses):
        host.bench.run(300)
        if host.registers.read("frames_painted") > len(painted):
            painted.append(host.registers.read("frames_last"))
        if host.registers.read("homographies_written") >= len(poses) and (record := host.next_record()) is not None:
            placement = placement_of(record)
            if placement is not None:
                poses[placement.frame], _ = host.poses.place(placement)
    for frame in painted:
        host.paint(frame, poses[frame])
    np.testing.assert_array_equal(host.canvas, host.model.pages)
    counts = host.counts()
    lost = sum(counts.get(f"frames_{name}", 0) for name in ("cut", "skipped", "unplaced"))
    admitted = host.registers.read("camera_frames") - host.registers.read("dropped")
    assert lost > 0
    assert counts["frames_painted"] == len(painted) > 2
    assert admitted - lost - len(painted) in {0, 1}
    assert host.bench.violations == 0
    host.bench.close()
