"""The painter in a simulation: a mosaic and stabilised video of a shaking camera, and how many frames per second.

    python -m bench.painter [--pictures FOLDER]

The memory refuses one word in six, and answers after up to 119 clocks. Every byte is compared with the golden model.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from bench.pictures import save
from bench.report import JsonFile, Row, report
from golden_model.arrays import Matrix, Pixels
from golden_model.geometry.scoring import quantise
from golden_model.painting import painter as golden
from golden_model.painting.blending import FADE
from golden_model.painting.pose import Placement, Poses
from golden_model.painting.tiles import TILE_PX
from golden_model.painting.timing import painting_cycles
from sim.benches.memory import MemoryRules
from sim.benches.painter import PainterBench
from sim.scene import Camera, CameraPose, Flight, Photometry

RULES = MemoryRules(waits=43, latency_clocks=119, seed=1)
CLOCK_MHZ = 150
MAX_CLOCKS = 10_000_000
SPEED_PX = np.array([30.0, 18.0])
"""How far the camera flies over the ground between two frames."""


def fly(size: tuple[int, int], frames: int, shake: float) -> Flight:
    """A camera that flies straight on while the wind shakes it; 0: it does not."""
    rng = np.random.default_rng(3)
    camera = Camera(width_px=size[0], height_px=size[1], focal_px=0.8 * size[0])
    wind = shake * rng.normal(0, [4, 4, 0.02 * camera.focal_px, 4, 1.5, 1.5], (frames, 6))
    steady = [[*number * SPEED_PX, camera.focal_px, 20, 0, 0] for number in range(frames)]
    names = ("x_px", "y_px", "altitude_px", "heading_deg", "pitch_deg", "roll_deg")
    poses = [CameraPose(**dict(zip(names, row, strict=True))) for row in (wind + steady).tolist()]
    light = Photometry(blur_sigma_px=0.4, noise_sigma=1.5, vignetting=0.1)
    return Flight(5, camera, tuple(poses), (light,) * frames)


def fit_canvas(flight: Flight) -> tuple[Matrix, tuple[int, int]]:
    """Canvas to ground, so that all frames are on the canvas; and its size in tiles."""
    corners = [cv2.perspectiveTransform(flight.camera.corners[None], np.linalg.inv(H))[0] for H in flight.homographies]
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    move = np.eye(3)
    move[:2, 2] = low
    columns, rows = np.ceil((high - low) / TILE_PX).astype(int).tolist()
    return move, (columns, rows)


def paint(
    name: str, images: Sequence[Pixels], poses: Sequence[Matrix], tiles: tuple[int, int], *, replace: bool
) -> tuple[Row, list[Pixels]]:
    """Paint frames by hardware and model; returns figures, and the canvas after each frame."""
    height_px, width_px = images[0].shape[:2]
    bench = PainterBench(
        width_px=width_px, height_px=height_px, columns=tiles[0], rows=tiles[1], replace=replace, rules=RULES
    )
    bench.canvas[:] = 0
    model, pictures, differing = golden.Painter(*tiles, replace=replace), [], 0
    clocks, predicted, painted = [], [], []
    for number, (image, H) in enumerate(zip(images, poses, strict=True), 1):
        elements = quantise(H[np.newaxis])[0]
        pose, _ = Poses().place(Placement(number, 0, elements, composed=False))
        assert pose is not None
        bench.show(image)
        # The frame is in memory before its pose comes: only painting is measured.
        while not bench.is_idle:
            bench.run(1000)
        bench.place(elements, number)
        start = bench.cycle
        (painting,) = bench.run(MAX_CLOCKS, reports=number)
        clocks.append(painting.cycle - start)
        predicted.append(painting_cycles(model.plan((width_px, height_px), pose), *tiles))
        painted.append(model.paint(image, pose).painted)
        differing += int(np.count_nonzero(bench.canvas != model.memory))
        pictures.append(golden.join_tiles(bench.canvas)[..., :3].copy())
    row: Row = {
        "painting": name,
        "frames": len(images),
        "tiles per frame": round(float(np.mean(painted))),
        "clocks of computing": round(float(np.mean(predicted))),
        "clocks per frame": round(float(np.mean(clocks))),
        f"frames per second at {CLOCK_MHZ} MHz": round(float(CLOCK_MHZ * 1e6 / np.mean(clocks))),
        "bytes unlike the model's": differing,
        "breaks of AXI's rules": bench.violations,
    }
    return row, pictures


def warp(image: Pixels, H: Matrix, tiles: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """OpenCV's warp of an image onto the canvas, and the distance of each pixel to the border; 0 outside."""
    height_px, width_px = image.shape[:2]
    x, y = np.arange(width_px), np.arange(height_px)[:, None]
    border = np.minimum(np.minimum(x, x[::-1]), np.minimum(y, y[::-1])).astype(np.float64)
    size = (tiles[0] * TILE_PX, tiles[1] * TILE_PX)
    warped, distance = (cv2.warpPerspective(each, np.linalg.inv(H), size) for each in (image, border))
    return warped.astype(np.float64), distance


def blend(
    images: Sequence[Pixels], poses: Sequence[Matrix], tiles: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A host's mosaic by the same rule, in double precision; and where it is, but for its border."""
    mosaic, weights = np.zeros((tiles[1] * TILE_PX, tiles[0] * TILE_PX, 3)), np.zeros((1, 1))
    for image, H in zip(images, poses, strict=True):
        colours, distance = warp(image, H, tiles)
        share = np.where(weights == 0, 1, np.clip((distance - weights) / FADE + 0.5, 0, 1)) * (distance > 0)
        mosaic += (colours - mosaic) * share[..., None]
        weights = np.maximum(weights, distance)
    return mosaic, cv2.erode((weights > 2).astype(np.uint8), np.ones((5, 5))) > 0


def decibels(picture: Pixels, expected: NDArray[np.float64], where: NDArray[np.bool_]) -> float:
    """Signal to noise, where both are well inside."""
    return round(float(10 * np.log10(255**2 / np.mean((picture - expected)[where] ** 2))), 1)


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


def main(
    frames: Annotated[int, typer.Option(help="Of the mosaic and the video.")] = 12,
    pictures: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Measure."""
    size = (320, 240)
    flight, steady = fly(size, frames, shake=1), fly(size, frames, shake=0)
    images, references = list(flight.images), list(steady.images)
    move, tiles = fit_canvas(flight)
    poses = [H @ move for H in flight.homographies]
    row, canvases = paint("mosaic of a flight, 320x240", images, poses, tiles, replace=False)
    rows = [row | {"dB": decibels(canvases[-1], *blend(images, poses, tiles)), "motion (px)": ""}]
    poses = [H @ np.linalg.inv(S) for H, S in zip(flight.homographies, steady.homographies, strict=True)]
    tiles = (-(-size[0] // TILE_PX), -(-size[1] // TILE_PX))
    row, video = paint("its stabilised video", images, poses, tiles, replace=True)
    worst = min(
        decibels(picture, *blend([image], [H], tiles)) for picture, image, H in zip(video, images, poses, strict=True)
    )
    rows.append(row | {"dB": worst, "motion (px)": motion_px(video, references)})
    large = fly((1280, 720), 1, shake=1)
    move, tiles = fit_canvas(large)
    place = large.homographies[0] @ move
    row, whole = paint("a frame of 1280x720, turned by 20°", list(large.images), [place], tiles, replace=False)
    rows.append(row | {"dB": decibels(whole[0], *blend(list(large.images), [place], tiles)), "motion (px)": ""})
    report("The painter in a simulation", rows, json_file)
    if pictures:
        pictures.mkdir(parents=True, exist_ok=True)
        first = np.vstack([np.hstack(images[:4]), np.hstack([picture[: size[1], : size[0]] for picture in video[:4]])])
        save(pictures / "painter-mosaic.webp", canvases[-1])
        save(pictures / "painter-video.webp", first)


if __name__ == "__main__":
    typer.run(main)
