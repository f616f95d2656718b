"""What a check says of a flight, and where it says to fly again."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio.features

from skymosaic.flight.checking.check import (
    CLIPPED,
    MIN_BEST_OVERLAP,
    _problems,
    check_flight,
    describe_moving,
    doubts,
    layout_errors,
    weak_parts,
)
from skymosaic.flight.checking.fly_again import find_holes
from skymosaic.flight.flight import BLURRED
from skymosaic.flight.layout.accuracy import Errors
from skymosaic.flight.layout.agreement import Agreement, GroundOfPair
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.imagery.exif import Metadata, Position
from skymosaic.maps.boundary import Boundary
from tests.skymosaic.flight import made


def test_each_problem_of_a_photograph_is_named() -> None:
    assert _problems(1, MIN_BEST_OVERLAP, BLURRED, CLIPPED) == ()
    assert _problems(0, 0.0, 1.0, 0.0) == ("linked with no other photograph",)
    assert _problems(1, 0.1, 0.2, 0.31) == ("overlaps others by 10% at most", "blurred", "31% black or white")


def test_what_many_photographs_lack_is_counted() -> None:
    located = Metadata(position=Position(46, 8))
    views = [made.view(f"{view}.jpg", taken=located if view < 3 else Metadata()) for view in range(5)]
    links = tuple(Link(*pair, *(np.zeros((90, 2)),) * 2, 90, 90) for pair in ((0, 1), (1, 2), (3, 4)))
    layouts = [
        Layout(tuple(members), min(members), {view: np.diag([1.0, 1 + 0.1 * view, 1]) for view in members}, own)
        for members, own in ((range(3), links[:2]), (range(3, 5), links[2:]))
    ]

    def problems(taken: dict[int, Metadata], groups: int = 2) -> tuple[str, ...]:
        seen = [replace(each, taken=taken.get(number, each.taken)) for number, each in enumerate(views)]
        found = check_flight(made.flight(seen, links, layouts[:groups], names=tuple("012345")))
        assert not found.complete
        return found.problems

    unusable, groups, gps = problems({})
    assert unusable == "1 of 6 photographs cannot be used or repeat another"
    assert groups.startswith("2 groups that no link joins for sure (3, 2 photographs): fly again between them")
    assert gps == "2 of 5 photographs have no GPS"
    faulty = Metadata(gps_fault="that is no position")
    assert problems({4: faulty})[2] == f"{gps} that can be used: 1 has GPS that is no position"
    assert problems({}, groups=1)
    advice = "photographs are registered at 400 to {} px wide: --working-width 400 makes them alike"
    for width_px, other_focal, said in ((801, 2, True), (801, 3, False), (800, 2, False)):
        views[0] = replace(views[0], working_size=(width_px, 300))
        alike, other = Metadata(focal_half_diagonals=2), Metadata(focal_half_diagonals=other_focal)
        assert (advice.format(width_px) in problems(dict.fromkeys(range(5), alike) | {1: other})) is said


def test_photographs_far_off_are_named_and_more_than_three_are_counted() -> None:
    flight = made.flight(made.views(6, (1280, 960)))
    for count, more in ((3, ""), (5, " and 2 more")):
        errors = {view: Errors(20, 60.0 - 10 * view if view < count else 10.0, 99.0) for view in range(6)}
        accuracy = SimpleNamespace(photographs=errors, whole=Errors(120, 10.0, 19.0))
        layout: Any = SimpleNamespace(
            links=[], contradicting=[], relief=0.0, accuracy=accuracy, members=range(6), agreement=Agreement()
        )
        named = "0.jpg by 60 px, 1.jpg by 50 px, 2.jpg by 40 px"
        assert list(doubts(flight, layout)) == [f"photographs are off: {named}{more}: look at the mosaic there"]


def test_what_moves_with_the_camera_or_does_not_move_is_said() -> None:
    views = made.views(3)
    nothing, some = np.zeros((0, 2)), np.ones((5, 2))

    def describe(offset_px: float, moving: int, mask: Any = None) -> str:
        links = [Link(*pair, some, some, 5, 5, *(nothing,) * 2) for pair in ((0, 1), (0, 2), (1, 2))]
        links = [replace(link, left_moving=some) if number < moving else link for number, link in enumerate(links)]
        places = {view: np.array([[1.0, 0, view * offset_px], [0, 1, 0], [0, 0, 1]]) for view in range(3)}
        layout = Layout((0, 1, 2), 0, places, tuple(links))
        return describe_moving(made.flight(views, links, [layout], found_mask=mask))

    assert describe(10.0, 0) == ""
    assert describe(1.9, 0).startswith("all photographs of a group show one place")
    assert describe(2.1, 0) == ""
    assert "in 2 of 3 pairs: --mask hides" in describe(1.9, 2)
    assert "50% of each photograph is masked" in describe(10.0, 2, np.array([[0, 255]]))


def test_a_layout_with_many_contradicting_links_is_doubted_by_name() -> None:
    nothing = np.zeros((0, 2))
    links = tuple(Link(view, view + 1, nothing, nothing, 0, 0) for view in range(59))
    flight = made.flight(made.views(60))
    few = Layout(tuple(range(60)), 0, {}, links=links[1:], contradicting=links[:1])
    assert list(doubts(flight, few)) == []
    many = Layout(tuple(range(60)), 0, {}, links=links[2:], contradicting=links[:2])
    (line,) = doubts(flight, many)
    assert line.startswith("2 of 59 links contradict the layout (most at 1.jpg, ")


def test_a_photograph_that_lies_wrong_is_named_with_its_error() -> None:
    points = np.random.default_rng(0).uniform(0, 500, (20, 2))
    nothing = points[:0]
    links = tuple(
        Link(left, right, nothing, nothing, 20, 20, left_checks=points, right_checks=points + np.array([off_px, 0]))
        for left, right, off_px in ((0, 1, 1), (0, 2, 1), (1, 2, 1), (0, 3, 50), (2, 3, 40))
    )
    flight = made.flight([made.view(f"folder/{view}.jpg", (1280, 960)) for view in range(4)])
    # The links that place the photograph falsely contradict, so the fit itself knows nothing of them.
    layout = Layout((0, 1, 2, 3), 0, dict.fromkeys(range(4), np.eye(3)), links=links[:3], contradicting=links[3:])
    assert [line for line in doubts(flight, layout) if "3.jpg by 45 px" in line]
    errors = layout_errors(flight, layout)
    assert errors is not None
    assert (errors.matches, round(errors.median_px, 6), errors.width_px) == (100, 1, 1280)
    assert round(errors.ninety_px, 6) == 50
    assert next((name, round(error, 6)) for name, error in errors.worst_photographs.items()) == ("3.jpg", 45)
    pairs = [(name, round(error, 6)) for name, error in errors.worst_pairs.items()]
    assert pairs[:2] == [("0.jpg-3.jpg", 50), ("2.jpg-3.jpg", 40)]


def test_a_scene_that_is_no_plane_is_called_one_with_its_figures() -> None:
    points = np.random.default_rng(0).uniform(0, 500, (20, 2))
    checks: Any = {"left_checks": points, "right_checks": points + np.repeat([[0, 0], [3, 4]], (2, 18), axis=0)}
    flight = made.flight(made.views(2, (1280, 960)))
    for near, expected in ((28, []), (40, ["the scene is no plane: 50% of the matches lie 3 to 12 px off it"])):
        link = Link(0, 1, points, points, 20, near, **checks)
        lines = list(doubts(flight, Layout((0, 1), 0, {0: np.eye(3), 1: np.eye(3)}, links=(link,))))
        assert [line.split(", and")[0] for line in lines] == expected
    assert "off by 5.0 px, one in ten beyond 5 px" in lines[0]


@pytest.mark.parametrize(("off_px", "warned"), [(19, False), (20, True)])
def test_lines_that_break_at_seams_are_warned_of(off_px: float, warned: bool) -> None:
    points = np.random.default_rng(0).uniform(0, 500, (20, 2))
    moved = points + np.repeat([[0, 0], [off_px, 0]], (17, 3), axis=0)
    link = Link(0, 1, points, points, 20, 20, left_checks=points, right_checks=moved)
    layout = Layout((0, 1), 0, {0: np.eye(3), 1: np.eye(3)}, links=(link,))
    flight = made.flight(made.views(2, (1280, 960)))
    expected = "lines may break at seams: one match in ten is off by more than 20 px"
    assert list(doubts(flight, layout)) == [expected] * warned


def test_halves_that_only_weak_links_join_are_named_with_their_number() -> None:
    def weak_line(across: tuple[tuple[int, int, int], ...], last: int = 80, step_px: float = 40) -> str:
        ties = {(0, 1): 90, (0, 2): 90, (1, 2): 90, (3, 4): last} | {(left, right): few for left, right, few in across}
        links = tuple(Link(*pair, *(np.zeros((many, 2)),) * 2, many, many) for pair, many in ties.items())
        places = {view: np.array([[1.0, 0, step_px * view], [0, 1, 0], [0, 0, 1]]) for view in range(5)}
        views = [made.view(f"folder/{view}.jpg") for view in range(5)]
        flight = made.flight(views, links, [Layout(tuple(range(5)), 0, places, links)])
        lines = check_flight(flight).problems
        lefts = [link.left for _, _, link, _ in weak_parts(flight, flight.layouts[0])]
        assert lefts == [int(number) for line in lines for number in re.findall(r"(\d).jpg and", line)]
        return "; ".join(lines)

    between = "2.jpg and 3.jpg with 30 matches and 90% overlap: fly again there"
    assert weak_line(((2, 3, 30),)) == f"2 photographs are joined only by the link between {between}"
    several = ((2, 3, 30), (1, 3, 20), (0, 4, 15))
    assert weak_line(several) == f"2 photographs are joined only by 3 weak links, the best between {between}"
    last = "1 photograph is joined only by the link between 3.jpg and 4.jpg with 20 "
    assert weak_line(((2, 3, 90),), last=20).startswith(last)
    # Matches or overlap are enough to be weak, and the limits are.
    assert weak_line(((2, 3, 40),)) == ""
    assert "with 39 matches" in weak_line(((2, 3, 39),))
    assert "90 matches and 19% overlap: fly" in weak_line(((2, 3, 90), (1, 3, 50)), step_px=322)
    # Two photographs that hang on one link are named once.
    assert weak_line(((2, 3, 30),), last=20).count("joined") == 2
    assert weak_line(((2, 3, 20),), last=30).startswith("1 photograph is joined only by 2 weak links, the best")
    assert weak_line(((2, 3, 20),), last=30).count("joined") == 1


def test_ground_that_lies_on_other_ground_is_named_with_its_place() -> None:
    views = made.views(4)
    views[2] = replace(views[2], taken=Metadata(position=Position(46.5, 8.25)))
    flight = made.flight(views)
    differs, agrees, unknown = GroundOfPair(1, 9, 4.0, 0), GroundOfPair(2, 9, 4.0, 0), GroundOfPair(0, 3, np.inf, 0)
    pairs = {(0, 2): differs, (1, 2): differs, (2, 3): unknown, (0, 1): agrees}
    nothing = np.zeros((0, 2))
    links = (Link(0, 2, nothing, nothing, 0, 0),)
    layout = Layout((0, 1, 2, 3), 0, dict.fromkeys(range(4), np.eye(3)), links, agreement=Agreement(pairs))
    assert list(doubts(flight, layout)) == [
        "2 pairs of photographs lie on each other and show different ground, 1 of them without a link "
        "(most at 2.jpg near 46.50000, 8.25000, 0.jpg, 1.jpg): look at the mosaic there"
    ]
    assert list(doubts(flight, replace(layout, agreement=layout.agreement.without({2})))) == []
    repeated = replace(agrees, repeats=True)
    assert list(doubts(flight, replace(layout, agreement=Agreement({(0, 1): agrees, (0, 2): repeated})))) == []
    both = replace(layout, agreement=Agreement({(0, 1): agrees, (0, 2): repeated, (1, 2): repeated}), links=links * 7)
    closed, doubtful = replace(both, links=links * 8), replace(both, links=links * 500, contradicting=links)
    warned = [
        "the ground repeats itself: 2 of 3 pairs that overlap by half look the same a step aside, so photographs may "
        "lie a step off: look at the mosaic"
    ]
    assert [list(doubts(flight, each)) for each in (both, closed, doubtful)] == [warned, [], warned]


SIZE_M, CELL_M = np.array([80.0, 60.0]), 0.25


def flown(rng: np.random.Generator, *, overlap: float, turn_deg: float) -> dict[tuple[int, int], np.ndarray]:
    """Outlines of six strips of eight photographs, as a drone in wind takes them, by strip and place in it."""
    turn = np.radians(turn_deg)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * SIZE_M / 2
    outlines = {}
    for strip in range(6):
        for place in range(8):
            middle = np.array([place, strip]) * SIZE_M * (1 - overlap) + rng.normal(0, 0.5, 2)
            yaw = np.radians(rng.normal(0, 1))
            yawed = corners @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
            outlines[strip, place] = (yawed + middle) @ axes + [500_000, 5_000_000]
    return outlines


def rasterise(rings: Any) -> np.ndarray:
    shapes = [{"type": "Polygon", "coordinates": [[*ring.tolist(), ring[0].tolist()]]} for ring in rings]
    if not shapes:
        return np.zeros((2400, 3200), np.uint8)
    to_map = rasterio.Affine(CELL_M, 0, 500_000 - 250, 0, CELL_M, 5_000_000 - 150)
    return rasterio.features.rasterize(shapes, (2400, 3200), transform=to_map, dtype="uint8")


@pytest.mark.parametrize("turn_deg", [0.0, 37.0])
@pytest.mark.parametrize(
    ("overlap", "lost"),
    [
        (0.2, {(2, 3)}),
        (0.35, {(3, place) for place in range(8)}),
        (0.4, {(strip, place) for strip in (2, 3) for place in (3, 4, 5)}),
        (0.3, {(1, 5), (1, 6), (4, 2)}),
    ],
)
def test_holes_are_what_the_lost_photographs_alone_showed(
    overlap: float, lost: set[tuple[int, int]], turn_deg: float
) -> None:
    outlines = flown(np.random.default_rng(3), overlap=overlap, turn_deg=turn_deg)
    kept = [ring for place, ring in outlines.items() if place not in lost]
    truth = rasterise(outlines.values()) & ~rasterise(kept) & 1
    holes = find_holes(kept)
    # Counter-clockwise, so their areas are positive.
    assert [cv2.contourArea(np.float32(ring - ring[0]), oriented=True) for ring, _ in holes] == pytest.approx(
        [area_m2 for _, area_m2 in holes]
    )
    found = rasterise([ring for ring, _ in holes])
    common = np.sum(truth & found)
    assert common / found.sum() > 0.97
    assert common / truth.sum() > 0.97
    assert sum(area_m2 for _, area_m2 in find_holes(kept)) == pytest.approx(found.sum() * CELL_M**2, rel=0.02)


def test_a_notch_of_the_border_is_no_hole_unless_the_area_has_it() -> None:
    """Between two photographs, a third lies 7 m lower: a notch 6 m wide, 0.8 % of a photograph."""
    corners = np.array([[0, 0], [80, 0], [80, 60], [0, 60]], np.float64)
    strip = [corners + np.array(step) for step in ((0, 0), (40, -7), (86, 0))]
    assert not find_holes(strip)
    ring = np.array([[0.0, 0], [160, 0], [160, 70], [0, 70], [0, 0]])
    ((_, area_m2),) = find_holes(strip, Boundary("area", "EPSG:32632", ((ring,),)))
    assert area_m2 == pytest.approx(10 * 160 + 6 * 7, rel=0.02)
