"""Pairs that are easily misjudged: decorated, hovering, in the dark, over water or traffic, or of tiles.

Both pictures are cut out of one photograph, so their truth is exact, or out of two that no homography joins.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.flight_pairs import DRAWN, SIZE_PX, Draw
from golden_model.arrays import Matrix, Pixels

WIDTH_PX, HEIGHT_PX = SIZE_PX
HOVERING = 4
"""One decorated pair in so many is of a camera that hovers."""
HOVERING_PX, MOVING_PX = (12.0, 12.0), (550.0, 412.5)
"""How far a camera that hovers, and one that moves, has moved along either axis, at most."""
Change = Callable[[Pixels, Pixels, np.random.Generator, np.random.Generator], Pixels]
"""Changes a picture, with that of another place at hand, by what both pictures share and what is its own."""


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
