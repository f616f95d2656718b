"""Layouts of photographs with exact poses, with false ties, and what makes a group impossible."""

from typing import Any

import numpy as np
import pytest

from skymosaic.compositing.warp import nearness
from skymosaic.flight.layout.accuracy import Errors, measure_accuracy
from skymosaic.flight.layout.expected_shape import are_possible
from skymosaic.flight.layout.layout import _lay_out_together, lay_out
from skymosaic.flight.layout.linked_group import linked_group, trust_by_loops
from skymosaic.flight.layout.motions import shapes
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.homography import apply, estimate_similarity
from tests.skymosaic.flight import made
from tests.skymosaic.flight.layout import cameras
from tests.skymosaic.flight.layout.cameras import views_of


@pytest.mark.parametrize(("period_px", "share"), [(60, 0.2), (250, 0.05)], ids=["facade", "roofs"])
def test_false_links_of_repeated_textures_are_found_and_move_no_photograph(period_px: int, share: float) -> None:
    rng = np.random.default_rng(1)
    above = [cameras.camera(140 * x, 110 * y, *rng.normal(0, (2, 3))) for y in range(4) for x in range(4)]
    links = cameras.tie_all(above, seed=1)
    # As if the ground repeated after it, in one of four directions; and two that are far apart look alike.
    planted = {*rng.choice(len(links), round(share * len(links)), replace=False).tolist()}
    for row in planted:
        links[row].right_points[:] += period_px * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])[rng.integers(4)]
    points = rng.uniform(0, 400, (60, 2))
    false = [*(links[row] for row in planted), Link(0, 15, points, points + period_px, 60, 60)]
    layout = lay_out(views_of(16), range(16), sorted([*links, false[-1]], key=lambda link: (link.left, link.right)))
    assert len(planted) >= 3
    assert sorted((link.left, link.right) for link in layout.contradicting) == sorted((e.left, e.right) for e in false)
    corners = np.array([(0.0, 0), (639, 0), (639, 479), (0, 479)])
    found = np.concatenate([apply(layout.transforms[view], corners) for view in range(16)])
    true = np.concatenate([apply(np.asarray(np.linalg.inv(pose), np.float64), corners) for pose in above])
    off = np.linalg.norm(apply(estimate_similarity(found, true), found) - true, axis=1)
    # Of ground of 820 by 630.
    assert off.mean() < 0.7


def test_each_photograph_whose_single_link_is_contradicted_is_left_out() -> None:
    rng = np.random.default_rng(0)
    places_px = np.array([(0, 0), (100, 0), (0, 100), (100, 100), (200, 0), (200, 100), (-100, 0), (300, 0)])

    def tie(left: int, right: int, off_px: float = 0, inliers: int = 40) -> Link:
        points = rng.uniform(0, 300, (inliers, 2))
        moved = points + places_px[left] - places_px[right] + off_px + rng.normal(0, 0.3, points.shape)
        return Link(left, right, points, moved, inliers, inliers)

    square = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (1, 4), (1, 5), (2, 3), (3, 4), (3, 5), (4, 5)]
    links = [*(tie(*pair) for pair in square), tie(0, 6), tie(2, 6, 60), tie(4, 7), tie(5, 7, 60)]
    views = made.views(len(places_px))
    layout = lay_out(views, range(len(views)), links)
    assert layout.members == tuple(range(6))
    assert layout.contradicting == ()
    # Among those that stay, a link that contradicts others is still named.
    false = tie(2, 4, 60)
    assert lay_out(views, range(len(views)), [*links, false]).contradicting == (false,)
    # A link that a dozen matches made by chance puts none in doubt that has many more.
    weak, surer = tie(2, 6, 60, inliers=20), [*(tie(*pair) for pair in square), tie(0, 6)]
    layout = lay_out(views[:7], range(7), [*surer, weak])
    assert (layout.members, layout.contradicting) == (tuple(range(7)), (weak,))
    assert lay_out(views[:7], range(7), [*surer, tie(2, 6, 60, inliers=21)]).members == tuple(range(6))


@pytest.mark.parametrize(("inliers", "members", "overruled"), [(20, 4, True), (31, 3, False)])
def test_a_far_surer_link_over_relief_overrules_one_that_fits_better(
    inliers: int, members: int, overruled: bool
) -> None:
    rng = np.random.default_rng(1)

    def tie(left: int, right: int, off_px: float, inliers: int, noise_px: float) -> Link:
        points = rng.uniform(0, 300, (inliers, 2))
        return Link(left, right, points, points + off_px + rng.normal(0, noise_px, points.shape), inliers, inliers)

    sure, false = tie(2, 3, 0, 60, 14), tie(1, 3, 40, inliers, 0.3)
    links = [*(tie(*pair, 0, 40, 0.3) for pair in ((0, 1), (0, 2), (1, 2))), sure, false]
    views = made.views(4)
    assert _lay_out_together(views, range(4), links, []).contradicting == (sure,)
    layout = lay_out(views, range(4), links)
    assert len(layout.members) == members
    assert layout.contradicting == ((false,) if overruled else ())


@pytest.mark.parametrize("place", [(50.0, 400.0), cameras.MIDDLE_PX], ids=["aside", "in the middle"])
def test_ties_that_all_coincide_move_no_other_photograph(place: tuple[float, float]) -> None:
    level = [cameras.camera(60 * x, 0, 0) for x in range(5)]
    links = [link for link in cameras.tie_all(level, seed=2) if 4 not in (link.left, link.right)]
    without = lay_out(cameras.views_of(4), range(4), links)
    # In the middle of a view, turn and scale move nothing, so that the equations have no solution.
    links.append(Link(3, 4, *(np.tile(place, (12, 1)),) * 2, 12, 12))
    layout = lay_out(cameras.views_of(5), range(5), links)
    for member in range(4):
        with_them, alone = (np.linalg.inv(each.transforms[0]) @ each.transforms[member] for each in (layout, without))
        np.testing.assert_allclose(apply(with_them, (0, 0)), apply(alone, (0, 0)), atol=0.5)


def test_a_photograph_that_shows_the_sky_keeps_its_place() -> None:
    raised = [cameras.camera(40 * x, 0, lean) for x in (0, 1) for lean in range(0, 80, 8)]
    layout = lay_out(cameras.views_of(20), range(20), cameras.tie_all(raised, seed=1))
    assert layout.members == tuple(range(20))
    # Above the top of the steepest photographs lies the horizon.
    top = [float(nearness(cameras.SIZE_PX, layout.transforms[view], np.array([[320.0, 0]]))[0]) for view in (0, 9, 19)]
    assert top[0] > 0.5
    assert max(top[1:]) < 0


def test_a_layout_goes_on_to_where_other_links_lead_also_by_another_reference() -> None:
    rng = np.random.default_rng(3)
    above = [cameras.camera(140 * x, 110 * y, *rng.normal(0, (3, 90))) for y in range(3) for x in range(4)]
    links = cameras.tie_all(above, seed=1)
    anew = lay_out(views_of(12), range(12), links)
    middle = anew.reference
    few = [link for link in links if middle not in (link.left, link.right) or link.right == link.left + 1]
    before = lay_out(views_of(12), range(12), few)
    assert len(few) < len(links)
    assert before.reference != middle
    on = lay_out(views_of(12), range(12), links, before)
    assert (on.reference, on.model, len(on.links)) == (middle, anew.model, len(links))
    corners = np.array([(0.0, 0), (639, 0), (639, 479), (0, 479)])
    for view, transform in anew.transforms.items():
        np.testing.assert_allclose(apply(on.transforms[view], corners), apply(transform, corners), atol=1)


def test_a_layout_that_more_links_contradict_is_not_gone_on_from() -> None:
    """A tree of links says little of cameras that lean much."""
    rng, joined, tree = np.random.default_rng(28), {0}, list[Link]()
    above = [cameras.camera(140 * x, 110 * y, *rng.normal(0, (25, 90))) for y in range(3) for x in range(4)]
    links = cameras.tie_all(above, seed=28)
    while len(joined) < 12:
        tree.append(next(link for link in links if (link.left in joined) != (link.right in joined)))
        joined |= {tree[-1].left, tree[-1].right}
    on = lay_out(views_of(12), range(12), links, lay_out(views_of(12), range(12), tree))
    assert (len(on.links), len(on.members)) == (len(links), 12)


def test_a_loop_that_does_not_close_takes_trust_from_its_links() -> None:
    def shifted(x: Any) -> Any:
        return np.array([[1.0, 0, x], [0, 1, 0], [0, 0, 1]])

    pairs = {(0, 1): 0, (1, 2): 1, (0, 2): 2, (2, 3): 3}
    closed = trust_by_loops(pairs, np.array([shifted(1), shifted(1), shifted(2), shifted(1)]))
    opened = trust_by_loops(pairs, np.array([shifted(1), shifted(1), shifted(2.5), shifted(1)]))
    assert closed[0] > closed[3] > opened[0]
    assert closed[3] == opened[3]


def test_a_link_that_mirrors_or_shrinks_its_view_to_a_point_leaves_it_where_its_neighbour_lies() -> None:
    points = np.array([[0.0, 0], [600, 0], [600, 450], [0, 450]] * 3)
    shrunk, one_place = 300 + 1e-4 * points, np.full_like(points, 300)
    mirrored = np.array([639.0, 0]) - points * np.array([1.0, -1])
    links = [Link(row, row + 1, points, right, 12, 12) for row, right in enumerate((shrunk, mirrored, one_place))]
    start = linked_group(views_of(4), range(4), links).start
    assert are_possible(start).all()
    # Similarities have neither stretch nor tilt.
    np.testing.assert_allclose(shapes(start), 0, atol=1e-9)


NOTHING = np.zeros((0, 2))


def off(left: int, right: int, *errors_px: float) -> Link:
    """A link whose checks are so far off."""
    here = np.arange(2.0 * len(errors_px)).reshape(-1, 2)
    there = here + np.array(errors_px)[:, None] * [0.6, 0.8]
    return Link(left, right, NOTHING, NOTHING, 0, 0, left_checks=here, right_checks=there)


def test_photographs_and_pairs_are_named_the_worst_first_and_of_enough_matches() -> None:
    links = [off(0, 1, *[1] * 5), off(1, 2, *[7] * 4), off(2, 3, 2, 3, 4, 5, 6), Link(0, 3, NOTHING, NOTHING, 0, 0)]
    found = measure_accuracy({view: np.eye(3) for view in range(4)}, links)
    assert found is not None
    rounded = [
        (key, each.matches, round(each.median_px, 9))
        for errors in (found.photographs, found.pairs)
        for key, each in errors.items()
    ]
    assert rounded == [(2, 9, 6), (3, 5, 4), (1, 9, 1), (0, 5, 1), ((2, 3), 5, 4), ((0, 1), 5, 1)]
    assert (found.whole.matches, round(found.whole.median_px, 9), round(found.whole.ninety_px, 9)) == (14, 3.5, 7)
    assert measure_accuracy({}, links[3:]) is None
    moved = np.array([[1.0, 0, 0], [0, 1, -3], [0, 0, 1]])
    only = measure_accuracy({0: moved, 1: np.eye(3)}, [off(0, 1, *[0] * 5)])
    assert only is not None
    assert only.whole == Errors(5, 3.0, 3.0)


def test_cameras_see_ground_neither_mirrored_nor_edge_on_nor_at_no_size() -> None:
    level, mirrored, edge_on = np.eye(3), np.diag([-1.0, 1, 1]), np.diag([1.0, 0.05, 1])
    leaning = np.array([[1, 0, 0], [0, 0.5, 0], [0.8, -0.5, 1]])
    tiny, huge = np.diag([1e-4, 1e-4, 1]), np.diag([1e4, 1e4, 1])
    unknown = np.full((3, 3), np.nan)
    possible = are_possible(np.stack([level, mirrored, edge_on, leaning, tiny, huge, unknown]))
    assert possible.tolist() == [True, False, False, True, False, False, False]
