"""Which views a new one is held against, and when all are laid out, of views whose places are known."""

from collections.abc import Mapping

import numpy as np
import pytest

from golden_model.arrays import Matrix
from skymosaic.flight.layout.adjustment import Network
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View
from skymosaic.flight.pairing.candidates import MIN_VOTES
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.mosaicking.live import growing_flight as module
from skymosaic.mosaicking.live.growing_flight import GrowingFlight, likely_neighbours
from tests.skymosaic.mosaicking.live.conftest import shift, view_of

VIEW = view_of(np.zeros((80, 100), np.uint8))


class Placed(GrowingFlight):
    """Views at known places; links are of true points, ``ties`` of them, off by ``off_px`` along x, by the left view.

    The last of the places is that of a view to be added.
    """

    def __init__(
        self, *places: tuple[float, float], ties: Mapping[int, int] = {}, off_px: Mapping[int, float] = {}
    ) -> None:
        super().__init__(self.link_truly)
        self.places = [shift(*place) for place in places]
        self.ties, self.off_px = ties, off_px
        self.views = dict.fromkeys(range(len(places) - 1), VIEW)
        self.parts = {0: dict(enumerate(self.places[:-1]))}

    def link_truly(self, pair: Candidate, _left: View, _right: View) -> Link:
        count = self.ties.get(pair[0], 30)
        ground = np.random.default_rng(pair[0]).uniform((-200, -200), (600, 400), (count, 2))
        left, right = (ground - self.places[number][:2, 2] for number in pair)
        return Link(*pair, left, right + np.array([self.off_px.get(pair[0], 0.0), 0]), count, count)


def test_the_latest_views_are_tried_and_then_those_with_most_votes(monkeypatch: pytest.MonkeyPatch) -> None:
    placed = dict.fromkeys(range(11), VIEW)
    # Of views 7 to 0, as older ones come later.
    votes = [MIN_VOTES, 40, MIN_VOTES - 1, 60, 50, 0, 20, 40]
    monkeypatch.setattr(module, "count_votes", lambda _, others: votes[: len(others)])
    assert list(likely_neighbours(VIEW, placed)) == [10, 9, 8, 4, 3, 6, 0]
    votes[1], votes[6] = 0, 0
    assert list(likely_neighbours(VIEW, placed)) == [10, 9, 8, 4, 3, 0, 7]
    votes[7] = 0
    assert list(likely_neighbours(VIEW, placed)) == [10, 9, 8, 4, 3, 7]
    assert list(likely_neighbours(VIEW, dict.fromkeys(range(2), VIEW))) == [1, 0]


@pytest.mark.parametrize(
    ("places", "neighbours"),
    [
        # View 1 shows what 0 shows, view 5 what 4 shows, and view 6 too little.
        ([(92, 70), (0, -55), (0, -50), (0, 50), (-30, 0), (31, 0), (30, 0)], (6, 4, 2, 3)),
        ([(-52, -42), (50, -40), (-50, 40), (50, 40), (500, 0)], (4, 1, 2, 3)),
    ],
)
def test_neighbours_are_those_that_add_most_ground(places: list[tuple[float, float]], neighbours: tuple[int]) -> None:
    flight = Placed(*places, (0, 0))
    placement = flight.add(len(places), VIEW)
    assert placement is not None
    assert placement.neighbours == neighbours
    np.testing.assert_allclose(placement.transform, np.eye(3), atol=1e-6)


@pytest.mark.parametrize(("ties", "placed"), [(MIN_INLIERS, True), (MIN_INLIERS - 1, False), (0, False)])
def test_a_view_needs_enough_ties(ties: int, placed: bool) -> None:
    flight = Placed((30, 0), (0, 0), ties={0: ties})
    placement = flight.add(1, VIEW)
    assert (placement is not None) == (1 in flight.views) == placed
    assert [link.holds for link in flight.links.values()] == [placed] * (placed or not ties)
    if placement is not None:
        assert placement.ties == ties


def test_a_neighbour_that_contradicts_the_first_is_left_out() -> None:
    flight = Placed((-30, 0), (30, 0), (0, 0), ties=dict.fromkeys((0, 1), MIN_INLIERS), off_px={0: 40.0})
    placement = flight.add(2, VIEW)
    assert placement is not None
    assert placement.neighbours == (1,)
    assert list(flight.links) == [(1, 2)]


def test_the_layout_is_made_anew_when_the_views_have_doubled(monkeypatch: pytest.MonkeyPatch) -> None:
    made, places = list[int](), [(float(number), 0.0) for number in range(17)]
    flight = Placed(*places)
    fit = Network.adjust

    def adjust(*given: object, **named: object) -> Matrix:
        made.append(len(given[1]))  # type: ignore[arg-type]
        return fit(*given, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(Network, "adjust", adjust)
    flight.views, flight.parts = {0: VIEW}, {0: {0: shift(0, 0)}}
    for number in range(1, 17):
        flight.add(number, VIEW)
        flight.settle()
    # Views are fitted one by one between them, in a network of two.
    assert [count for count in made if count > 2] == [4] * 3 + [8] * 3 + [16] * 3
    flight.lay_out(0)
    assert made[-1] == 17
