"""The painter: how many frames per second it keeps in a simulation, and the seams of what it would paint.

python -m bench.painter speed
python -m bench.painter seams
"""

import dataclasses
import math
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from bench.report import Row, program, reported
from golden_model.arrays import Array, Matrix, Pixels
from golden_model.config import PRESETS, EstimatorConfig
from golden_model.front_end import extract
from golden_model.geometry.fixed_point import quantise
from golden_model.painting.painter import Painter
from golden_model.painting.pose import Placement, Poses, placement_of
from golden_model.painting.tiles import TILE_PX
from golden_model.painting.timing import painting_cycles
from hdl.painting.frame_writer import BUFFERS, frame_pages
from hdl.settings import PAGE_BYTES
from sim.backends.golden import add_matches
from sim.backends.interface import FrameResult
from sim.benches.memory import MemoryRules
from sim.benches.painter import PainterBench
from sim.scene import Camera, Flight, Photometry, make_lawnmower
from sim.scene.camera import poses_along
from skymosaic.geometry.fabric import in_pixels
from skymosaic.geometry.homography import apply
from skymosaic.mosaicking.live.anchors import Anchors

app = program(__doc__)

RULES = MemoryRules(waits=43, latency_clocks=119, seed=1)
CLOCK_MHZ = 150
MAX_CLOCKS = 10_000_000
SPEED_PX = (30.0, 18.0)
"""How far the camera flies over the ground between two frames."""
PEAK_MB_PER_S = {16: 2 * 1050, 32: 4 * 1066}
USABLE = 0.5
VIDEOS = {(640, 480): 60, (1280, 720): 60, (1920, 1080): 30}
"""Frames per second of a camera, by its size."""
HEADINGS_DEG = (0, 30, 45)
FRAMES = 3
WORD_BYTES, WORD_PX = 8, 2
SURVEY_FRAMES, SURVEY_PX = 240, (640, 480)
CONFIG = dataclasses.replace(PRESETS["aerial"], estimator=EstimatorConfig())
LAYOUT_EVERY = 10
LAYOUT_FRAMES = 5
"""Frames that come during a layout: at 1.4 per second, as such a flight at 10 m/s needs them, it takes 3.5 s."""
DELAY = 1
"""Frames that come while the host places one."""
LEG_OVERLAP = 10
"""Frames that are farther apart in time, and meet, are of different legs."""
STEP_PX = 4
"""Pixels of the canvas between two that are looked at."""


@app.command()
@reported("The painter in a simulation")
def speed() -> Iterator[Row]:
    """Frames per second that the painter keeps, in a simulation; and what it asks of a Zynq's memory, on paper.

    Three frames each, at several headings. The memory refuses one word in six, and answers after up to 119 clocks.
    While a frame is painted, the next one is written. Every byte is compared with the golden model.

    Bytes are counted by the golden model, as if all tiles of the canvas were painted already: the camera writes a
    frame, windows and old tiles are read, new tiles are written. Packets of the rings come on top, at most 0.2 MB. A
    bus of 16 bits is that of PYNQ-Z2 and Arty Z7, with DDR3 at 1,050 transfers per microsecond; 32 bits are those of
    Zybo Z7, at 1,066. Half of its peak is left to the painter: the rest goes into opening rows, turning the bus round
    and refreshing, and to the processor.
    """
    for (size, rate), degrees in product(VIDEOS.items(), HEADINGS_DEG):
        flight = fly_straight(size, FRAMES, heading_deg=degrees)
        move, tiles = fit_canvas(flight)
        poses = [H @ move for H in flight.homographies]
        frame_mb = max(count_bytes(size, pose, tiles) for pose in poses) / 1e6
        row: Row = {"frames": f"{size[0]}×{size[1]}, {degrees}°", "wanted per second": rate}
        row |= paint(list(flight.images), poses, tiles)
        row |= {"three buffers (MB)": round(BUFFERS * frame_pages(*size) * PAGE_BYTES / 1e6, 1)}
        row |= {"traffic per frame (MB)": round(frame_mb, 1), "MB/s": round(rate * frame_mb)}
        for bits, peak in PEAK_MB_PER_S.items():
            row[f"per second, with {bits} bits"] = math.floor(USABLE * peak / frame_mb)
        yield row


def fly_straight(
    size: tuple[int, int],
    frames: int,
    *,
    speed_px: tuple[float, float] = SPEED_PX,
    heading_deg: float = 20,
    shake: float = 1,
) -> Flight:
    """A camera that flies straight on while the wind shakes it."""
    rng = np.random.default_rng(3)
    camera = Camera(width_px=size[0], height_px=size[1], focal_px=0.8 * size[0])
    wind = shake * rng.normal(0, [4, 4, 0.02 * camera.focal_px, 4, 1.5, 1.5], (frames, 6))
    steady = [[*np.multiply(number, speed_px), camera.focal_px, heading_deg, 0, 0] for number in range(frames)]
    names = ("x_px", "y_px", "altitude_px", "heading_deg", "pitch_deg", "roll_deg")
    poses = poses_along(**dict(zip(names, (wind + steady).T, strict=True)))
    light = Photometry(blur_sigma_px=0.4, noise_sigma=1.5, vignetting=0.1)
    return Flight(5, camera, poses, (light,) * frames)


def fit_canvas(flight: Flight) -> tuple[Matrix, tuple[int, int]]:
    """Canvas to ground, so that all frames are on the canvas; and its size in tiles."""
    corners = [pose.footprint(flight.camera) for pose in flight.poses]
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    move = np.eye(3)
    move[:2, 2] = low
    columns, rows = np.ceil((high - low) / TILE_PX).astype(int).tolist()
    return move, (columns, rows)


def pose_of(H: Matrix) -> NDArray[np.int64]:
    """As a host sets it."""
    pose, causes = Poses().place(Placement(1, 0, quantise(H[np.newaxis])[0], composed=False))
    assert pose is not None, causes
    return pose


def paint(images: Sequence[Pixels], poses: Sequence[Matrix], tiles: tuple[int, int]) -> Row:
    """Paint frames by hardware and model."""
    height_px, width_px = images[0].shape[:2]
    bench = PainterBench(width_px=width_px, height_px=height_px, columns=tiles[0], rows=tiles[1], rules=RULES)
    bench.canvas[:] = 0
    model, differing = Painter(*tiles), 0
    clocks, predicted, painted = [], [], []
    bench.show(images[0])
    for number, (image, H) in enumerate(zip(images, poses, strict=True), 1):
        # The frame is in memory before its pose comes: only painting is measured.
        while not bench.is_idle:
            bench.run(1000)
        bench.show(*images[number : number + 1])
        bench.place(quantise(H[np.newaxis])[0], number)
        start, pose = bench.cycle, pose_of(H)
        (painting,) = bench.run(MAX_CLOCKS, reports=number)
        clocks.append(painting.cycle - start)
        predicted.append(painting_cycles(model.plan((width_px, height_px), pose), *tiles))
        painted.append(model.paint(image, pose).painted)
        differing += int(np.count_nonzero(bench.canvas != model.memory))
    return {
        "tiles per frame": round(float(np.mean(painted))),
        "clocks of computing, at most": max(predicted),
        "clocks per frame, at most": max(clocks),
        f"per second at {CLOCK_MHZ} MHz": int(CLOCK_MHZ * 1e6 // max(clocks)),
        "frames lost": sum(bench.events.values()),
        "bytes unlike the model's": differing,
        "breaks of AXI's rules": bench.violations,
    }


def count_bytes(size: tuple[int, int], H: Matrix, tiles: tuple[int, int]) -> int:
    """Bytes that cross the memory's bus for a frame."""
    plan = Painter(*tiles).plan(size, pose_of(H))
    left, top, right, bottom = plan.boxes[plan.painted].T
    words = (right // WORD_PX - left // WORD_PX + 1) * (bottom - top + 1)
    tile_bytes = 2 * PAGE_BYTES * int(plan.painted.sum())
    return frame_pages(*size) * PAGE_BYTES + int(words.sum()) * WORD_BYTES + tile_bytes


@app.command()
@reported("Seams")
def seams() -> Iterator[Row]:
    """Seams of a mosaic whose frames the chip places, by its own homographies and a host that says now and then where.

    A rendered flight of 240 frames in six legs, 90 % forward and 50 % side overlap. The chip's homographies are those
    of the golden model, its poses too; nothing is painted. The host places each frame by its features and lays all out
    anew every ten frames. Painting starts with the first layout. An anchor comes late: that of a frame is set when the
    next frame's homography is there, and counts from the frame after that.
    """
    flight = make_lawnmower(7, SURVEY_FRAMES, SURVEY_PX, forward_overlap=0.9, side_overlap=0.5, exposure_step=0)
    extracted = (extract(image, CONFIG.front_end, frame=n) for n, image in enumerate(flight.images))
    frames = list(add_matches(extracted, CONFIG, "previous"))
    anchors, place_s, layout_s = find_anchors(frames)
    # The ground, as large as on the canvas and as it is turned there.
    to_ground = invert(flight.homographies[0])
    truth = {number: flight.homographies[number] @ to_ground for number in anchors}
    runs = {
        "by the chip alone": every(SURVEY_FRAMES, anchors),
        "with an anchor every 10 frames": every(10, anchors),
        "with one every 5": every(5, anchors),
        "with one for each that comes in time": {
            number: anchor for number, anchor in anchors.items() if not 0 < number % LAYOUT_EVERY <= LAYOUT_FRAMES
        },
        "with an exact one every 10": every(10, truth),
    }
    for name, chosen in runs.items():
        poses = place_frames(frames, chosen)
        found = find_seams(flight.camera, poses, flight.homographies)
        seams_px = np.concatenate([*found.values()])
        legs_px = np.concatenate([px for (i, j), px in found.items() if abs(i - j) > LEG_OVERLAP])
        yield {
            "frames are placed": name,
            "frames": len(poses),
            "seams, 90th percentile (px)": round(float(np.percentile(seams_px, 90)), 2),
            "worst": round(float(seams_px.max()), 1),
            "between legs, median": round(float(np.median(legs_px)), 2),
            "between legs, 90th percentile": round(float(np.percentile(legs_px, 90)), 2),
        }
    print(f"processor time of the host: {max(place_s):.2f} s for a frame, {max(layout_s):.1f} s for a layout, at most")


def every(frames: int, anchors: Mapping[int, Matrix]) -> dict[int, Matrix]:
    """The first anchor, and those of one frame in so many."""
    first = min(anchors)
    return {number: anchor for number, anchor in anchors.items() if number % frames == 0 or number == first}


def find_anchors(frames: Sequence[FrameResult]) -> tuple[dict[int, Matrix], list[float], list[float]]:
    """Place every frame by its features; canvas to frame, and seconds for each frame and for each layout."""
    host = Anchors(SURVEY_PX, CONFIG)
    anchors, place_s, layout_s = dict[int, Matrix](), list[float](), list[float]()
    for number, frame in enumerate(frames):
        start_s = time.process_time()
        place = host.add(number, frame.features)
        placed_s = time.process_time()
        if number % LAYOUT_EVERY == 0:
            host.lay_out()
            layout_s.append(time.process_time() - placed_s)
        if place is not None:
            anchors[number] = invert(place)
        place_s.append(placed_s - start_s)
    return anchors, place_s, layout_s


def place_frames(frames: Sequence[FrameResult], anchors: Mapping[int, Matrix]) -> dict[int, Matrix]:
    """The pose (canvas to frame, px) by which the chip paints each frame, if a host has such anchors."""
    chip, painted, links = Poses(), dict[int, Matrix](), dict[int, Matrix]()
    for number, frame in enumerate(frames):
        assert frame.homography is not None
        placement = placement_of(frame.homography)
        if placement is not None:
            links[number] = in_pixels(placement.elements)
            pose, _ = chip.place(placement)
            if pose is not None:
                painted[number] = in_pixels(pose)
        anchor = anchors.get(number - DELAY)
        if anchor is not None:
            for later in range(number - DELAY + 1, number + 1):
                anchor = links[later] @ anchor
            chip.place(Placement(number, number, quantise(anchor[np.newaxis])[0], composed=False))
    return painted


def find_seams(
    camera: Camera, poses: Mapping[int, Matrix], homographies: Sequence[Matrix]
) -> dict[tuple[int, int], Array]:
    """How far the ground is misaligned, in pixels of the canvas, at each place where two frames meet.

    Of the frames that cover a pixel of the canvas, the mosaic shows the one whose border is farthest. Where neighbours
    show frames i and j, the ground that i has there is found by the exact homographies (ground to frame), and where j
    has it on the canvas by the pose of j. The distance of both places is the seam's.

    Returns
    -------
    dict of ndarray of float64, shape (N,)
        For two frames that meet, the distance at each pixel where they do; one in `STEP_PX` is looked at.
    """
    owners, low = find_owners(camera, poses)
    found: dict[tuple[int, int], list[Array]] = defaultdict(list)
    for rows, columns in ((0, 1), (1, 0)):
        first = owners[: owners.shape[0] - rows, : owners.shape[1] - columns]
        second = owners[rows:, columns:]
        y, x = np.nonzero((first != second) & (first >= 0) & (second >= 0))
        pairs, places = np.stack([first[y, x], second[y, x]], axis=1), np.stack([x, y], axis=1) * STEP_PX + low
        for i, j in np.unique(pairs, axis=0).tolist():
            here = places[(pairs == (i, j)).all(axis=1)]
            across = invert(poses[j]) @ homographies[j] @ invert(homographies[i]) @ poses[i]
            there = apply(across, here)
            found[i, j].append(np.hypot(*(there - here).T))
    return {pair: np.concatenate(distances) for pair, distances in found.items()}


def find_owners(camera: Camera, poses: Mapping[int, Matrix]) -> tuple[NDArray[np.int64], Array]:
    """Which frame the mosaic shows at each pixel, (H, W), -1 for none; and where on the canvas the first pixel is."""
    outlines = {number: apply(invert(pose), camera.corners) for number, pose in poses.items()}
    low = np.floor(np.min([*outlines.values()], axis=(0, 1)))
    columns, rows = np.ceil((np.max([*outlines.values()], axis=(0, 1)) - low) / STEP_PX).astype(int).tolist()
    y, x = np.mgrid[:rows, :columns]
    owners, farthest = np.full((rows, columns), -1), np.zeros((rows, columns))
    last = np.array([camera.width_px - 1, camera.height_px - 1])
    for number, pose in poses.items():
        left, top = ((outlines[number].min(axis=0) - low) // STEP_PX).astype(int)
        right, bottom = np.ceil((outlines[number].max(axis=0) - low) / STEP_PX).astype(int)
        box = np.s_[top : bottom + 1, left : right + 1]
        inside = apply(pose, np.stack([x[box], y[box]], axis=-1) * STEP_PX + low)
        border = np.minimum(inside, last - inside).min(axis=-1)
        wins = border > farthest[box]
        owners[box][wins], farthest[box][wins] = number, border[wins]
    return owners, low


def invert(homography: Matrix) -> Matrix:
    """The way back."""
    return np.asarray(np.linalg.inv(homography), np.float64)


if __name__ == "__main__":
    app()
