"""A mosaic and stabilised video through the whole camera build in a simulation, with bad frames among the good ones.

    python -m bench.painter_live [--pictures FOLDER]

The exported drivers read the rings and set poses. For the mosaic, `Anchors` finds by the features where every tenth
frame lies, and the chip's homographies carry that on. For the video, the first frame is the reference of all others,
and nothing more is said. A frame without texture, one that breaks off and one with short lines are among the frames; at
the turns of the survey, frames leave the canvas. What the hardware says it has painted the golden model paints, too,
and every byte of the canvas is compared after each frame.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from bench.painter import RULES, fit_canvas, fly
from bench.pictures import save
from bench.report import JsonFile, Row, report
from bench.seams import CONFIG, invert
from golden_model.arrays import Matrix, Pixels
from golden_model.painting.painter import Painter
from golden_model.painting.pose import Placement, Poses, placement_of
from golden_model.painting.tiles import TILE_PX
from hdl.build import BUILDS
from hdl.settings import REQUESTED, matched_frame_settings
from sim.benches.camera import CameraBench, CameraTiming
from sim.benches.exported import host_programs
from sim.scene import make_lawnmower
from skymosaic.geometry.homography import apply
from skymosaic.mosaicking.live.anchors import Anchors

SIZE_PX, FRAMES, ANCHOR_EVERY = (320, 240), 60, 10
BUILD = dataclasses.replace(
    BUILDS["camera"], config=CONFIG, max_width_px=SIZE_PX[0], max_height_px=SIZE_PX[1], video_bits=24, painter=True
)
CAMERA = CameraTiming(line_blank=40, frame_blank=250_000, jitter=8, steps=99, period=100)
MISSING_PX = 288
"""The canvas ends so far before the end of the legs."""


def main(
    pictures: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None, json_file: JsonFile = None
) -> None:
    """Measure."""
    survey = make_lawnmower(7, FRAMES, SIZE_PX, forward_overlap=0.9, side_overlap=0.5, exposure_step=0)
    move, (columns, rows) = fit_canvas(survey)
    start = np.eye(3)
    # Anchors have the first frame's pixels.
    start[:2, 2] = move[:2, 2] + (0, MISSING_PX) - apply(invert(survey.homographies[0]), np.zeros((1, 2)))[0]
    mosaic, painted = run(spoil(survey.images), start, (columns, rows - MISSING_PX // TILE_PX), replace=False)
    images = spoil(fly(SIZE_PX, FRAMES, shake=1, speed_px=(0, 0)).images)
    video, stable = run(images, np.eye(3), (-(-SIZE_PX[0] // TILE_PX), -(-SIZE_PX[1] // TILE_PX)), replace=True)
    first, *others = stable.values()
    before = motion_px([images[n] for n in stable][1:], images[:1] * len(others))
    moved: Row = {"motion (px)": motion_px(others, [first] * len(others)), "of the camera": before}
    table: list[Row] = [{"painting": "mosaic of a survey", **mosaic, **dict.fromkeys(moved, "")}]
    table.append({"painting": "stabilised video", **video, **moved})
    report("The painter in the whole camera build", table, json_file)
    if pictures:
        pictures.mkdir(parents=True, exist_ok=True)
        save(pictures / "painter-mosaic.webp", [*painted.values()][-1])
        pairs = [np.vstack([images[n], stable[n][: SIZE_PX[1]]]) for n in [*stable][::15]]
        save(pictures / "painter-video.webp", np.hstack(pairs))


def spoil(views: Sequence[Pixels]) -> list[Pixels]:
    """Frames with bad ones among them: without texture, broken off, and with short lines."""
    images = [np.ascontiguousarray(each) for each in views]
    images[23] = np.full_like(images[23], 90)
    images[34], images[45] = images[34][: SIZE_PX[1] // 2], np.ascontiguousarray(images[45][:, : SIZE_PX[0] // 2])
    return images


def run(images: list[Pixels], start: Matrix, tiles: tuple[int, int], *, replace: bool) -> tuple[Row, dict[int, Pixels]]:
    """Run the build on frames; returns figures, and the canvas after each frame that was painted.

    The canvas lies on that of the anchors, or on the first frame, as ``start`` says.
    """
    settings = matched_frame_settings(CONFIG, *SIZE_PX, gray_input=False)
    requested = {name: settings[name] for name in (*REQUESTED, "gray_input")}
    bench = CameraBench(BUILD, length_bytes=1 << 24, camera=CAMERA, rules=RULES)
    with host_programs(BUILD) as load:
        rings = load("skymosaic_rings").RingReader(bench, requested, slots=8, hold_reference=replace)
        painter = load("skymosaic_painter").Painter(rings.registers, *tiles, replace=replace)
    painter.start()
    host, chip, model = Anchors(SIZE_PX, CONFIG), Poses(), Painter(*tiles, replace=replace)
    canvases, differing, refused = dict[int, Pixels](), 0, 0
    late: Matrix | None = None
    first: NDArray[np.int64] | None = None
    bench.show(*images)
    if replace and painter.place(0, start):
        first, _ = chip.place(placement_set(rings.registers))
    while (frame := rings.next_frame(0.1)) is not None:
        painter.follow(frame)
        number, placement = int(frame.homography["frame"]), placement_of(frame.homography)
        refused += placement is None
        pose = chip.place(placement)[0] if placement is not None else first if number == 0 else None
        if pose is not None and is_painted(rings.registers, number):
            model.paint(images[number], pose)
            differing += int(np.count_nonzero(painter.tiles != model.memory))
            canvases[number] = painter.picture()[..., :3].copy()
        # What the host knows of a frame comes when the next one is there.
        is_due = not canvases or number % ANCHOR_EVERY == 1
        if is_due and late is not None and painter.anchor(number - 1, invert(late) @ start):
            chip.place(placement_set(rings.registers))
        late = None if replace or not frame.good else host.add(number, frame.features)
        if number % ANCHOR_EVERY == ANCHOR_EVERY // 2:
            host.lay_out()
        rings.release()
    row: Row = {"frames": len(images), "homographies refused": refused, "painted": len(canvases)}
    row |= {"bytes unlike the model's": differing, "breaks of AXI's rules": bench.violations}
    return row, canvases


def motion_px(pictures: Sequence[Pixels], steady: Sequence[Pixels]) -> float:
    """How far the middle of stabilised frames lies from that of a steady camera's: 90th percentile."""
    height_px, width_px = steady[0].shape[:2]
    middle = np.s_[height_px // 4 : 3 * height_px // 4, width_px // 4 : 3 * width_px // 4]
    shifts = []
    for pair in zip(pictures, steady, strict=True):
        found, expected = (cv2.cvtColor(each, cv2.COLOR_BGR2GRAY)[middle].astype(np.float64) for each in pair)
        window = cv2.createHanningWindow(found.shape[::-1], cv2.CV_64F)
        shift, _ = cv2.phaseCorrelate(found, expected, window)
        shifts.append(np.hypot(*shift))
    return round(float(np.percentile(shifts, 90)), 2)


def is_painted(registers: Any, number: int) -> bool:
    """Wait until a frame is on the canvas; there are some that the painter loses."""
    for _ in range(15):
        if registers.read("frames_painted") and registers.read("frames_last") == number:
            return True
        registers.bus.wait(0)
    return False


def placement_set(registers: Any) -> Placement:
    """The pose that the host has set, as the registers have it."""
    words = [registers.read(f"pose_h{row}{column}") for row, column in np.ndindex(3, 3)]
    number = registers.read("pose_frame")
    return Placement(number, number, np.array(words, np.uint32).view(np.int32).reshape(3, 3), composed=False)


if __name__ == "__main__":
    typer.run(main)
