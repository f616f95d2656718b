"""Pairs of photographs of flights: cut with a pseudo truth, and such as are easily misjudged.

Those are decorated by what moves with the camera, hovering, in the dark, over water or traffic, or of tiles. Both
pictures are cut out of one photograph, so their truth is exact, or out of two that no homography joins; neighbours are
two photographs of one place, with its trees and roofs.

For a pseudo truth, photographs up to three apart in a flight are registered by SIFT at 1600 px with a loose tolerance
and refitted to the inliers. So the truth favours SIFT, keeps pairs that SIFT solves, and with relief is one of several
planes: where ours correlates better than the truth, the truth is the one that is off.
"""

import random
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from bench.methods import sift_matches
from golden_model.arrays import Array, Float32, Matrix, Pixels
from golden_model.pixel.gray import to_gray
from skymosaic.geometry.acceptance import hull_area, overlap
from skymosaic.imagery.images import load, reduce_to_width
from skymosaic.imagery.photographs import list_sources

SIZE_PX = WIDTH_PX, HEIGHT_PX = (1000, 750)
"""Of pictures that are easily misjudged."""
WRONG_PX = 20.0
TRUTH_WIDTH_PX, CUT_WIDTH_PX = 1600, 640
SIFT_FEATURES = 6000
TOLERANCE_PX = 4.0
MIN_INLIERS, MIN_INLIER_SHARE = 60, 0.3
OVERLAPS = (0.15, 0.8)
MAX_STEP = 3
HOVERING = 4
"""One decorated pair in so many is of a camera that hovers."""
HOVERING_PX, MOVING_PX = (12.0, 12.0), (550.0, 412.5)
"""How far a camera that hovers, and one that moves, has moved along either axis, at most."""
Change = Callable[[Pixels, Pixels, np.random.Generator, np.random.Generator], Pixels]
"""Changes a picture, with that of another place at hand, by what both pictures share and what is its own."""
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
            small, to_large = zip(*(reduce_to_width(image, CUT_WIDTH_PX) for image in (left, right)), strict=True)
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


class ExactPair(NamedTuple):
    """Two pictures and the homography from left to right pixels; None where they show different places."""

    group: str
    left: Pixels
    right: Pixels
    truth: Matrix | None


def pour_water(picture: Pixels, _other: Pixels, common: np.random.Generator, _own: np.random.Generator) -> Pixels:
    """A right part, up to a half, without any texture."""
    shown = picture.copy()
    shown[:, -round(common.uniform(0.1, 0.5) * WIDTH_PX) :] = 90
    return shown


def move_part(picture: Pixels, other: Pixels, common: np.random.Generator, own: np.random.Generator) -> Pixels:
    """A right part, up to a third, that is other ground in each picture, as waves are."""
    shown, width = picture.copy(), round(common.uniform(0.05, 0.35) * WIDTH_PX)
    shown[:, -width:] = np.roll(other, own.integers(0, WIDTH_PX, 2), axis=(0, 1))[:, -width:]
    return shown


def drive_cars(picture: Pixels, _other: Pixels, common: np.random.Generator, own: np.random.Generator) -> Pixels:
    """Up to eighty cars, each of which stands elsewhere in the other picture."""
    shown = picture.copy()
    for x, y in own.integers(0, SIZE_PX, (int(common.integers(10, 80)), 2)):
        colour = common.integers(20, 250, 3).tolist()
        cv2.rectangle(shown, (int(x), int(y)), (int(x) + 44, int(y) + 22), colour, -1)
        cv2.rectangle(shown, (int(x) + 14, int(y) + 2), (int(x) + 30, int(y) + 20), (30, 30, 30), -1)
    return shown


def darken(picture: Pixels, _other: Pixels, _common: np.random.Generator, own: np.random.Generator) -> Pixels:
    """An eighth of the light, with noise."""
    return np.clip(picture * 0.12 + 20 + own.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)


def blur(picture: Pixels, _other: Pixels, _common: np.random.Generator, own: np.random.Generator) -> Pixels:
    """Out of focus by up to two pixels."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), own.uniform(0.3, 2)), dtype=np.uint8)


CHANGES: dict[str, Change] = {
    "plain": lambda picture, *_: picture,
    "water": pour_water,
    "waves": move_part,
    "traffic": drive_cars,
    "dark": darken,
    "blur": blur,
}


def confusing_pairs(flights: Sequence[Sequence[Pixels]], each: int) -> Iterator[ExactPair]:
    """So many pairs of each kind, the same on every run, out of photographs of flights at `SIZE_PX`."""
    for number in range(each):
        rng = np.random.default_rng(number)
        one, other = rng.permutation(len(flights))[:2]
        photograph, elsewhere = (flights[k][int(rng.integers(len(flights[k])))] for k in (int(one), int(other)))
        for name, change in CHANGES.items():
            views, truth = _cut(photograph, rng, HOVERING_PX if name in ("water", "waves", "traffic") else MOVING_PX)
            seed = int(rng.integers(2**31))
            left, right = (
                change(view, elsewhere, np.random.default_rng(seed), np.random.default_rng(seed + 1 + k))
                for k, view in enumerate(views)
            )
            yield ExactPair(name, left, right, truth)
        for name, draw in DRAWN.items():
            views, truth = _cut(photograph, rng, HOVERING_PX if number % HOVERING == 0 else MOVING_PX)
            yield _decorate(name, draw, views, truth, rng)
            yield _decorate(name, draw, (photograph, elsewhere), None, rng)
        gravel = [np.repeat(rng.normal(60, number % 4 * 3, (*SIZE_PX[::-1], 1)), 3, axis=2) for _ in range(2)]
        nothing = tuple(np.clip(picture, 0, 255).astype(np.uint8) for picture in gravel)
        yield _decorate("display", DRAWN["display"], nothing, None, rng)
        yield repeat_ground(photograph, elsewhere, rng)
        yield draw_form(rng)
        for name in ("plain", list(CHANGES)[number % len(CHANGES)]):
            (left, right), truth = _cut(photograph, rng, (0, 0))
            left, right = (CHANGES[name](view, elsewhere, np.random.default_rng(number), rng) for view in (left, right))
            yield ExactPair("tripod", left, right, truth)


def neighbouring_pairs(flights: Sequence[Sequence[Pixels]]) -> Iterator[ExactPair]:
    """Each second photograph of flights and the next one, as they are and under two decorations."""
    for photographs in flights:
        for number in range(0, len(photographs) - 1, 2):
            views = photographs[number], photographs[number + 1]
            truth = pseudo_truth(*(to_gray(view) for view in views))
            if truth is not None:
                rng = np.random.default_rng(number)
                yield ExactPair("neighbours", *views, truth)
                for name in rng.choice(list(DRAWN), 2, replace=False):
                    pair = _decorate(str(name), DRAWN[str(name)], views, truth, rng)
                    yield pair._replace(group="neighbours, decorated")


def _cut(
    photograph: Pixels, rng: np.random.Generator, most_px: tuple[float, float]
) -> tuple[tuple[Pixels, Pixels], Matrix]:
    """Two overlapping views of a photograph, with noise, and the truth."""
    large = cv2.resize(photograph, None, fx=1.6, fy=1.6, interpolation=cv2.INTER_CUBIC)
    most = np.array(most_px)
    step = np.rint(rng.uniform(-most, most)).astype(int)
    start = (np.array(large.shape[1::-1]) - SIZE_PX - step) // 2
    views = []
    for x, y in (start, start + step):
        view = large[y : y + HEIGHT_PX, x : x + WIDTH_PX]
        views.append(np.clip(view + rng.normal(0, 4, view.shape), 0, 255).astype(np.uint8))
    return (views[0], views[1]), _shift(step)


def _shift(step: NDArray[np.int_]) -> Matrix:
    return np.array([[1.0, 0, -step[0]], [0, 1, -step[1]], [0, 0, 1]])


def _decorate(
    name: str, draw: Draw, views: Sequence[Pixels], truth: Matrix | None, rng: np.random.Generator
) -> ExactPair:
    """Both views under one decoration."""
    seed = int(rng.integers(2**31))
    (left, from_left), (right, from_right) = (
        draw(view, np.random.default_rng(seed), np.random.default_rng(seed + 1 + k)) for k, view in enumerate(views)
    )
    moved = None if truth is None else np.asarray(from_right @ truth @ np.linalg.inv(from_left))
    return ExactPair(name, left, right, moved)


def repeat_ground(photograph: Pixels, other: Pixels, rng: np.random.Generator) -> ExactPair:
    """A patch laid like tiles, under none, some or much of other ground that tells the tiles apart."""
    side, share = int(rng.integers(60, 220)), rng.choice([0, 0.05, 0.15, 0.3])
    tiles = np.tile(photograph[200 : 200 + side, 300 : 300 + side], (2000 // side + 1, 2000 // side + 1, 1))
    ground = (1 - share) * tiles[:1600, :2000] + share * cv2.resize(other, (2000, 1600))
    step = rng.integers((150, 75), (700, 350))
    left, right = (
        ground[y : y + HEIGHT_PX, x : x + WIDTH_PX] + rng.normal(0, 4, (HEIGHT_PX, WIDTH_PX, 3))
        for x, y in (np.array([100, 100]), step + 100)
    )
    left, right = (np.clip(view, 0, 255).astype(np.uint8) for view in (left, right))
    return ExactPair("tiles", left, right, _shift(step))


def draw_form(rng: np.random.Generator) -> ExactPair:
    """Two halves of a form, empty or partly filled in."""
    form = np.full((1200, 2000), 250, np.uint8)
    form[60 :: rng.integers(30, 60)] = form[:, 40 :: rng.integers(80, 240)] = 60
    for x, y in rng.integers((50, 50), (1900, 1150), (int(rng.integers(0, 40)), 2)):
        cv2.putText(form, str(rng.integers(1000)), (int(x), int(y)), cv2.FONT_HERSHEY_SIMPLEX, 0.8, 40, 2)
    step = np.array([rng.integers(300, 800), 0])
    return ExactPair("form", form[:, :1100], form[:, step[0] : step[0] + 1100], _shift(step))
