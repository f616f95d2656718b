"""Links between cameras over flat ground, without pictures: true ones, and every kind of bad one."""

from collections.abc import Sequence

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


def ring(count: int, lean_deg: float) -> list[Matrix]:
    """Cameras around one place, at which all of them look."""
    cameras = []
    for turn_deg in np.arange(count) * 360 / count:
        away = apply(np.asarray(np.linalg.inv(camera(0, 0, lean_deg, turn_deg)), np.float64), MIDDLE_PX)
        cameras.append(camera(-away[0], -away[1], lean_deg, turn_deg))
    return cameras


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


def tie_all(cameras: Sequence[Matrix], seed: int, reach: int | None = None) -> list[Link]:
    """The links of all pairs of cameras, or of those at most ``reach`` apart in a ring."""
    rng, count = np.random.default_rng(seed), len(cameras)
    pairs = [(left, right) for left in range(count) for right in range(left + 1, count)]
    near = [(left, right) for left, right in pairs if reach is None or min(right - left, count - right + left) <= reach]
    links = [tie(left, right, cameras, rng) for left, right in near]
    return [link for link in links if link is not None]


def random_motion(rng: np.random.Generator, tilt: float, shift_px: float, zoom: float) -> Matrix:
    """A random homography between two pictures; one in twenty is a mirror."""
    turn, scale = rng.normal(0, 0.2 if rng.random() < 0.7 else 2), np.exp(rng.normal(0, zoom))
    turning = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1 / scale]]
    mirror = np.diag([-1.0 if rng.random() < 0.05 else 1, 1, 1])
    tilting, centre, back = np.eye(3), np.eye(3), np.eye(3)
    tilting[2, :2] = rng.normal(0, tilt, 2) / 400
    centre[:2, 2] = -np.array(MIDDLE_PX)
    back[:2, 2] = np.array(MIDDLE_PX) + rng.normal(0, shift_px, 2)
    return np.asarray(back @ np.array(turning) @ mirror @ tilting @ centre, dtype=np.float64)


def bad_link(left: int, right: int, poses: Sequence[Matrix], rng: np.random.Generator) -> Link:
    """A link whose ties may be true, false, in a heap, on a line, behind the horizon, or nothing but noise."""
    count = int(rng.integers(12, 60))
    kind = rng.choice(["true", "true", "false", "tilted", "heap", "line", "noise", "zoomed"])
    points = rng.uniform((0, 0), SIZE_PX, (count, 2))
    if kind == "heap":
        points = points[:1] + rng.normal(0, 5, (count, 2))
    if kind == "line":
        along = np.outer(rng.uniform(-200, 200, count), rng.normal(0, 1, 2))
        points = points[:1] + along + rng.normal(0, 0.5, (count, 2))
    motion = random_motion(rng, 1.5 if kind == "tilted" else 0.1, 200, 4 if kind == "zoomed" else 0.3)
    if kind in ("true", "heap", "line") and rng.random() < 0.7:
        motion = np.asarray(np.linalg.inv(poses[right]) @ poses[left], dtype=np.float64)
    moved = rng.uniform((0, 0), SIZE_PX, (count, 2)) if kind == "noise" else apply(motion, points)
    moved = moved + rng.normal(0, 1, moved.shape)
    usable = (np.abs(moved) < 1e5).all(axis=1)
    if usable.sum() < 8:
        usable, moved = np.ones(count, np.bool_), points + rng.normal(0, 1, points.shape)
    return Link(left, right, points[usable], moved[usable], int(usable.sum()), int(usable.sum()))


def bad_graph(seed: int, most: int) -> tuple[list[View], list[Link]]:
    """At least three views and at most so many, all of them linked, and their bad links."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, most + 1))
    poses = [random_motion(rng, 0.05, 400, 0.3) for _ in range(count)]
    pairs = {(int(rng.integers(0, view)), view) for view in range(1, count)}
    for _ in range(int(rng.integers(0, 2 * count))):
        one, other = sorted(rng.choice(count, 2, replace=False).tolist())
        pairs.add((one, other))
    return views_of(count), [bad_link(left, right, poses, rng) for left, right in sorted(pairs)]
