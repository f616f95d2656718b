from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.scene import Flight, make_lawnmower
from skymosaic import mosaic
from skymosaic.flight.linking.links import Link
from skymosaic.flight.pairing import linked_views
from skymosaic.flight.pairing.second_look import link_across_heights
from skymosaic.geometry.homography import apply

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
        return [SimpleNamespace(to_original=np.diag([4.0, 4, 1])) for _ in views]

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
    views: Any = [SimpleNamespace(to_original=np.diag([2.0, 2, 1])) for _ in range(5)]
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


@pytest.mark.slow
def test_links_across_heights_are_what_joins_them(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linked_views, "link_across_heights", lambda *_: {})
    assert len(mosaic(list(flight.images)).left_out) == 2


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


@pytest.mark.slow
def test_coarse_detail_is_what_links_it(murky: list[Pixels], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linked_views, "link_by_coarse_detail", lambda *_: {})
    assert len(mosaic(murky, scale=0.2).placed) < 6
