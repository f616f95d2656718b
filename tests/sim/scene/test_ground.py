"""The landscape: reproducible, seamless, and the one of recorded figures."""

import hashlib
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.scene import (
    ground,
    layout,
    make_lawnmower,
    make_pair,
    make_pursuit,
    objects,
    render_ground,
    render_heights,
    surface,
    target,
)
from sim.scene.terrain import TERRAINS, render_terrain
from tests.sim.scene.conftest import clear_caches


@pytest.fixture
def small_tiles(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Most of a tile's time goes into its pixels."""
    clear_caches()
    monkeypatch.setattr(ground, "TILE_PX", 160)
    yield
    clear_caches()


@pytest.mark.usefixtures("small_tiles")
def test_parts_of_the_plane_agree_across_tile_borders() -> None:
    whole = render_ground(9, 200, 150, origin=(-100, 80))
    part = render_ground(9, 61, 43, origin=(-31, 131))
    assert np.array_equal(part, whole[51 : 51 + 43, 69 : 69 + 61])


@pytest.mark.usefixtures("small_tiles")
def test_same_seed_same_bytes() -> None:
    first = render_ground(9, 150, 120)
    clear_caches()
    assert np.array_equal(render_ground(9, 150, 120), first)
    assert not np.array_equal(render_ground(4, 150, 120), first)


@pytest.mark.usefixtures("small_tiles")
def test_tiling_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another tile size moves every border into the middle of a tile: the picture must stay as it is."""
    reference = render_ground(9, 120, 400, origin=(964, 50))
    clear_caches()
    monkeypatch.setattr(ground, "TILE_PX", 450)
    moved = render_ground(9, 120, 400, origin=(964, 50))
    # Shadows, crowns and road verges cross the old border alike; only the last bit of a float may round otherwise.
    assert cv2.absdiff(reference, moved).max() <= 2


def draw_scenes() -> dict[str, NDArray[np.generic]]:
    """A picture for each kind of scene; the part of the ground has nearly every use of land and everything on it."""
    tile = 8, 1024, 1024, (1024, -5 * 1024)
    film = make_pursuit(9, 41, (160, 120), bridge=True).images
    turning = make_lawnmower(9, 9, (160, 120), k1=-0.1, balance_sigma=0.1, relief=True, terrain="dunes").images
    lands = [render_terrain(name, 700, 700, (-300, -500)) for name in TERRAINS]
    return {
        "pair 9": cv2.cvtColor(np.hstack(make_pair(9).images), cv2.COLOR_BGR2GRAY),
        "ground": np.hstack(cv2.split(render_ground(*tile))),
        "heights": 10 * render_heights(*tile),
        "film": cv2.cvtColor(np.hstack([film[0], film[20]]), cv2.COLOR_BGR2GRAY),
        "lawnmower": np.hstack(cv2.split(turning[3])),
        "terrain": 10 * np.hstack(lands),
    }


RECORDED = {
    "pair 9": [
        128.84, 126.84, 90.52, 89.11, 77.41, 76.52, 126.98, 127.29, 92.56, 90.68, 74.82, 70.99,
        117.33, 114.27, 108.74, 89.02, 88.91, 97.74, 91.13, 110.05, 101.71, 83.64, 79.79, 89.66,
    ],
    "ground": [
        93.89, 73.65, 124.45, 106.25, 122.47, 101.01, 86.09, 74.09, 118.27, 98.83, 113.07, 93.06,
        88.33, 81.38, 115.76, 103.39, 113.54, 113.03, 95.47, 94.49, 129.51, 128.58, 141.58, 144.59,
    ],
    "heights": [
        96.89, 2.68, 19.65, 0.37, 82.7, 106.25, 9.97, 1.8, 12.07, 16.99, 231.88, 191.93,
        67.45, 38.28, 29.04, 42.53, 24.63, 0.52, 50.54, 46.19, 11.13, 14.62, 10.72, -0.43,
    ],
    "film": [
        85.94, 88.3, 80.41, 143.26, 152.34, 93.74, 103.28, 96.3, 65.99, 148.26, 149.26, 119.76,
        108.16, 74.82, 71.59, 125.76, 141.74, 144.63, 139.94, 74.11, 86.16, 77.01, 144.38, 133.58,
    ],
    "lawnmower": [
        104.49, 113.12, 123.51, 129.68, 105.05, 112.13, 93.9, 84.01, 126.0, 125.84, 108.95, 111.2,
        84.06, 80.64, 125.56, 125.35, 104.07, 105.54, 92.41, 96.36, 136.93, 133.64, 115.98, 113.02,
    ],
    "terrain": [
        116.59, 146.64, 62.3, 123.46, 108.25, 519.5, 138.25, 127.99, 44.91, 158.29, 226.62, 457.75,
        98.69, 117.74, 36.11, 184.59, 381.06, 316.19, 104.11, 123.76, 36.05, 202.2, 493.75, 172.62,
    ],
}  # fmt: skip
"""Mean levels of 4x6 parts of each."""


def test_scenes_are_those_on_which_recorded_figures_were_measured() -> None:
    """Ground, light, shadows, lenses, poses and exposures.

    Other processors round single pixels otherwise. Without the vector instructions of OpenCV and of NumPy, and without
    Intel's library, 0.1 % of the pixels differ by one level, and no mean by 0.001; half of the last digit is 0.005.
    """
    for name, picture in draw_scenes().items():
        parts = cv2.resize(picture.astype(np.float32), (6, 4), interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(parts.ravel(), RECORDED[name], rtol=0, atol=0.03, err_msg=name)
    colours = (*objects._TILE_ROOFS, *objects._SHEET_ROOFS, *objects._CARS)
    shares = layout.FIELD_SHARES, layout.VILLAGE_SHARES, layout.MAIN_ROAD_SHARES, layout.DRIVE_SHARES
    tables = [each.tolist() for each in colours], surface.COVERS, surface.PAVINGS, shares, target._BODIES
    assert hashlib.sha256(repr(tables).encode()).hexdigest()[:12] == "115c7ca24585"
