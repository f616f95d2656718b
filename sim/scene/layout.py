"""The plan of the landscape: roads, parcels, buildings, cars and plants on an endless plane.

The plan is a lattice of sections. Roads between jittered nodes bound the sections, and slow waves bend everything so
that no line is straight for long. A section is split at random into parcels; the use of a parcel decides what is built
or grows on it. A section depends only on the seed and its own indices. Lengths are ground pixels of about 0.15 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from golden_model.arrays import Array, Points
from sim.scene.noise import Stream, make_rng

SECTION_PX = 1500
MAX_OFFSET_PX = 560
"""The largest distance by which parts of a section lie outside its lattice square."""

FIELD_SHARES = {
    "meadow": 0.17, "pasture": 0.12, "cereal": 0.15, "ripe": 0.10, "stubble": 0.10,
    "soil": 0.10, "orchard": 0.08, "wood": 0.11, "scrub": 0.07,
}  # fmt: skip
VILLAGE_SHARES = {"lot": 0.78, "garden": 0.13, "yard": 0.09}
MAIN_ROAD_SHARES = {"street": 2.0, "gravel": 1.0}
DRIVE_SHARES = {"drive": 3.0, "gravel": 1.0}

_JITTER_PX = 300
_FIELD_PX = 560
_LOT_PX = 190
_ROADSIDE = 0.021
"""Share of a section's width between a boundary road's centre line and the parcels."""
_REACH_PX = 60
"""Lanes and drives that end within this distance of a road are joined to it."""


@dataclass(frozen=True)
class Road:
    """A centre line, shape (n, 2), and its surface: a key of `sim.scene.surface.PAVINGS`."""

    points: Points
    surface: str


@dataclass(frozen=True)
class Parcel:
    """A piece of land: outline of shape (n, 2), direction of its rows, its use, and its own random number."""

    outline: Points
    angle_rad: float
    use: str
    variety: int


@dataclass(frozen=True)
class Box:
    """A building or car: centre, size along and across its axis, direction, eaves height, kind, random number."""

    centre: Points
    length_px: float
    width_px: float
    angle_rad: float
    height_px: float
    kind: str
    variety: int


@dataclass(frozen=True)
class Section:
    """Everything that belongs to one lattice square.

    ``plants`` has shape (n, 5): x, y, crown radius and height in pixels, and a tone in 0..1. ``ponds`` has shape
    (n, 3): x, y, radius.
    """

    parcels: tuple[Parcel, ...]
    roads: tuple[Road, ...]
    boxes: tuple[Box, ...]
    plants: Array
    ponds: Array


def plan_sections(seed: int, x_px: int, y_px: int, width_px: int, height_px: int) -> list[Section]:
    """The sections that may reach into a window of the plane."""
    columns, rows = (
        range((start - MAX_OFFSET_PX) // SECTION_PX, (start + size + MAX_OFFSET_PX) // SECTION_PX + 1)
        for start, size in ((x_px, width_px), (y_px, height_px))
    )
    return [_plan_section(seed, column, row) for row in rows for column in columns]


@dataclass(frozen=True)
class _Land:
    """A part of a section: the plane's coordinates at u, v = 0..1 along and across it, before bending.

    ``corners`` has shape (2, 2, 2): v, u, then x and y.
    """

    corners: Points
    seed: int

    def at(self, u: ArrayLike, v: ArrayLike) -> Points:
        """Plane coordinates, shape (n, 2), of u and v."""
        s = np.reshape(np.asarray(u, np.float64), (-1, 1))
        t = np.reshape(np.asarray(v, np.float64), (-1, 1))
        (a, b), (c, d) = self.corners
        plane: Points = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d)
        # Bent by slow waves, at most 120 px in x and y.
        vectors, phases, displacements = _make_waves(self.seed)
        return np.asarray(plane + np.sin(plane @ vectors + phases) @ displacements)

    @property
    def size_px(self) -> tuple[float, float]:
        """Length along u and width along v."""
        length, width = (np.hypot(*(far - near)) for near, far in (self._middle(1), self._middle(0)))
        return float(length), float(width)

    @property
    def angle_rad(self) -> float:
        """Direction of u."""
        near, far = self._middle(1)
        return float(np.arctan2(*(far - near)[::-1]))

    def _middle(self, axis: int) -> Points:
        return np.asarray(self.corners.mean(axis=1 - axis))

    def lengthwise(self) -> _Land:
        """The same land with u along its longer side."""
        length, width = self.size_px
        return self if length >= width else _Land(self.corners.transpose(1, 0, 2), self.seed)

    def between(self, start: float, stop: float) -> _Land:
        """The part from u = ``start`` to ``stop``."""
        near, far = self.corners[:, 0], self.corners[:, 1]
        return _Land(np.stack([near + at * (far - near) for at in (start, stop)], axis=1), self.seed)

    def parcel(self, use: str, rng: np.random.Generator) -> Parcel:
        """The whole as one parcel."""
        t = np.linspace(0, 1, 9)[:-1]
        zero, one = np.zeros_like(t), np.ones_like(t)
        outline = self.at(np.concatenate([t, one, 1 - t, zero]), np.concatenate([zero, t, one, 1 - t]))
        return Parcel(outline, self.angle_rad + rng.normal(0, 0.03), use, _draw_number(rng))


@lru_cache(maxsize=8)
def _make_waves(seed: int) -> tuple[Points, Points, Points]:
    """Wave vectors (2, n), phases (n,) and displacements (n, 2) of the plane's slow bends."""
    rng = make_rng(seed, Stream.WAVES)
    count = 3
    direction, length_px = rng.uniform(0, 2 * np.pi, count), rng.uniform(1100, 2600, count)
    vectors = np.array([np.cos(direction), np.sin(direction)]) * 2 * np.pi / length_px
    return vectors, rng.uniform(0, 2 * np.pi, count), rng.uniform(-40, 40, (count, 2))


def _draw_number(rng: np.random.Generator) -> int:
    return int(rng.integers(1 << 30))


def _place_node(seed: int, column: int, row: int) -> Points:
    jitter = make_rng(seed, Stream.NODES, column, row).uniform(-_JITTER_PX, _JITTER_PX, 2)
    return np.array([column, row]) * SECTION_PX + jitter


@lru_cache(maxsize=64)
def _plan_section(seed: int, column: int, row: int) -> Section:
    """Plan the section at ``column``, ``row`` of the lattice."""
    rng = make_rng(seed, Stream.SECTIONS, column, row)
    nodes = [[_place_node(seed, column + i, row + j) for i in (0, 1)] for j in (0, 1)]
    whole = _Land(np.array(nodes), seed)
    t = np.linspace(0, 1, 120)
    # Each boundary road is planned twice, by the two sections at its sides: with the same random stream, so alike.
    across = [make_rng(seed, Stream.ROADS_ACROSS, column, row + j) for j in (0, 1)]
    down = [make_rng(seed, Stream.ROADS_DOWN, column + i, row) for i in (0, 1)]
    roads = [Road(whole.at(t, np.full_like(t, j)), _choose(across[j], MAIN_ROAD_SHARES)) for j in (0, 1)]
    roads += [Road(whole.at(np.full_like(t, i), t), _choose(down[i], MAIN_ROAD_SHARES)) for i in (0, 1)]
    inner = whole.between(_ROADSIDE, 1 - _ROADSIDE).lengthwise().between(_ROADSIDE, 1 - _ROADSIDE)
    parcels = [whole.parcel("verge", rng)]
    boxes: list[Box] = []
    plants, ponds = [np.empty((0, 5))], [np.empty((0, 3))]
    for land, use in _divide(inner, rng, roads, village=False):
        parcels.append(land.parcel(use, rng))
        if use == "lot":
            boxes += _build_homestead(land, rng, roads)
        if use == "yard":
            boxes += _build_farmyard(land, rng)
        if use in ("meadow", "pasture") and rng.random() < 0.3:
            ponds.append(np.hstack([land.at(*rng.uniform(0.3, 0.7, 2)), rng.uniform(25, 75, (1, 1))]))
        plants += [_scatter_plants(land, use, rng), *_plant_hedges(land, rng, often=use in VILLAGE_SHARES)]
    return Section(tuple(parcels), tuple(roads), tuple(boxes), np.concatenate(plants), np.concatenate(ponds))


def _join(line: Points, roads: list[Road]) -> Points:
    """The line, with each end extended to the nearest road if one is within reach."""
    network = np.concatenate([road.points for road in roads])
    ends = []
    for end in line[[0, -1]]:
        distance = np.hypot(*(network - end).T)
        ends.append(network[[distance.argmin()]] if distance.min() < _REACH_PX else end[np.newaxis])
    return np.concatenate([ends[0], line, ends[1]])


def _choose(rng: np.random.Generator, shares: dict[str, float]) -> str:
    weights = np.array(list(shares.values()))
    return str(rng.choice(list(shares), p=weights / weights.sum()))


def _divide(land: _Land, rng: np.random.Generator, roads: list[Road], *, village: bool) -> list[tuple[_Land, str]]:
    """Cut land at random until the pieces have the size of their use; villages get lanes along the cuts."""
    land = land.lengthwise()
    length_px, _ = land.size_px
    village = village or (length_px < 900 and rng.random() < 0.16)
    if length_px < (_LOT_PX if village else _FIELD_PX) * rng.uniform(1.0, 1.5):
        return [(land, _choose(rng, VILLAGE_SHARES if village else FIELD_SHARES))]
    cut, gap = rng.uniform(0.38, 0.62), 0.0
    if village and length_px > 340:
        t = np.linspace(0, 1, 30)
        roads.append(Road(_join(land.at(np.full_like(t, cut), t), roads), "lane"))
        gap = 18 / length_px
    halves = land.between(0, cut - gap), land.between(cut + gap, 1)
    return [leaf for half in halves for leaf in _divide(half, rng, roads, village=village)]


def _build_homestead(land: _Land, rng: np.random.Generator, roads: list[Road]) -> list[Box]:
    """A house, perhaps with a wing and a shed, and cars on the drive; the drive joins ``roads``."""
    angle = land.angle_rad + rng.choice([0, np.pi / 2]) + rng.normal(0, 0.03)
    u, v = rng.uniform(0.4, 0.6, 2)
    house, gate = land.at([u, u + rng.uniform(-0.2, 0.2)], [v, rng.choice([0.0, 1.0])])
    length, width, eaves, look = rng.uniform(62, 96), rng.uniform(46, 64), rng.uniform(18, 28), _draw_number(rng)
    boxes = [Box(house, length, width, angle, eaves, "house", look)]
    if rng.random() < 0.5:
        along, aside = length * rng.uniform(-0.3, 0.3), width * rng.choice([-0.5, 0.5])
        axis, normal = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        wing = house + along * axis + aside * normal
        boxes.append(Box(wing, width * 0.9, length * 0.42, angle + np.pi / 2, eaves - 2, "house", look))
    if rng.random() < 0.6:
        shed = land.at(rng.choice([0.14, 0.86]), rng.uniform(0.15, 0.85))[0]
        boxes.append(Box(shed, rng.uniform(20, 34), rng.uniform(16, 24), angle, 13, "shed", _draw_number(rng)))
    roads.append(Road(_join(np.array([house, gate]), roads), _choose(rng, DRIVE_SHARES)))
    drive_angle = np.arctan2(*(gate - house)[::-1])
    cars = rng.permutation([0.62, 0.95])[: rng.integers(0, 3)]
    return boxes + [_park_car(house + share * (gate - house), drive_angle, rng) for share in cars]


def _build_farmyard(land: _Land, rng: np.random.Generator) -> list[Box]:
    """Two barns and a line of parked cars between them."""
    _, width_px = land.size_px
    boxes = []
    for v in (0.22, 0.78):
        barn, size = land.at(rng.uniform(0.42, 0.58), v)[0], (rng.uniform(90, 150), min(70, width_px * 0.36))
        boxes.append(Box(barn, *size, land.angle_rad, rng.uniform(24, 32), "barn", _draw_number(rng)))
    parked = np.flatnonzero(rng.random(7) < 0.6) * 0.13 + 0.1
    places = land.at(parked, np.full_like(parked, 0.5))
    return boxes + [_park_car(place, land.angle_rad + np.pi / 2, rng) for place in places]


def _park_car(place: Points, angle: float, rng: np.random.Generator) -> Box:
    centre = place + rng.normal(0, 1.5, 2)
    angle += rng.choice([0, np.pi]) + rng.normal(0, 0.05)
    return Box(centre, rng.uniform(27, 32), 13, angle, 9, "car", _draw_number(rng))


def _scatter_plants(land: _Land, use: str, rng: np.random.Generator) -> Array:
    """Trees and bushes on a parcel; its use sets their mean spacing and radii. Orchards are planted in rows."""
    spacing, smallest, largest = {
        "wood": (27.0, 15, 36), "scrub": (38.0, 4, 16), "orchard": (34.0, 10, 14), "pasture": (150.0, 8, 30),
        "meadow": (260.0, 10, 34), "lot": (50.0, 4, 26), "garden": (42.0, 4, 28), "yard": (95.0, 5, 16),
    }.get(use, (700.0, 10, 30))  # fmt: skip
    length_px, width_px = land.size_px
    if use == "orchard":
        columns, rows = int(length_px / spacing), int(width_px / spacing)
        standing = np.argwhere(rng.random((columns, rows)) < 0.93)
        u, v = ((standing + 0.5) / (columns, rows)).T
    else:
        u, v = rng.uniform(0.03, 0.97, (2, rng.poisson(length_px * width_px / spacing**2)))
    if use in ("lot", "garden"):
        # Gardens are planted along their borders, away from the house.
        v = 0.5 + 0.5 * np.sign(v - 0.5) * np.abs(2 * v - 1) ** 0.25
    return _grow_plants(land.at(u, v), smallest, largest, rng)


def _plant_hedges(land: _Land, rng: np.random.Generator, *, often: bool) -> list[Array]:
    """Rows of bushes, with gaps and sometimes trees, along some edges."""
    hedges = []
    for side, length_px in enumerate(land.size_px):
        if rng.random() < (0.55 if often else 0.35):
            t = rng.uniform(0.02, 0.98, int(length_px / rng.uniform(6, 11)))
            t = t[np.sin(t * length_px / rng.uniform(15, 90) + rng.uniform(0, 6)) > rng.uniform(-1.2, 0.2)]
            inset = np.full_like(t, 0.015)
            line = land.at(t, inset) if side == 0 else land.at(inset, t)
            hedges.append(_grow_plants(line, 5, float(rng.choice([9, 12, 22])), rng))
    return hedges


def _grow_plants(where: Points, smallest: float, largest: float, rng: np.random.Generator) -> Array:
    count = len(where)
    radius = smallest + (largest - smallest) * rng.random(count) ** 1.7
    height = radius * rng.uniform(0.9, 1.7, count) + 2
    tone = np.clip(rng.normal(rng.uniform(0.3, 0.6), 0.25, count), 0, 1)
    return np.column_stack([where + rng.normal(0, 2, (count, 2)), radius, height, tone])
