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


PAIRS = {
    2: (
        [[84, 84, 88, 103, 104, 92], [92, 87, 88, 76, 71, 95], [113, 102, 83, 72, 74, 71], [103, 101, 98, 73, 69, 66]],
        [[84, 90, 80, 80, 79, 77], [66, 54, 66, 84, 88, 67], [62, 55, 57, 57, 59, 77], [61, 52, 53, 55, 55, 76]],
    ),
    9: (
        [
            [123, 135, 133, 121, 83, 98], [127, 127, 134, 120, 94, 91], [111, 123, 116, 112, 110, 108],
            [102, 80, 115, 105, 93, 111],
        ],
        [[99, 80, 72, 83, 86, 67], [100, 81, 75, 74, 74, 68], [87, 91, 83, 94, 105, 90], [88, 79, 73, 86, 105, 74]],
    ),
}  # fmt: skip
"""Mean gray levels of 4x6 parts of the left and the right picture, by their seed."""


@pytest.mark.parametrize("seed", PAIRS)
def test_a_pair_is_that_on_which_recorded_figures_were_measured(seed: int) -> None:
    """Its ground, light, shadows, poses and exposures; rounding of other processors may differ."""
    for image, levels in zip(make_pair(seed).images, PAIRS[seed], strict=True):
        found = cv2.resize(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (6, 4), interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(found.astype(int), levels, atol=1)


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
