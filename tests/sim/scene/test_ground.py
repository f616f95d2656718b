"""The landscape: reproducible, seamless, like a photograph, and painted fast."""

import time
from itertools import pairwise

import cv2
import numpy as np
import pytest

from sim.scene import ground, make_pair, render_ground
from tests.sim.scene.caches import clear_caches


def test_parts_of_the_plane_agree_across_tile_borders() -> None:
    whole = render_ground(9, 700, 500, origin=(-400, 800))
    part = render_ground(9, 301, 203, origin=(-151, 911))
    assert np.array_equal(part, whole[111 : 111 + 203, 249 : 249 + 301])


def test_same_seed_same_bytes() -> None:
    first = render_ground(3, 300, 200)
    clear_caches()
    assert np.array_equal(render_ground(3, 300, 200), first)
    assert not np.array_equal(render_ground(4, 300, 200), first)


def test_tiling_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another tile size moves every border into the middle of a tile: the picture must stay as it is."""
    reference = render_ground(9, 120, 1000, origin=(964, 0))
    clear_caches()
    monkeypatch.setattr(ground, "TILE_PX", 700)
    moved = render_ground(9, 120, 1000, origin=(964, 0))
    clear_caches()
    # Shadows, crowns and road verges cross the old border alike; only the last bit of a float may round otherwise.
    assert cv2.absdiff(reference, moved).max() <= 2


@pytest.mark.parametrize("seed", [2, 9])
def test_landscape_has_the_statistics_of_a_photograph(seed: int) -> None:
    view = cv2.cvtColor(make_pair(seed).images[0], cv2.COLOR_BGR2GRAY)
    corners = cv2.FastFeatureDetector.create(20).detect(view)
    assert len(corners) > 2000
    cells = {(int(corner.pt[0]) // 80, int(corner.pt[1]) // 80) for corner in corners}
    assert len(cells) == 8 * 6
    square = view[:, :480].astype(np.float64)
    window = np.outer(np.hanning(480), np.hanning(480))
    power = np.abs(np.fft.fft2((square - square.mean()) * window)) ** 2
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(480), np.fft.fftfreq(480)))
    edges = np.geomspace(4 / 480, 0.45, 16)
    bands = [power[(frequency >= low) & (frequency < high)].mean() for low, high in pairwise(edges)]
    slope = np.polyfit(np.log(edges[:-1]), np.log(bands), 1)[0]
    # Photographs from drones at this resolution: -1.4 to -2.9.
    assert -3.2 < slope < -1.2


def test_nothing_is_stamped_twice(rng: np.random.Generator) -> None:
    view = cv2.cvtColor(render_ground(9, 1000, 1000), cv2.COLOR_BGR2GRAY)
    for x, y in rng.integers(0, 960, (12, 2)):
        score = cv2.matchTemplate(view, view[y : y + 40, x : x + 40], cv2.TM_CCOEFF_NORMED)
        score[max(y - 4, 0) : y + 5, max(x - 4, 0) : x + 5] = 0
        assert score.max() < 0.85


def test_a_tile_takes_seconds_at_most() -> None:
    clear_caches()
    start = time.process_time()
    render_ground(11, ground.TILE_PX, ground.TILE_PX)
    # About 0.4 s on one core; the rest is for busy machines.
    assert time.process_time() - start < 5
