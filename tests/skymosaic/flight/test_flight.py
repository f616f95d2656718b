"""What a flight says of its photographs, and how its layouts are surveyed."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.scene import CameraPose
from skymosaic import mosaic
from skymosaic.compositing.warp import nearness
from skymosaic.evaluation.metrics import grid_error
from skymosaic.flight import survey
from skymosaic.flight.flight import BLURRED, Flight
from skymosaic.flight.layout.agreement import Agreement
from skymosaic.flight.layout.layout import Layout, lay_out
from skymosaic.flight.linking.links import Link
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.photographs import Source
from tests.skymosaic.flight import made
from tests.skymosaic.registration.rendering import CAMERA, view

TIES = np.arange(40.0).reshape(20, 2)


def link(left: int, right: int, ties: int = 20) -> Link:
    return Link(left, right, TIES[:ties], TIES[:ties], 20, 20)


def flown(sharpness: Sequence[Any], links: list[Link], layouts: list[Layout]) -> Flight:
    """A flight whose first photograph could not be read, so that indices of views and photographs differ."""
    count = len(sharpness)
    views = [made.view(f"{number}.jpg", sharpness=each) for number, each in enumerate(sharpness)]
    sources = tuple(Source(view + 1, f"{view}.jpg", Path(f"{view}.jpg")) for view in range(count))
    names = ("unread.jpg", *(source.name for source in sources))
    return made.flight(views, links, layouts, names=names, sources=sources, left_out={0: "unreadable"})


def laid_out(*members: int, links: tuple[Link, ...] = (), contradicting: tuple[Link, ...] = ()) -> Layout:
    transforms = {member: np.eye(3) for member in members}
    errors = tuple(np.full(2, float(link.right)) for link in links)
    return Layout(members, members[0], transforms, links, contradicting, errors)


@pytest.mark.parametrize("blurred", [[], [1], [1, 3], [0, 2]], ids=str)
def test_what_is_sharp_elsewhere_on_the_same_ground_is_blurred(blurred: list[int]) -> None:
    """Four in a row, half of each on the next; sharpness belongs to the ground, and blurred ones link with each other.

    The last photograph is in no layout, so it is held against all.
    """
    ground = np.random.default_rng(1).normal(0, 1, 64).repeat(2)
    along = [ground[8 * view : 8 * view + 16] - 2.0 * (view in blurred) for view in range(4)]
    links = (link(0, 1), link(1, 2), link(2, 3), link(1, 3))
    places = {view: np.array([[1.0, 0, 200 * view], [0, 1, 0], [0, 0, 1]]) for view in range(4)}
    layout = Layout((0, 1, 2, 3), 0, places, links)
    sharpness = [np.array([each] * 12, np.float32) for each in (*along, np.full(16, -9.0))]
    flight = flown(sharpness, [], [layout])
    assert np.flatnonzero(flight.relative_sharpness < BLURRED).tolist() == [*blurred, 4]
    named = ", ".join(f"{view}.jpg" for view in blurred)
    assert flight.describe_blurred(layout).partition(":")[0] == named


def test_what_is_taken_out_is_left_out_with_the_reason() -> None:
    links, other = (link(0, 1), link(1, 2), link(2, 3)), (link(0, 2), link(1, 3))
    rest = laid_out(0, 1, 2, 3, links=links, contradicting=other).without([0])
    assert (rest.members, rest.reference, list(rest.transforms)) == ((1, 2, 3), 1, [1, 2, 3])
    assert (rest.links, rest.contradicting) == (links[1:], other[1:])
    assert [errors[0] for errors in rest.errors_px] == [2, 3]
    assert rest.without([3]).reference == 1
    assert laid_out(0, 1).without([0, 1]).members == ()
    flight = flown([1.0] * 6, [], [laid_out(0, 1, 2, 3), laid_out(4, 5)])
    assert flight.without({}) is flight
    kept = flight.without({3: "changed", 4: "gone"})
    # A single photograph is no mosaic.
    assert [layout.members for layout in kept.layouts] == [(0, 1, 2)]
    assert kept.left_out == {0: "unreadable", 4: "changed", 5: "gone"}
    assert [layout.members for layout in flight.without({0: "", 1: ""}).layouts] == [(2, 3), (4, 5)]


def test_links_that_a_layout_led_to_and_then_denies_are_dropped() -> None:
    rng, step_px = np.random.default_rng(0), 100

    def tie(left: int, right: int, off_px: float = 0) -> Link:
        points = rng.uniform(0, 300, (40, 2))
        moved = points - [step_px * (right - left) + off_px, 0]
        return Link(left, right, points, moved, 40, 40)

    views = made.views(5)
    links = {(view, view + 1): tie(view, view + 1) for view in range(4)}
    layout = lay_out(views, range(5), list(links.values()))
    # View 4 hangs on one link, so that a link that contradicts it would put its place in doubt.
    nearby = {(0, 2): tie(0, 2), (1, 3): tie(1, 3), (2, 4): tie(2, 4, off_px=25)}
    ((again,), _) = survey.lay_out_all(views, [list(range(5))], links, lambda _: nearby, lambda *_: Agreement())
    assert again.members == layout.members
    assert again.contradicting == ()
    assert links.keys() == {(0, 1), (1, 2), (2, 3), (3, 4), (0, 2), (1, 3)}
    assert set(again.links) == set(links.values())


def test_what_no_plane_explains_is_left_out_with_the_reason_and_what_it_contradicts_is_counted() -> None:
    points = np.random.default_rng(1).uniform(50, 250, (40, 2))
    # Two groups that fit, joined by links of noise; and a photograph that only noise links.
    true = [Link(0, 1, points, points + 5, 40, 40), Link(2, 3, points, points + 5, 40, 40)]
    noise = [Link(left, right, points, points[::-1], 40, 40) for left, right in ((1, 2), (3, 4))]
    views = made.views(5, (300, 300))
    links = {(link.left, link.right): link for link in sorted([*true, *noise], key=lambda link: link.left)}
    layouts, alone = survey.lay_out_all(views, [[0, 1, 2, 3, 4]], links, lambda _layout: {}, lambda *_: Agreement())
    assert [layout.members for layout in layouts] == [(0, 1), (2, 3)]
    assert list(alone) == [4]
    assert "no plane explains the 40 matches of 3.jpg and 4.jpg" in alone[4]
    flight = made.flight(views, links.values(), layouts, left_out={4: alone[4]})
    absent = flight.absent_from(layouts[0])
    assert list(absent) == [2, 3, 4]
    assert absent[2] == "2.jpg: in another group of 2 photographs, whose links to it (1) contradict"
    links.pop((1, 2))
    apart = replace(flight, links=tuple(links.values())).absent_from(layouts[0])
    assert apart[3] == "3.jpg: in another group of 2 photographs, which nothing links to this one"


@pytest.mark.parametrize(("false", "off_px", "refused"), [(6, 30, True), (2, 30, False), (6, 9, False), (0, 0, False)])
def test_photographs_of_things_that_all_look_the_same_are_refused_with_counts(
    monkeypatch: pytest.MonkeyPatch, false: int, off_px: float, refused: bool
) -> None:
    points, eyes = np.random.default_rng(4).uniform(0, 300, (40, 2)), {view: np.eye(3) for view in range(6)}

    def link(pair: tuple[int, int], off_px: float) -> Link:
        moved = points + np.array([off_px, 0])
        return Link(*pair, points, moved, 40, 40, left_checks=points, right_checks=moved)

    true = tuple(link((view, view + 1), 0) for view in range(5))
    contradicting = tuple(link(pair, off_px) for pair in [(0, 2), (1, 3), (2, 4), (3, 5), (0, 3), (1, 4)][:false])
    layout = Layout(tuple(eyes), 0, eyes, true if false != 2 else true * 4, contradicting)
    monkeypatch.setattr(survey, "lay_out", lambda *_: layout)
    views = made.views(6, (4, 3))
    layouts, alone = survey.lay_out_all(views, [list(eyes)], {}, lambda _layout: {}, lambda *_: Agreement())
    assert [each.members for each in layouts] == ([] if refused else [layout.members])
    reason = "6 of 11 links contradict the layout, and matches that it did not use are 30 px off in the median: "
    reasons = [reason] * 6 if refused else []
    assert all(each.startswith(start) for each, start in zip(alone.values(), reasons, strict=True))


def test_why_a_photograph_is_alone_is_said_with_its_best_match() -> None:
    points = np.ones((20, 2))
    views = [
        made.view(f"{view}.jpg", strongest=np.resize(made.NO_FEATURES, count))
        for view, count in enumerate((50, 50, 50, MIN_INLIERS - 1))
    ]

    def why(*links: Link, view: int = 0) -> str:
        return survey.why_alone(view, views, links)

    def tried(left: int, right: int, inliers: int, *, moves: bool = False, ties: int = 0) -> Link:
        moving = points if moves else points[:0]
        return Link(left, right, points[:ties], points[:ties], inliers, 0, left_moving=moving, right_moving=moving)

    assert why(view=3) == f"too few features ({MIN_INLIERS - 1}; flat, blurred or masked image?)"
    assert why() == why(tried(1, 2, 9)) == "no other photograph can be used"
    some = [tried(0, 1, 3), tried(0, 2, 5), tried(1, 2, 9)]
    best = f"nothing links it to the others (at best 5 matches agree, with 2.jpg; {MIN_INLIERS} are needed)"
    assert why(*some) == best
    assert why(*some, view=2).endswith(f"(at best 9 matches agree, with 1.jpg; {MIN_INLIERS} are needed)")
    assert why(*some, tried(0, 3, 4, moves=True)) == best
    for moving in ([*some, tried(0, 3, 6, moves=True)], [tried(0, 1, 0), tried(0, 3, 0, moves=True)]):
        assert "water below a camera that hovers" in why(*moving)
    assert why(*some, tried(0, 3, 20, ties=20)).startswith("1 links contradict each other")


def test_a_pair_with_a_horizon_becomes_a_mosaic_without_the_far_field() -> None:
    """A corner of the left photograph shows what lies behind the right camera."""
    poses = [
        CameraPose(x_px=0, y_px=0, altitude_px=250, heading_deg=heading_deg, pitch_deg=50) for heading_deg in (0, 80)
    ]
    result = mosaic([view(pose, seed) for seed, pose in enumerate(poses)])
    to_left, to_right = (pose.homography(CAMERA) for pose in poses)
    truth = to_right @ np.linalg.inv(to_left)
    size = (CAMERA.width_px, CAMERA.height_px)
    assert nearness(size, truth, CAMERA.corners).min() < 0
    assert grid_error(result.pairs[0].homography, truth, size, size) < 2
    left, right = result.composition.placements
    assert 0.3 < left.cut_off < 0.9
    assert right.cut_off == 0
    assert 1.2 * size[0] * size[1] < np.count_nonzero(result.image) < 5 * size[0] * size[1]
