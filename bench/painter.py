"""How many frames per second the painter keeps, in a simulation; and what it asks of a Zynq's memory, on paper.

    python -m bench.painter

Three frames each, at several headings. The memory refuses one word in six, and answers after up to 119 clocks. While a
frame is painted, the next one is written. Every byte is compared with the golden model.

Bytes are counted by the golden model, as if all tiles of the canvas were painted already: the camera writes a frame,
windows and old tiles are read, new tiles are written. Packets of the rings come on top, at most 0.2 MB. A bus of 16
bits is that of PYNQ-Z2 and Arty Z7, with DDR3 at 1,050 transfers per microsecond; 32 bits are those of Zybo Z7, at
1,066. Half of its peak is left to the painter: the rest goes into opening rows, turning the bus round and refreshing,
and to the processor.
"""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
import typer
from numpy.typing import NDArray

from bench.report import JsonFile, Row, report
from golden_model.arrays import Matrix, Pixels
from golden_model.geometry.fixed_point import quantise
from golden_model.painting.painter import Painter
from golden_model.painting.pose import Placement, Poses
from golden_model.painting.tiles import TILE_PX
from golden_model.painting.timing import painting_cycles
from hdl.painting.frame_writer import BUFFERS, frame_pages
from hdl.settings import PAGE_BYTES
from sim.benches.memory import MemoryRules
from sim.benches.painter import PainterBench
from sim.scene import Camera, CameraPose, Flight, Photometry

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


def main(json_file: JsonFile = None) -> None:
    """Measure and compute."""
    rows: list[Row] = []
    for (size, rate), degrees in product(VIDEOS.items(), HEADINGS_DEG):
        flight = fly(size, FRAMES, shake=1, heading_deg=degrees)
        move, tiles = fit_canvas(flight)
        poses = [H @ move for H in flight.homographies]
        frame_mb = max(count_bytes(size, pose, tiles) for pose in poses) / 1e6
        row: Row = {"frames": f"{size[0]}×{size[1]}, {degrees}°", "wanted per second": rate}
        row |= paint(list(flight.images), poses, tiles)
        row |= {"three buffers (MB)": round(BUFFERS * frame_pages(*size) * PAGE_BYTES / 1e6, 1)}
        row |= {"traffic per frame (MB)": round(frame_mb, 1), "MB/s": round(rate * frame_mb)}
        for bits, peak in PEAK_MB_PER_S.items():
            row[f"per second, with {bits} bits"] = math.floor(USABLE * peak / frame_mb)
        rows.append(row)
    report("The painter in a simulation", rows, json_file)


def fly(
    size: tuple[int, int],
    frames: int,
    shake: float,
    *,
    speed_px: tuple[float, float] = SPEED_PX,
    heading_deg: float = 20,
) -> Flight:
    """A camera that flies straight on while the wind shakes it; 0: it does not."""
    rng = np.random.default_rng(3)
    camera = Camera(width_px=size[0], height_px=size[1], focal_px=0.8 * size[0])
    wind = shake * rng.normal(0, [4, 4, 0.02 * camera.focal_px, 4, 1.5, 1.5], (frames, 6))
    steady = [[*np.multiply(number, speed_px), camera.focal_px, heading_deg, 0, 0] for number in range(frames)]
    names = ("x_px", "y_px", "altitude_px", "heading_deg", "pitch_deg", "roll_deg")
    poses = [CameraPose(**dict(zip(names, row, strict=True))) for row in (wind + steady).tolist()]
    light = Photometry(blur_sigma_px=0.4, noise_sigma=1.5, vignetting=0.1)
    return Flight(5, camera, tuple(poses), (light,) * frames)


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


if __name__ == "__main__":
    typer.run(main)
