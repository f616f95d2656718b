"""Small parts of live mosaicking: anchors, the growing flight, pace, preview and records."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import cv2
import numpy as np
import pytest

from golden_model.arrays import Matrix, Pixels, Records
from golden_model.config import preset_config
from golden_model.front_end import extract
from sim.scene import Flight
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.live_frames import LiveFrame
from skymosaic.mosaicking.live.anchors import MIN_FRAMES, Anchors
from skymosaic.mosaicking.live.growing_flight import GrowingFlight
from skymosaic.mosaicking.live.pace import Pace
from skymosaic.mosaicking.live.preview import paint_preview
from skymosaic.mosaicking.live.update import LiveUpdate
from tests.skymosaic.conftest import SIZE
from tests.skymosaic.mosaicking.live.conftest import pair_errors_px, shift, view_of

LAYOUT_EVERY = 5
CONFIG = preset_config("aerial")


@pytest.fixture(scope="module")
def features(frames: list[Pixels]) -> list[Records]:
    return [extract(frame, CONFIG.front_end).features for frame in frames]


def test_the_canvas_keeps_its_place_while_the_layout_improves(flight: Flight, features: list[Records]) -> None:
    """Each frame is held against all before it as they were placed, whatever later layouts make of them."""
    anchors, places = Anchors(SIZE, CONFIG), {}
    for number, each in enumerate(features):
        slot = each.copy()
        place = anchors.add(number, slot)
        # A ring writes the next frame there.
        slot[:] = 0
        assert (place is None) == (number < LAYOUT_EVERY)
        if place is not None:
            places[number] = place
        if number % LAYOUT_EVERY == LAYOUT_EVERY - 1:
            anchors.lay_out()
    errors = pair_errors_px(places, flight)
    assert len(errors) > 3
    assert errors.max() < 0.15


def test_few_frames_and_other_ground_make_no_canvas(features: list[Records]) -> None:
    anchors = Anchors(SIZE, CONFIG)
    for number, each in enumerate(features[: MIN_FRAMES - 1]):
        anchors.lay_out()
        assert anchors.add(number, each) is None
    anchors.lay_out()
    assert anchors.add(MIN_FRAMES - 1, features[MIN_FRAMES - 1]) is None
    anchors = Anchors(SIZE, CONFIG)
    for number, each in enumerate(features[:MIN_FRAMES]):
        anchors.add(number, each)
    anchors.lay_out()
    elsewhere = features[MIN_FRAMES].copy()
    elsewhere["descriptor"] = np.random.default_rng(1).integers(0, 256, elsewhere["descriptor"].shape)
    assert anchors.add(MIN_FRAMES, elsewhere) is None
    assert anchors.add(MIN_FRAMES + 1, features[MIN_FRAMES]) is not None


def test_what_never_changes_is_no_ground(features: list[Records]) -> None:
    """A display, or dirt on the lens: as good as no motion."""
    anchors = Anchors(SIZE, CONFIG)
    for number in range(2 * MIN_FRAMES):
        assert anchors.add(number, features[0]) is None
        anchors.lay_out()
    # A frame that stands still is placed by those before it.
    for number, each in enumerate(features[: MIN_FRAMES + 1], 2 * MIN_FRAMES):
        anchors.add(number, each)
    anchors.lay_out()
    assert anchors.add(3 * MIN_FRAMES + 1, features[MIN_FRAMES]) is not None


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


PICTURE = Photograph("", np.zeros((64, 64), np.uint8))


def test_what_is_counted_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two key frames of a stream of 15 frames per second come four seconds apart; half a second each is work."""
    now = [100.0]
    monkeypatch.setattr("skymosaic.mosaicking.live.pace.time.monotonic", lambda: now[0])

    def arriving() -> Iterator[LiveFrame]:
        for seen in (60, 120):
            now[0] += 4
            yield LiveFrame(PICTURE, seen)

    pace = Pace(preset_config("aerial"), "golden")
    for number, frame in enumerate(pace.watch(arriving())):
        now[0] += 0.5
        reason = "too few features" if number else ""
        pace.add(LiveUpdate(number, frame.photograph.name, 0.0, None, None, reason, 1))
    assert str(pace) == (
        "120 frames seen, 1 used, 1 dropped; 1 used per second of work (1.0 s), "
        "13.33 seen per second of the clock (9.0 s)"
    )
    assert pace.numbers["used_per_second_of_work"] == 1.0


def test_no_frame_has_no_rate() -> None:
    assert str(Pace(preset_config("aerial"), "golden")) == "0 frames seen, 0 used, 0 dropped"


def frame(thumbnail: Pixels, transform: Matrix) -> tuple[View, Matrix]:
    return replace(view_of(thumbnail), thumbnail=thumbnail, to_thumbnail=np.eye(3)), transform


@pytest.fixture(scope="module")
def ground() -> Pixels:
    grain = np.random.default_rng(0).integers(60, 190, (240, 400, 3), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(grain, (0, 0), 4), np.uint8)


def test_a_preview_shows_the_ground_whatever_the_order_and_size(ground: Pixels) -> None:
    """Upright and turned, beside the middle of the reference frame, and gray ones too."""
    left, right = frame(ground[:, :240], shift(-30, 5)), frame(ground[:, 160:], shift(130, 5))
    np.testing.assert_array_equal(paint_preview([left, right]), ground)
    upside_down = frame(np.ascontiguousarray(ground[::-1, 160:][:, ::-1]), shift(369, 244) @ np.diag([-1.0, -1, 1]))
    np.testing.assert_allclose(paint_preview([left, upside_down]), ground, atol=1)
    np.testing.assert_array_equal(
        paint_preview([frame(ground[..., 0], np.eye(3))]), np.repeat(ground[..., :1], 3, axis=2)
    )
    other = frame(250 - ground[:, :200], np.eye(3))
    for frames in ([frame(ground, np.eye(3)), other], [other, frame(ground, np.eye(3))]):
        where = slice(60, 180), slice(150, None)
        np.testing.assert_array_equal(paint_preview(frames)[where], ground[where])
    assert paint_preview([]).size == 0
    small = paint_preview([frame(ground, shift(7, 9) @ np.diag([3.0, 3, 1]))], width_px=100)
    assert small.shape[1] in (99, 100)
    np.testing.assert_allclose(small, cv2.resize(ground, small.shape[1::-1], interpolation=cv2.INTER_AREA), atol=12)
