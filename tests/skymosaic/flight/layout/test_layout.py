"""Layouts of flights in which repeated textures link pictures falsely, against the exact poses."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.scene import make_lawnmower
from sim.scene.flight import Flight
from skymosaic.flight.layout.layout import Layout, lay_out, trust_by_loops
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.homography import apply, estimate
from tests.skymosaic.flight.layout.ties import tie_pictures

SIZE_PX = (1280, 960)
PICTURES = 30


def laid_out(seed: int, false_share: float, period_px: int) -> tuple[Any, ...]:
    """A flight, its layout, and the pairs that were planted."""
    flight = make_lawnmower(seed, PICTURES, SIZE_PX)
    tied = tie_pictures(flight, seed, false_share, period_px)
    links = [Link(t.left, t.right, t.left_points, t.right_points, *(len(t.left_points),) * 2) for t in tied]
    views: list[Any] = [SimpleNamespace(size=SIZE_PX, working_size=SIZE_PX)] * PICTURES
    return flight, lay_out(views, range(PICTURES), links), {(t.left, t.right) for t in tied if not t.true}


def position_errors_px(flight: Flight, layout: Layout) -> NDArray[np.float64]:
    grid = np.stack(np.meshgrid(*(np.linspace(0, side - 1, 4) for side in SIZE_PX)), axis=-1).reshape(-1, 2)
    estimated = np.array([apply(layout.transforms[member], grid) for member in layout.members])
    true = np.array(
        [apply(np.asarray(np.linalg.inv(flight.homographies[member]), np.float64), grid) for member in layout.members]
    )
    alignment = estimate(estimated.reshape(-1, 2), true.reshape(-1, 2), model="similarity")
    return np.linalg.norm(apply(alignment, estimated) - true, axis=-1).mean(axis=1)


@pytest.mark.parametrize("period_px", [60, 250], ids=["facade", "roofs"])
@pytest.mark.parametrize("false_share", [0.05, 0.1, 0.2])
def test_false_links_of_repeated_textures_are_found_and_move_no_photograph(false_share: float, period_px: int) -> None:
    flight, layout, planted = laid_out(1, false_share, period_px)
    assert len(planted) >= 5
    assert {(link.left, link.right) for link in layout.contradicting} == planted
    assert position_errors_px(flight, layout).max() < 1


def test_without_false_links_none_contradicts() -> None:
    flight, layout, _ = laid_out(2, 0, 100)
    assert layout.contradicting == ()
    assert position_errors_px(flight, layout).max() < 0.5


def test_a_camera_that_looks_far_ahead_keeps_its_perspective() -> None:
    flight = make_lawnmower(2, PICTURES, SIZE_PX)
    size, steep = np.array(SIZE_PX), PICTURES // 2
    # The focal length is a tenth less than the layout expects.
    focal_px = 0.9 * 1.2 * np.hypot(*SIZE_PX) / 2
    camera = np.array([[focal_px, 0, size[0] / 2], [0, focal_px, size[1] / 2], [0, 0, 1]])
    leaning = np.radians(30)
    turned = np.array(
        [[1, 0, 0], [0, np.cos(leaning), np.sin(leaning)], [0, -np.sin(leaning), np.cos(leaning)]], dtype=np.float64
    )
    ahead = np.asarray(camera @ turned @ np.linalg.inv(camera), dtype=np.float64)
    links = []
    for tied in tie_pictures(flight, 2, 0, 0):
        points = {tied.left: tied.left_points, tied.right: tied.right_points}
        kept: Any = np.ones(len(tied.left_points), np.bool_)
        if steep in points:
            points[steep] = apply(ahead, points[steep])
            kept = ((points[steep] >= 0) & (points[steep] < size)).all(axis=1)
        if kept.sum() >= 12:
            left, right = (points[side][kept] for side in (tied.left, tied.right))
            links.append(Link(tied.left, tied.right, left, right, len(left), len(left)))
    views: list[Any] = [SimpleNamespace(size=SIZE_PX, working_size=SIZE_PX)] * PICTURES
    layout = lay_out(views, range(PICTURES), links)
    assert sum(steep in (link.left, link.right) for link in links) >= 3
    assert layout.contradicting == ()
    assert max(float(np.median(errors)) for errors in layout.errors_px) < 1


def test_a_photograph_without_a_true_link_is_left_out() -> None:
    flight = make_lawnmower(2, PICTURES, SIZE_PX)
    tied = tie_pictures(flight, 2, 0, 0)
    links = [Link(t.left, t.right, t.left_points, t.right_points, 60, 60) for t in tied if 7 not in (t.left, t.right)]
    rng = np.random.default_rng(0)
    points = rng.uniform(100, 900, (60, 2))
    # Each of its links puts it somewhere else.
    links += [Link(7, other, points, points + rng.uniform(-80, 80, 2), 60, 60) for other in (9, 15, 24)]
    views: list[Any] = [SimpleNamespace(size=SIZE_PX, working_size=SIZE_PX)] * PICTURES
    layout = lay_out(views, range(PICTURES), sorted(links, key=lambda link: (link.left, link.right)))
    assert set(range(PICTURES)).difference(layout.members) == {7}
    assert layout.contradicting == ()
    assert position_errors_px(flight, layout).max() < 0.5
    # One link alone contradicts nothing, as at the end of a strip.
    layout = lay_out(views, range(PICTURES), sorted(links[:-2], key=lambda link: (link.left, link.right)))
    assert len(layout.members) == PICTURES


def test_each_photograph_whose_single_link_is_contradicted_is_left_out() -> None:
    rng = np.random.default_rng(0)
    places_px = np.array([(0, 0), (100, 0), (0, 100), (100, 100), (200, 0), (200, 100), (-100, 0), (300, 0)])

    def tie(left: int, right: int, off_px: float = 0) -> Link:
        points = rng.uniform(0, 300, (40, 2))
        moved = points + places_px[left] - places_px[right] + off_px + rng.normal(0, 0.3, (40, 2))
        return Link(left, right, points, moved, 40, 40)

    square = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (1, 4), (1, 5), (2, 3), (3, 4), (3, 5), (4, 5)]
    links = [*(tie(*pair) for pair in square), tie(0, 6), tie(2, 6, 60), tie(4, 7), tie(5, 7, 60)]
    views: list[Any] = [SimpleNamespace(size=(400, 300), working_size=(400, 300))] * len(places_px)
    layout = lay_out(views, range(len(views)), links)
    assert layout.members == tuple(range(6))
    assert layout.contradicting == ()
    # Among those that stay, a link that contradicts others is still named.
    false = tie(2, 4, 60)
    assert lay_out(views, range(len(views)), [*links, false]).contradicting == (false,)


def test_a_loop_that_does_not_close_takes_trust_from_its_links() -> None:
    def shifted(x: Any) -> Any:
        return np.array([[1.0, 0, x], [0, 1, 0], [0, 0, 1]])

    pairs = {(0, 1): 0, (1, 2): 1, (0, 2): 2, (2, 3): 3}
    closed = trust_by_loops(pairs, [shifted(1), shifted(1), shifted(2), shifted(1)])
    opened = trust_by_loops(pairs, [shifted(1), shifted(1), shifted(2.5), shifted(1)])
    assert closed[0] > closed[3] > opened[0]
    assert closed[3] == opened[3]
