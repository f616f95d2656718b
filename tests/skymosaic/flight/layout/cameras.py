"""Links between cameras over flat ground, without pictures: true ones, and every kind of bad one."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from golden_model.arrays import Matrix
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply
from tests.skymosaic.flight import made

SIZE_PX = (640, 480)
MIDDLE_PX = (319.5, 239.5)
FOCAL_PX = 480.0


def views_of(count: int) -> list[View]:
    return made.views(count, SIZE_PX)


def camera(x: float, y: float, lean_deg: float, turn_deg: float = 0) -> Matrix:
    """Ground to pixels, (3, 3), of a camera 300 above the ground that leans towards where its turn points."""
    lean, turn = np.radians((lean_deg, turn_deg))
    leaning = [[1, 0, 0], [0, np.cos(lean), np.sin(lean)], [0, -np.sin(lean), np.cos(lean)]]
    turning = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    inner = np.array([[FOCAL_PX, 0, MIDDLE_PX[0]], [0, FOCAL_PX, MIDDLE_PX[1]], [0, 0, 1]])
    place = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 300]])
    return np.asarray(inner @ np.array(leaning) @ np.array(turning) @ place, dtype=np.float64)


def tie(left: int, right: int, cameras: Sequence[Matrix], rng: np.random.Generator, most: int = 60) -> Link | None:
    """The link of two cameras that see the same ground at scales that differ by less than 2; None if they do not."""
    pixels = rng.uniform((0, 0), SIZE_PX, (40 * most, 2))
    ground = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(cameras[left]).T
    # Sky shows no ground.
    pixels, ground = pixels[ground[:, 2] > 0], ground[ground[:, 2] > 0]
    ground /= ground[:, 2:]
    depths = [ground @ cameras[side][2] for side in (left, right)]
    seen = apply(cameras[right], ground[:, :2])
    inside = (depths[1] > 0) & (seen >= 0).all(axis=1) & (seen < SIZE_PX).all(axis=1)
    inside &= (depths[0] < 2 * depths[1]) & (depths[1] < 2 * depths[0])
    chosen = np.flatnonzero(inside)[:most]
    if len(chosen) < 15:
        return None
    noisy = [points[chosen] + rng.normal(0, 0.5, (len(chosen), 2)) for points in (pixels, seen)]
    return Link(left, right, noisy[0], noisy[1], len(chosen), len(chosen))


def tie_all(cameras: Sequence[Matrix], seed: int) -> list[Link]:
    """The links of all pairs of cameras."""
    rng = np.random.default_rng(seed)
    links = [tie(left, right, cameras, rng) for left, right in combinations(range(len(cameras)), 2)]
    return [link for link in links if link is not None]
