"""Which pairs are tried, which are looked at again, and which photographs belong to a flight."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from sim.scene import Flight, make_lawnmower
from skymosaic import mosaic
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.flight.pairing.belonging import find_strangers
from skymosaic.flight.pairing.candidates import first_candidates, predicted
from skymosaic.flight.pairing.second_look import link_across_heights
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import Metadata, Position
from tests.skymosaic.flight import made

SIZE_PX = (400, 300)


def overlap(transforms: dict[int, Array], left: int, right: int) -> float:
    """Share of two views, which are rectangles between the centres of their corner pixels."""
    sides = np.array(SIZE_PX) - 1
    return float(np.prod(np.maximum(1 - np.abs(transforms[left] - transforms[right])[:2, 2] / sides, 0)))


def above(north_deg: float) -> Metadata:
    return Metadata(position=Position(45 + north_deg, 7.0))


def test_each_view_proposes_its_four_nearest_and_the_four_that_resemble_it_most() -> None:
    votes = np.zeros((12, 12), dtype=np.int16)
    votes[0, 5:11] = 9, 20, 19, 18, 17, 9
    votes[1, 7:9] = 9, 8
    # Of what shows nearly the same, the next in order and one more.
    votes[2, [4, 8, 9, 10]] = 200, 199, 198, 197
    votes[3, 9:12] = 129, 128, 127
    # On a line, whose steps grow, the nearest are those before; a view without GPS has none.
    places = [1.0 * number**2 for number in range(11)]
    views = [*(made.view(taken=above(1e-4 * place)) for place in places), made.view()]
    found = first_candidates(views, votes)
    in_order = {(i, i + step) for step in (1, 2) for i in range(12 - step)}
    by_votes = {(0, 6), (0, 7), (0, 8), (0, 9), (1, 7), (2, 8), (3, 9), (3, 11)}
    by_gps = set()
    for view, place in enumerate(places):
        near = sorted((abs(other - place), each) for each, other in enumerate(places) if each != view)[:4]
        by_gps |= {(min(view, each), max(view, each)) for _, each in near}
    assert found == in_order | by_votes | by_gps


@pytest.mark.parametrize(("between", "scale", "proposed"), [(1, 1.0, True), (3, 1.0, False), (3, 2.0, True)])
def test_of_nearly_the_same_only_what_little_else_ties_is_proposed(between: int, scale: float, proposed: bool) -> None:
    last = between + 1
    transforms = {view: np.array([[1.0, 0, 15 * view], [0, 1, 0], [0, 0, 1]]) for view in range(last + 1)}
    transforms[last] = transforms[last] @ np.diag([scale, scale, 1])
    ties = np.zeros((50, 2))
    pairs = [pair for view in range(1, last) for pair in ((0, view), (view, last))]
    links = {pair: Link(*pair, ties, ties, 50, 50) for pair in pairs}
    assert ((0, last) in predicted(made.views(last + 1), transforms, links)) == proposed


@pytest.mark.parametrize(("share", "pairs"), [(0.08, set()), (0.12, {(0, 2)})])
def test_pairs_of_little_overlap_are_not_proposed(share: float, pairs: set[Any]) -> None:
    views = made.views(3)
    step_px = (1 - share) / 2 * (SIZE_PX[0] - 1)
    transforms = {view: np.array([[1.0, 0, step_px * view], [0, 1, 0], [0, 0, 1]]) for view in range(3)}
    ties = np.zeros((50, 2))
    links = {pair: Link(*pair, ties, ties, 50, 50) for pair in ((0, 1), (1, 2))}
    assert overlap(transforms, 0, 2) == pytest.approx(share)
    assert predicted(views, transforms, links) == pairs


SIZE, RATIO = (480, 360), 3


@pytest.fixture(scope="module")
def flight() -> Flight:
    """Every second photograph is taken from three times the height."""
    level = make_lawnmower(3, 4, SIZE, forward_overlap=0.6)
    poses = (
        replace(pose, altitude_px=pose.altitude_px * (RATIO if n % 2 else 1)) for n, pose in enumerate(level.poses)
    )
    return replace(level, poses=tuple(poses))


def test_photographs_of_two_heights_become_one_mosaic(flight: Flight) -> None:
    result = mosaic(list(flight.images), scale=0.25)
    assert result.placed == (0, 1, 2, 3)
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 9), np.linspace(0, SIZE[1] - 1, 9)), -1).reshape(-1, 2)
    for near, far in ((0, 1), (2, 1), (2, 3)):
        true = apply(flight.homography_between(near, far), grid)
        found = apply(np.linalg.inv(result.transforms[far]) @ result.transforms[near], grid)
        assert np.median(np.linalg.norm(found - true, axis=1)) < 0.5


class Stub:
    """A surveyor whose thumbnails have half the size, and that links as a list of numbers of ties says."""

    def __init__(self, *passes: dict[tuple[int, int], int]) -> None:
        self.passes = list(passes)
        self.across: list[Any] = []
        self.asked: list[set[tuple[int, int]]] = []

    def describe_thumbnails(self, views: Any) -> Any:
        return made.views(len(views), to_original=np.diag([4.0, 4, 1]))

    def count_votes(self, views: Any, across: Any) -> Any:
        self.across.append((across, [view.to_original[0, 0] for view in views]))
        votes = np.zeros((len(views), len(views)), np.int16)
        votes[3] = 7, 1, 9, 0, 0
        votes[4] = 0, 2, 1, 0, 0
        return votes

    def link(self, _views: Any, pairs: Any) -> dict[tuple[int, int], Link]:
        self.asked.append(set(pairs))
        points = np.arange(40.0).reshape(20, 2)
        return {pair: Link(*pair, points[:ties], points[:ties], 20, 20) for pair, ties in self.passes.pop(0).items()}


def test_of_two_attempts_across_heights_the_link_with_more_ties_stays() -> None:
    views = made.views(5, to_original=np.diag([2.0, 2, 1]))
    points = np.ones((9, 2))
    links = {pair: Link(*pair, points, points, 9, 9) for pair in ((0, 1), (1, 2), (3, 4))}
    links[2, 3] = Link(2, 3, points[:0], points[:0], 5, 0)
    stub = Stub({(0, 3): 5, (2, 3): 9, (1, 4): 1}, {(0, 3): 8, (2, 3): 8, (2, 4): 2})
    found = link_across_heights(stub, views, links)  # type: ignore[arg-type]
    # One of both is reduced: first those of the small group, then those of the large one.
    assert stub.across == [([3, 4], [2, 2, 2, 4, 4]), ([3, 4], [4, 4, 4, 2, 2])]
    # Each is matched with the two of the large group that resemble it most.
    assert stub.asked == [{(0, 3), (2, 3), (1, 4), (2, 4)}] * 2
    assert {pair: link.ties for pair, link in found.items()} == {(0, 3): 8, (2, 3): 9, (2, 4): 2}
    # Working pixels of the views, of which a thumbnail has half: left, in the first attempt, those of a view.
    assert (found[2, 3].left_points[1].tolist(), found[2, 3].right_points[1].tolist()) == ([2, 3], [4, 6])
    assert (found[0, 3].left_points[1].tolist(), found[0, 3].right_points[1].tolist()) == ([4, 6], [2, 3])
    del links[2, 3]
    links |= {(2, 3): Link(2, 3, points, points, 9, 9)}
    assert link_across_heights(stub, views, links) == {}  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def murky() -> list[Pixels]:
    """Two legs over murky ground: soft, of little contrast, lit from ahead."""
    sharp = make_lawnmower(3, 6, (960, 720), forward_overlap=0.7)
    lamp, rng = np.linspace(1.35, 0.65, 720)[:, None, None], np.random.default_rng(0)
    images = []
    for image in sharp.images:
        soft = cv2.GaussianBlur(np.asarray(image, np.float32), (0, 0), 5)
        lit = (90 + 0.12 * (soft - soft.mean())) * lamp + rng.normal(0, 1, soft.shape)
        images.append(np.asarray(np.clip(np.rint(lit), 0, 255), np.uint8))
    return images


def test_soft_ground_is_linked_by_its_coarse_detail(murky: list[Pixels]) -> None:
    assert mosaic(murky, scale=0.2).placed == tuple(range(6))


TAKEN = Metadata(position=Position(46.0, 8.0), focal_half_diagonals=1.2)


def view(name: str, size: tuple[int, int] = (4000, 3000), taken: Metadata = TAKEN, *, opaque: bool = True) -> View:
    return made.view(name, size, taken=taken, visible=None if opaque else np.zeros((3, 4), np.uint8))


FLIGHT = [view(f"DJI_{number:04}.JPG", (4000, 3000) if number % 3 else (3000, 4000)) for number in range(12)]
ORTHOPHOTO = view("odm_orthophoto.tif", (1920, 1908), Metadata(), opaque=False)
SHEET = view("contact_sheet.jpg", (1200, 699), Metadata())


def test_a_map_and_a_contact_sheet_are_named_with_what_differs() -> None:
    strangers = find_strangers([ORTHOPHOTO, *FLIGHT, SHEET])
    assert list(strangers) == [0, 13]
    assert strangers[13] == (
        "contact_sheet.jpg: no photograph of this flight (1200x699 px instead of 4000x3000 px, no GPS instead of GPS, "
        "no focal length instead of a focal length); `keep_all` takes it"
    )
    assert "odm_orthophoto.tif: no photograph of this flight (1920x1908 px" in strangers[0]
    assert ".tif instead of .jpg, transparent parts instead of all opaque" in strangers[0]


@pytest.mark.parametrize(
    "other",
    [
        view("crop.jpg", (2000, 1500)),
        view("other_camera.jpg", (5472, 3648), replace(TAKEN, position=None)),
        view("without_exif.JPG", taken=Metadata()),
        view("rotated.png", opaque=False),
    ],
)
def test_a_photograph_that_differs_a_little_stays(other: Any) -> None:
    assert not find_strangers([*FLIGHT, other])


@pytest.mark.parametrize("views", [[*FLIGHT[:4], SHEET], [*FLIGHT[:6], *[SHEET] * 4], [*FLIGHT * 2, *[SHEET] * 3]])
def test_of_few_photographs_or_of_several_kinds_all_are_taken(views: list[Any]) -> None:
    assert not find_strangers(views)
    assert list(find_strangers([*FLIGHT[:5], SHEET])) == [5]
    # Two of ten: what eight have is usual, and two of one size are no other source.
    assert list(find_strangers([*FLIGHT[:8], *[SHEET] * 2])) == [8, 9]


def test_photographs_without_records_make_none_of_those_with_them_strange() -> None:
    bare = [view(f"{number}.jpg", (1280, 960), Metadata()) for number in range(9)]
    assert not find_strangers([*bare, FLIGHT[0]])
