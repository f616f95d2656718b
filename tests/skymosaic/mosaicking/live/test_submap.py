"""Which frames a new one is held against, and when all are laid out, of frames whose places are known."""

from typing import Any

import numpy as np
import pytest

from skymosaic.flight.linking.links import Link
from skymosaic.flight.pairing.candidates import MIN_VOTES
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.exif import Metadata
from skymosaic.mosaicking.live import submap as module
from skymosaic.mosaicking.live.submap import Frame, Submap, likely_neighbours

SIZE = (100, 80)
NO_FEATURES, THUMBNAIL = np.zeros(0, [("response", "<u2")]), np.zeros((8, 10), np.uint8)


def frame(number: int, x: float, y: float = 0.0) -> Frame:
    place = np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
    return Frame(number, SIZE, NO_FEATURES, np.eye(3), place, "", Metadata(), THUMBNAIL, np.eye(3))


def linked(left: Frame, right: Frame, ties: int = 30, off_px: float = 0.0) -> Link:
    """A link of true points that are off by as much along x."""
    ground = np.random.default_rng(left.number).uniform((-200, -200), (600, 400), (ties, 2))
    seen = [ground - each.transform[:2, 2] for each in (left, right)]
    return Link(left.number, right.number, seen[0], seen[1] + (off_px, 0), ties, ties)


def holding(*frames: Frame, **changes: Any) -> Submap:
    held = Submap(lambda left, right: linked(left, right, **changes.get(str(left.number), {})))
    for each in frames:
        held.add(each)
    return held


def test_the_latest_frames_are_tried_and_then_those_with_most_votes(monkeypatch: pytest.MonkeyPatch) -> None:
    placed = [frame(number, 0) for number in range(11)]
    # Of frames 7 to 0, as older ones come later.
    votes = [MIN_VOTES, 40, MIN_VOTES - 1, 60, 50, 0, 20, 40]
    monkeypatch.setattr(module, "count_votes", lambda _, others: votes[: len(others)])
    assert [each.number for each in likely_neighbours(frame(11, 0), placed)] == [10, 9, 8, 4, 3, 6, 0]
    votes[1], votes[6] = 0, 0
    assert [each.number for each in likely_neighbours(frame(11, 0), placed)] == [10, 9, 8, 4, 3, 0, 7]
    votes[7] = 0
    assert [each.number for each in likely_neighbours(frame(11, 0), placed)] == [10, 9, 8, 4, 3, 7]
    assert [each.number for each in likely_neighbours(frame(11, 0), placed[:2])] == [1, 0]


def test_neighbours_are_those_that_add_most_ground() -> None:
    """Frame 1 shows what 0 shows, frame 5 what 4 shows, and frame 6 too little."""
    around = [frame(0, 30), frame(1, 31), frame(2, -30), frame(3, 0, 50), frame(4, 0, -50), frame(5, 0, -55)]
    placement = holding(*around, frame(6, 92, 70)).register(frame(9, 0), around[0])
    assert placement is not None
    assert placement.neighbours == (0, 2, 3, 4)
    np.testing.assert_allclose(placement.transform, np.eye(3), atol=1e-6)
    corners = [
        frame(0, 500),
        *(frame(n, x, y) for n, (x, y) in enumerate([(50, 40), (-50, 40), (50, -40), (-52, -42)], 1)),
    ]
    most = holding(*corners).register(frame(9, 0), corners[0])
    assert most is not None
    assert most.neighbours == (0, 1, 2, 3)


@pytest.mark.parametrize(("ties", "placed"), [(MIN_INLIERS, True), (MIN_INLIERS - 1, False), (0, False)])
def test_a_frame_needs_enough_ties(ties: int, placed: bool) -> None:
    held = holding(frame(0, 30), **{"0": {"ties": ties}})
    placement = held.register(frame(1, 0), held.frames[0])
    assert (placement is not None) == placed
    assert len(held.links) == placed
    if placement is not None:
        assert placement.ties == ties


def test_a_neighbour_that_contradicts_the_first_is_left_out() -> None:
    half = {"ties": MIN_INLIERS, "off_px": 40.0}
    held = holding(frame(0, 30), frame(1, -30), **{"0": {"ties": MIN_INLIERS}, "1": half})
    placement = held.register(frame(2, 0), held.frames[0])
    assert placement is not None
    assert placement.neighbours == (0,)
    assert [link.left for link in held.links] == [0]


@pytest.mark.parametrize(("at_last", "frames", "at"), [(False, 17, [4, 8, 16]), (True, 3, [3])])
def test_the_layout_is_made_anew_when_the_frames_have_doubled(
    monkeypatch: pytest.MonkeyPatch, at_last: bool, frames: int, at: list[int]
) -> None:
    made, held = list[int](), Submap(linked)

    def lay_out() -> dict[int, Frame]:
        made.append(len(held.frames))
        return held.frames

    monkeypatch.setattr(held, "_lay_out", lay_out)
    for number in range(frames):
        held.add(frame(number, number))
        held.settle(at_last=at_last)
    assert made == at
