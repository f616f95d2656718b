"""Pairs of photographs of flights: decorated by what moves with the camera, and cut with a pseudo truth.

Decorations are drawn over neighbours of a flight and over photographs of two places.

For a pseudo truth, photographs up to three apart in a flight are registered by SIFT at 1600 px with a loose tolerance
and refitted to the inliers. So the truth favours SIFT, keeps pairs that SIFT solves, and with relief is one of several
planes: where ours correlates better than the truth, the truth is the one that is off.
"""

import random
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from rich.progress import track

from bench.methods import sift_matches
from golden_model.arrays import Array, Float32, Matrix, Pixels
from golden_model.pixel.gray import to_gray
from skymosaic.geometry.acceptance import hull_area, overlap
from skymosaic.imagery.images import load, reduce_to_width
from skymosaic.imagery.photographs import list_sources

SIZE_PX = (1000, 750)
"""Of decorated photographs."""
WRONG_PX = 20.0
TRUTH_WIDTH_PX, WIDTH_PX = 1600, 640
SIFT_FEATURES = 6000
TOLERANCE_PX = 4.0
MIN_INLIERS, MIN_INLIER_SHARE = 60, 0.3
OVERLAPS = (0.15, 0.8)
MAX_STEP = 3
Draw = Callable[[Pixels, np.random.Generator, np.random.Generator], tuple[Pixels, Array]]
"""Decorates a picture by what is of the camera and what is of the photograph; also returns how the picture moved."""


def draw_display(
    image: Pixels, camera: np.random.Generator, photograph: np.random.Generator, *, lines: int = 14, jitter_px: int = 0
) -> tuple[Pixels, Array]:
    """White text in two columns, above and below, as ground stations show it; up to ``jitter_px`` off its place."""
    display = np.zeros_like(image)
    for line in range(lines):
        place = 20 + 490 * (line % 2), 45 + 44 * (line // 2) + 330 * (line >= 8)
        text = "LAT {:.4f}  H {}.{} M  SAT {}".format(camera.uniform(40, 50), *camera.integers(10, 99, 3))
        cv2.putText(display, text, place, cv2.FONT_HERSHEY_DUPLEX, 0.75, (250, 250, 250), 2)
    moved = np.roll(display, photograph.integers(-jitter_px, jitter_px + 1, 2), axis=(0, 1))
    return np.maximum(image, moved), np.eye(3)


def draw_film(image: Pixels, camera: np.random.Generator, photograph: np.random.Generator) -> tuple[Pixels, Array]:
    """A scan of aerial film: gray, in a dark border with fiducial marks, clocks and text; no scan lies as the other."""
    height, width = image.shape[:2]
    film = np.full((height + 180, width + 160, 3), 22, np.uint8)
    film[100 : 100 + height, 130 : 130 + width] = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[:, :, None]
    for x in (140, 130 + width // 2, 120 + width):
        for y in (110, 100 + height // 2, 90 + height):
            cv2.circle(film, (x, y), 12, (10, 10, 10), -1)
            cv2.drawMarker(film, (x, y), (240, 240, 240), cv2.MARKER_CROSS, 20, 1)
    for y in range(170, height + 60, 150):
        cv2.circle(film, (62, y), 48, (215, 215, 215), -1)
        for angle in camera.uniform(0, 2 * np.pi, 9):
            end = (62 + 44 * np.cos(angle), y + 44 * np.sin(angle))
            cv2.line(film, (62, y), np.rint(end).astype(int).tolist(), (20, 20, 20), 2)
    cv2.putText(film, "SURVEY CAMERA 15/23  NO 7021  f 152.44", (150, 50), 0, 0.8, (240, 240, 240), 2)
    scan = cv2.getRotationMatrix2D((600, 450), photograph.uniform(-0.5, 0.5), 1.0)
    scan[:, 2] += photograph.uniform(-8, 8, 2)
    scanned = cv2.warpAffine(film, scan, (film.shape[1], film.shape[0])) + photograph.normal(0, 3, film.shape)
    placed = np.array([[1.0, 0, 130], [0, 1, 100], [0, 0, 1]])
    return np.clip(scanned, 0, 255).astype(np.uint8), np.vstack([scan, [0, 0, 1]]) @ placed


def draw_night(image: Pixels, camera: np.random.Generator, photograph: np.random.Generator) -> tuple[Pixels, Array]:
    """A fifth of the contrast, under the columns and pixels of a sensor that are brighter than others."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    columns = camera.normal(0, 1, (1, gray.shape[1]))
    fine: Float32 = cv2.GaussianBlur(camera.normal(0, 1, gray.shape).astype(np.float32), (0, 0), 0.8)
    pattern = columns + camera.normal(0, 4, gray.shape) + 2.8 * fine / fine.std()
    dark = 0.2 * (gray - 110) + 120 + pattern + photograph.normal(0, 1.5, gray.shape)
    return np.clip(dark, 0, 255).astype(np.uint8), np.eye(3)


def draw_dirt(image: Pixels, camera: np.random.Generator, _photograph: np.random.Generator) -> tuple[Pixels, Array]:
    """Sixty dark specks on the glass before the lens."""
    shown = image.copy()
    for centre in camera.integers(20, np.subtract(SIZE_PX, 20), (60, 2)):
        cv2.fillPoly(shown, [centre + camera.integers(-16, 17, (8, 2))], (12, 12, 12))
    return shown, np.eye(3)


def draw_window(image: Pixels, camera: np.random.Generator, _photograph: np.random.Generator) -> tuple[Pixels, Array]:
    """A screenshot: the picture in the window of a program with buttons on the left and a list below."""
    height, width = image.shape[:2]
    window = np.full((height + 260, width + 300, 3), 236, np.uint8)
    window[60 : 60 + height, 280 : 280 + width] = image
    for y in range(30, height + 240, 34):
        cv2.rectangle(window, (16, y - 20), (30 + int(camera.integers(120, 220)), y + 6), (200, 160, 120), -1)
        cv2.putText(window, f"Layer {camera.integers(1000)}", (24, y), 0, 0.6, (40, 40, 40), 1)
    for y in range(height + 90, height + 250, 28):
        cv2.putText(window, f"{camera.integers(10**9)}  {camera.uniform():.6f}  ok", (290, y), 0, 0.7, (30, 30, 30), 1)
    return window, np.array([[1.0, 0, 280], [0, 1, 60], [0, 0, 1]])


def draw_watermarks(image: Pixels, _camera: np.random.Generator, _other: np.random.Generator) -> tuple[Pixels, Array]:
    """A grid of bright words all over the picture, as agencies draw them: they look like ground that stands still."""
    shown = image.copy()
    for y in range(30, SIZE_PX[1], 55):
        for x in range(-60, SIZE_PX[0], 190):
            cv2.putText(shown, "SAMPLE", (x + y % 100, y), cv2.FONT_HERSHEY_TRIPLEX, 1.2, (255, 255, 255), 3)
    return shown, np.eye(3)


DRAWN: dict[str, Draw] = {
    "display": draw_display,
    "display, jittering": partial(draw_display, jitter_px=2),
    "display, other values": lambda image, _camera, photograph: draw_display(image, photograph, photograph),
    "scanned film": draw_film,
    "night, sensor's pattern": draw_night,
    "dirt": draw_dirt,
    "screenshots": draw_window,
    "grid of watermarks": draw_watermarks,
}


def read_flight(folder: Path, count: int) -> list[Pixels]:
    """The first photographs of a flight, at one size."""
    paths = [Path(source.content) for source in list_sources([folder])[:count] if isinstance(source.content, Path)]
    return [cv2.resize(load(path).pixels, SIZE_PX, interpolation=cv2.INTER_AREA) for path in paths]


def cut(folder: Path, count: int, known: Collection[str]) -> Iterator[tuple[str, str, Pixels, Pixels, Matrix]]:
    """At most ``count`` pairs of a flight, the same on every run, none of which has a name in ``known``."""
    photographs = list_sources([folder])
    word = folder.name.split("_")[0]
    steps = [(i, i + step) for step in range(1, MAX_STEP + 1) for i in range(len(photographs) - step)]
    random.Random(5).shuffle(steps)
    given = 0
    for i, j in track(sorted(steps[: 3 * count]), description=word):
        name = f"real_{word}_{i}_{j}"
        if given == count or name in known:
            continue
        left, right = (reduce_to_width(to_gray(load(photographs[k].content).pixels), TRUTH_WIDTH_PX)[0] for k in (i, j))
        truth = pseudo_truth(left, right)
        if truth is not None:
            given += 1
            small, to_large = zip(*(reduce_to_width(image, WIDTH_PX) for image in (left, right)), strict=True)
            yield name, "unseen", *small, np.linalg.inv(to_large[1]) @ truth @ to_large[0]


def pseudo_truth(left: Pixels, right: Pixels) -> Matrix | None:
    """The homography by RootSIFT and MAGSAC, fitted again to its inliers; None where it is doubtful."""
    left_points, right_points = sift_matches(left, right, SIFT_FEATURES, root=True)
    if len(left_points) < MIN_INLIERS:
        return None
    H, mask = cv2.findHomography(
        left_points, right_points, cv2.USAC_MAGSAC, TOLERANCE_PX, maxIters=20_000, confidence=0.99999
    )
    if H is None or mask.sum() < MIN_INLIERS or mask.mean() < MIN_INLIER_SHARE:
        return None
    inliers = mask.ravel() > 0
    H, _ = cv2.findHomography(left_points[inliers], right_points[inliers], 0)
    size = left.shape[1], left.shape[0]
    share = hull_area(overlap(H, size, (right.shape[1], right.shape[0]))) / (size[0] * size[1])
    return H if OVERLAPS[0] <= share <= OVERLAPS[1] else None
