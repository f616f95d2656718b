"""The whole camera build in simulation: a flight through it, and what it paints, beside the golden model.

    python -m bench.camera flight [--frames 100] [--size 1280x720] [--seed N]
    python -m bench.camera paint [--pictures FOLDER]
    python -m bench.camera steady [--pictures FOLDER]

A camera has its own clock, memory has random latency and back-pressure, and the exported drivers read the rings.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from bench.painter import CONFIG, RULES, fit_canvas, fly_straight, invert
from bench.report import Row, program, reported
from golden_model.arrays import Matrix, Pixels, Records
from golden_model.front_end import extract
from golden_model.geometry.estimator import MAX_CYCLES
from golden_model.painting.painter import Painter
from golden_model.painting.pose import Placement, Poses, placement_of
from golden_model.painting.tiles import TILE_PX
from golden_model.timing import FrameWork, steady_pace
from hdl.build import BUILDS, Build
from hdl.settings import REQUESTED, matched_frame_settings
from sim.backends.golden import add_matches
from sim.benches.camera import CameraBench, CameraTiming
from sim.benches.exported import host_programs
from sim.benches.memory import MemoryRules
from sim.scene import make_lawnmower
from skymosaic.geometry.fabric import homography_in_pixels, in_pixels
from skymosaic.geometry.homography import apply
from skymosaic.mosaicking.live.anchors import Anchors
from tools.pictures import save

app = program(__doc__)

SLOTS = 8
PAUSE_EVERY, PAUSE_FRAMES = 25, 9
"""After each `PAUSE_EVERY` frames the host stops reading for `PAUSE_FRAMES`, more than the ring holds."""
FRAME_BLANK_LINES = 20
WAIT_S_PER_CLOCK = 1e-7
"""A wait of the reader, 2 ms, lets the simulation run for 20,000 clocks."""
PAINTED_PX, PAINTED_FRAMES, ANCHOR_EVERY = (320, 240), 60, 10
"""Size and number of the painted frames, and how many of them there are for each anchor."""
PAINTING_BUILD = dataclasses.replace(
    BUILDS["camera"],
    config=CONFIG,
    max_width_px=PAINTED_PX[0],
    max_height_px=PAINTED_PX[1],
    video_bits=24,
    painter=True,
)
PAINTING_CAMERA = CameraTiming(line_blank=40, frame_blank=250_000, jitter=8, steps=99, period=100)
STEADY_FRAMES, SHAKE = 240, 0.5
MISSING_PX = 288
"""The canvas ends so far before the end of the legs."""


@app.command()
@reported("camera build")
def flight(
    frames: Annotated[int, typer.Option(min=2, help="Length of the flight.")] = 100,
    size: Annotated[str, typer.Option(help="Of the frames.")] = "1280x720",
    seed: Annotated[int, typer.Option(help="Of flight and memory.")] = 1,
) -> Iterator[Row]:
    """What becomes of the frames of a rendered flight.

    From time to time the host pauses. Every frame that is delivered, its homography included, is compared with the
    golden model; every other frame has to be counted as dropped. Latency is from a frame's last pixel at the camera to
    the end of a header in memory.
    """
    width_px, height_px = map(int, size.split("x"))
    images = make_lawnmower(seed, frames, (width_px, height_px), forward_overlap=0.9).images
    gray = [cv2.cvtColor(images[n], cv2.COLOR_BGR2GRAY) for n in track(range(frames), "rendering", transient=True)]
    figures = fly(gray, (width_px, height_px), seed)
    for name, figure in figures.items():
        yield {f"{frames} frames of {width_px}×{height_px}": name, "measured": figure}


def fly(frames: list[Pixels], size_px: tuple[int, int], seed: int) -> dict[str, int]:
    """Send a flight through the camera build, and compare what is delivered."""
    width_px, height_px = size_px
    settings = matched_frame_settings(CONFIG, *size_px, gray_input=True)
    build = dataclasses.replace(
        BUILDS["camera"], config=CONFIG, max_width_px=width_px, max_height_px=height_px, video_bits=8
    )
    # Small frames come less often: each is matched, and its homography estimated, before the next one is.
    frame_blank = max(FRAME_BLANK_LINES * width_px, slowest_pace(size_px, build) - width_px * height_px)
    # The camera's clock has 99 edges per 100 of the design: 148.5 of 150 MHz, that of 1080p60.
    camera = CameraTiming(line_blank=width_px // 8, frame_blank=frame_blank, jitter=8, steps=99, period=100)
    rules = MemoryRules(waits=40, latency_clocks=120, seed=seed)
    bench = CameraBench(build, length_bytes=1 << 22, camera=camera, rules=rules, progress=Console().print)
    with host_programs(build) as load:
        requested = {name: settings[name] for name in (*REQUESTED, "gray_input")}
        rings = load("skymosaic_rings").RingReader(bench, requested, slots=SLOTS)
    bench.show(*frames)
    frame_clocks = (width_px + camera.line_blank) * height_px + frame_blank
    # Until the slowest homography is there, in the time of the bench's `wait`.
    patience_s = WAIT_S_PER_CLOCK * (2.5 * frame_clocks + MAX_CYCLES)
    delivered: list[Any] = []
    latencies = []
    while (frame := rings.next_frame(patience_s)) is not None:
        assert frame.good
        delivered.append((frame.number, frame.features.copy(), frame.matches.copy(), frame.homography.copy()))
        waited = frame.time - bench.last_pixels[frame.number - 1]
        latencies.append((waited + frame.clocks, waited + frame.homography_clocks))
        rings.release()
        if len(delivered) % PAUSE_EVERY == 0:
            bench.run(PAUSE_FRAMES * frame_clocks)
    counts = rings.counts()
    to_matches, to_homography = np.array(latencies).T
    return {
        "frames sent": counts["camera_frames"],
        "delivered": len(delivered),
        "of these, equal to the golden model in every record": count_equal(frames, delivered),
        "reported as dropped": counts["dropped"],
        "really missing": len(frames) - len({number for number, *_ in delivered}),
        "features per frame": round(np.mean([len(features) for _, features, *_ in delivered])),
        "the chip's homographies, accepted": sum(int(homography["causes"] == 0) for *_, homography in delivered),
        "the chip's homographies, lost": rings.registers.read("lost_homographies"),
        "last pixel to last match in memory, clocks (median)": int(np.median(to_matches)),
        "last pixel to last match in memory, clocks (longest)": int(to_matches.max()),
        "last pixel to homography in memory, clocks (median)": int(np.median(to_homography)),
        "last pixel to homography in memory, clocks (longest)": int(to_homography.max()),
        "AXI rules broken": bench.violations,
        "clocks simulated": bench.cycle,
    }


def slowest_pace(size_px: tuple[int, int], build: Build) -> int:
    """Clocks from one frame to the next if all features match and every homography takes its longest."""
    most = CONFIG.front_end.max_features
    work = FrameWork(*size_px, good=True, left=most, right=most, rows=np.arange(most), estimate_cycles=MAX_CYCLES)
    pace = steady_pace(work, CONFIG, lanes=build.lanes)
    assert pace is not None
    return pace[0]


def count_equal(frames: list[Pixels], delivered: list[tuple[int, Records, Records, np.void]]) -> int:
    """How many frames have the golden model's features, matches and homography."""
    front_end = CONFIG.front_end.for_size(*frames[0].shape[::-1])
    golden = (extract(frames[number - 1], front_end, frame=n) for n, (number, *_) in enumerate(delivered))
    expected = add_matches(golden, CONFIG, "previous")
    return sum(
        np.array_equal(features, one.features)
        and np.array_equal(matches, one.matches)
        and bool(homography == one.homography)
        for (_, features, matches, homography), one in zip(delivered, expected, strict=True)
    )


@app.command()
@reported("The painter in the whole camera build")
def paint(pictures: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None) -> Iterator[Row]:
    """A mosaic and stabilised video, with bad frames among the good ones.

    For the mosaic, `Anchors` finds by the features where every tenth frame lies, and the chip's homographies carry that
    on. For the video, the first frame is the reference of all others, and nothing more is said. A frame without
    texture, one that breaks off and one with short lines are among the frames; at the turns of the survey, frames leave
    the canvas. What the hardware says it has painted the golden model paints, too, and every byte of the canvas is
    compared after each frame.
    """
    survey = make_lawnmower(7, PAINTED_FRAMES, PAINTED_PX, forward_overlap=0.9, side_overlap=0.5, exposure_step=0)
    move, (columns, rows) = fit_canvas(survey)
    start = np.eye(3)
    # Anchors have the first frame's pixels.
    start[:2, 2] = move[:2, 2] + (0, MISSING_PX) - apply(invert(survey.homographies[0]), np.zeros((1, 2)))[0]
    mosaic, painted = paint_frames(spoil(survey.images), start, (columns, rows - MISSING_PX // TILE_PX), replace=False)
    images = spoil(fly_straight(PAINTED_PX, PAINTED_FRAMES, speed_px=(0, 0)).images)
    video, stable = paint_frames(
        images, np.eye(3), (-(-PAINTED_PX[0] // TILE_PX), -(-PAINTED_PX[1] // TILE_PX)), replace=True
    )
    first, *others = stable.values()
    before = motion_px([images[n] for n in stable][1:], images[:1] * len(others))
    moved: Row = {"motion (px)": motion_px(others, [first] * len(others)), "of the camera": before}
    yield {"painting": "mosaic of a survey", **mosaic, **dict.fromkeys(moved, "")}
    yield {"painting": "stabilised video", **video, **moved}
    if pictures:
        pictures.mkdir(parents=True, exist_ok=True)
        save(pictures / "painter-mosaic.webp", [*painted.values()][-1])
        pairs = [np.vstack([images[n], stable[n][: PAINTED_PX[1]]]) for n in [*stable][::15]]
        save(pictures / "painter-video.webp", np.hstack(pairs))


def spoil(views: Sequence[Pixels]) -> list[Pixels]:
    """Frames with bad ones among them: without texture, broken off, and with short lines."""
    images = [np.ascontiguousarray(each) for each in views]
    images[23] = np.full_like(images[23], 90)
    images[34], images[45] = images[34][: PAINTED_PX[1] // 2], np.ascontiguousarray(images[45][:, : PAINTED_PX[0] // 2])
    return images


def paint_frames(
    images: list[Pixels], origin: Matrix, tiles: tuple[int, int], *, replace: bool
) -> tuple[Row, dict[int, Pixels]]:
    """Run the build on frames; returns figures, and the canvas after each frame that was painted.

    The canvas lies on that of the anchors, or on the first frame, as ``origin`` says.
    """
    bench, rings, painter = start(tiles, hold_reference=replace, replace=replace)
    host, chip, model = Anchors(PAINTED_PX, CONFIG), Poses(), Painter(*tiles, replace=replace)
    canvases, differing, refused = dict[int, Pixels](), 0, 0
    late: Matrix | None = None
    first: NDArray[np.int64] | None = None
    bench.show(*images)
    if replace and painter.place(0, origin):
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
        if is_due and late is not None and painter.anchor(number - 1, invert(late) @ origin):
            chip.place(placement_set(rings.registers))
        late = None if replace or not frame.good else host.add(number, frame.features)
        if number % ANCHOR_EVERY == ANCHOR_EVERY // 2:
            host.lay_out()
        rings.release()
    row: Row = {"frames": len(images), "homographies refused": refused, "painted": len(canvases)}
    row |= {"bytes unlike the model's": differing, "breaks of AXI's rules": bench.violations}
    return row, canvases


def start(tiles: tuple[int, int], *, hold_reference: bool, **options: Any) -> tuple[CameraBench, Any, Any]:
    """Switch a simulated build on; its rings and its painter."""
    settings = matched_frame_settings(CONFIG, *PAINTED_PX, gray_input=False)
    requested = {name: settings[name] for name in (*REQUESTED, "gray_input")}
    bench = CameraBench(PAINTING_BUILD, length_bytes=1 << 24, camera=PAINTING_CAMERA, rules=RULES)
    with host_programs(PAINTING_BUILD) as load:
        rings = load("skymosaic_rings").RingReader(bench, requested, slots=8, hold_reference=hold_reference)
        painter = load("skymosaic_painter").Painter(rings.registers, *tiles, **options)
    painter.start()
    return bench, rings, painter


@app.command()
@reported("Steady video in the whole camera build")
def steady(pictures: Annotated[Path | None, typer.Option(help="Folder for a picture.")] = None) -> Iterator[Row]:
    """What a camera sees that flies on while the wind shakes it, shown along the smooth path of the driver.

    Every byte is compared as by ``paint``. How the ground really moves in the pictures, at their corners and by the
    camera's true poses, is held against how the path says it does. A jerk is by how much that motion changes from
    frame to frame.
    """
    flight = fly_straight(PAINTED_PX, STEADY_FRAMES, shake=SHAKE)
    tiles = PAINTED_PX[0] // TILE_PX, PAINTED_PX[1] // TILE_PX
    row, shown, poses, links = paint_path(list(flight.images), tiles)
    right, low = np.multiply(tiles, TILE_PX) - 1
    corners = np.array([[0, 0], [right, 0], [right, low], [0, low]])
    on_ground = {n: invert(flight.homographies[n]) for n in poses}

    def motions(poses: dict[int, Matrix]) -> NDArray[np.float64]:
        views = [on_ground[n] @ pose for n, pose in poses.items()]
        return np.array([apply(invert(before) @ after, corners) for before, after in pairwise(views)])

    moved = motions(poses)
    told = [apply(invert(links[b] @ poses[a]) @ poses[b], corners) for a, b in pairwise(poses)]
    row |= {"beside the path, 90th percentile (px)": percentile(90, moved - told)}
    row |= {"jerk, median (px)": percentile(50, np.diff(moved, axis=0))}
    unmoved = dict.fromkeys(poses, next(iter(poses.values())))
    row |= {"jerk of the camera": percentile(50, np.diff(motions(unmoved), axis=0))}
    yield row | {"pixels without a picture": sum(int((each[..., 3] == 0).sum()) for each in shown.values())}
    if pictures:
        pictures.mkdir(parents=True, exist_ok=True)
        pairs = [np.vstack([flight.images[n], shown[n][..., :3]]) for n in list(shown)[-4:]]
        save(pictures / "painter-steady.webp", np.hstack(pairs))


def percentile(share: float, differences: NDArray[np.float64]) -> float:
    """A percentile of lengths."""
    return round(float(np.percentile(np.linalg.norm(differences, axis=-1), share)), 2)


def paint_path(
    images: list[Pixels], tiles: tuple[int, int]
) -> tuple[Row, dict[int, Pixels], dict[int, Matrix], dict[int, Matrix]]:
    """Run the build on frames, with the driver's path; figures, and each frame's picture, pose and homography."""
    bench, rings, painter = start(tiles, hold_reference=False, steady={})
    chip, model = Poses(), Painter(*tiles, replace=True)
    shown, poses, links, differing = dict[int, Pixels](), dict[int, Matrix](), dict[int, Matrix](), 0
    bench.show(*images)
    while (frame := rings.next_frame(0.1)) is not None:
        painter.follow(frame)
        number, link = int(frame.homography["frame"]), homography_in_pixels(frame.homography)
        rings.release()
        if link is None or not is_painted(rings.registers, number):
            continue
        placement = placement_set(rings.registers)
        pose, _ = chip.place(placement)
        assert pose is not None
        model.paint(images[number], pose)
        differing += int(np.count_nonzero(painter.tiles != model.memory))
        shown[number] = painter.picture()
        poses[number], links[number] = in_pixels(placement.elements), link
    row: Row = {"frames": len(images), "painted": len(shown), "bytes unlike the model's": differing}
    return row | {"breaks of AXI's rules": bench.violations}, shown, poses, links


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
    app()
