"""Small parts of live mosaicking: anchors, the growing flight, pace, preview and records."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Matrix, Pixels, Records
from golden_model.config import preset_config
from golden_model.front_end import extract
from golden_model.geometry.estimator import MAX_CYCLES
from sim.scene import Flight
from skymosaic.flight.layout.adjustment import Network
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View
from skymosaic.flight.pairing.candidates import MIN_VOTES
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.live_frames import LiveFrame
from skymosaic.mosaicking.live import growing_flight as module
from skymosaic.mosaicking.live import record_chain, run
from skymosaic.mosaicking.live.anchors import MIN_FRAMES, Anchors
from skymosaic.mosaicking.live.growing_flight import GrowingFlight, likely_neighbours
from skymosaic.mosaicking.live.pace import Pace
from skymosaic.mosaicking.live.preview import paint_preview
from skymosaic.mosaicking.live.record_chain import link_by_record
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


@pytest.mark.parametrize(("estimator", "least", "most"), [("prosac", 0, 76_800), ("fabric", MAX_CYCLES, 310_000)])
def test_a_homography_on_the_chip_is_part_of_its_pace(estimator: str, least: int, most: int) -> None:
    config = preset_config("aerial")
    pace = Pace(config, "rtl", estimator)
    features = np.zeros(8, config.front_end.pattern.record.dtype)
    for number in range(2):
        pace.add(LiveUpdate(number, "", 0.0, None, None, "", 1, (320, 240), features))
    accelerator = pace.numbers["accelerator"]
    assert least < accelerator["clocks_per_frame"] <= most
    assert str(pace).endswith(
        f"; the accelerator at 150 MHz: {round(150e6 / accelerator['clocks_per_frame'], 1):g} per second, last pixel "
        f"to last match {accelerator['latency_ms']:g} ms"
    )


def test_no_frame_has_no_rate() -> None:
    assert str(Pace(preset_config("aerial"), "golden")) == "0 frames seen, 0 used, 0 dropped"


@pytest.mark.parametrize(("backend", "described", "timed"), [("golden", 2, False), ("rtl", 2, True), ("rtl", 1, False)])
def test_only_described_frames_of_a_simulation_have_clocks(backend: str, described: int, timed: bool) -> None:
    config = preset_config("aerial")
    pace, features = Pace(config, backend), np.zeros(8, config.front_end.pattern.record.dtype)
    for number in range(3):
        given = features if number < described else None
        pace.add(LiveUpdate(number, "", 0.0, None, None, "" if number else "blurred", 1, (320, 240), given))
    assert ("accelerator" in pace.numbers) == timed
    assert (pace.numbers["used"], pace.numbers["dropped"]) == (2, 1)


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


@pytest.mark.parametrize(("width_px", "shape"), [(300, (240, 50)), (120, (240, 50)), (60, (120, 25))])
def test_a_narrow_preview_is_at_most_twice_as_high_as_it_may_be_wide(
    ground: Pixels, width_px: int, shape: tuple[int, int]
) -> None:
    tall = np.ascontiguousarray(ground[:, :50])
    assert paint_preview([frame(tall, np.eye(3))], width_px).shape[:2] == shape


@pytest.mark.parametrize(("preview_s", "least_s", "most_s"), [(0.0625, 1.0, 1.5), (0.5, 5.0, 5.5)])
def test_previews_take_a_tenth_of_the_time_and_come_at_most_once_a_second(
    monkeypatch: pytest.MonkeyPatch, preview_s: float, least_s: float, most_s: float
) -> None:
    """A frame that is left out changes nothing, and shows nothing."""
    now_s, begun, ended, numbers = [0.0], list[float](), list[float](), list[int]()

    def add(*_: Any, **_named: Any) -> Any:
        numbers.append(len(numbers))
        now_s[0] += 0.25
        return SimpleNamespace(reason="" if numbers[-1] % 2 else "blurred")

    def write_preview(*_: Any) -> None:
        begun.append(now_s[0])
        assert numbers[-1] % 2 or numbers[-1] == 98
        now_s[0] += preview_s
        ended.append(now_s[0])

    monkeypatch.setattr(run, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(run, "_write_preview", write_preview)
    growing: Any = SimpleNamespace(add=add, transforms=[0])
    run.grow(growing, (LiveFrame(PICTURE) for _ in range(99)), Path("p.jpg"), print)
    # The last one shows all.
    pauses_s = np.subtract(begun[1:-1], ended[:-2])
    assert numbers[-1] == 98
    assert len(pauses_s) > 3
    assert least_s <= pauses_s.min()
    assert pauses_s.max() <= most_s


RECORD: Any = {"inliers": 40}


@pytest.mark.parametrize(("width_px", "height_px", "columns", "rows"), [(101, 51, 11, 10), (100, 50, 10, 9)])
def test_a_link_ties_what_both_frames_show_of_a_grid(
    monkeypatch: pytest.MonkeyPatch, width_px: int, height_px: int, columns: int, rows: int
) -> None:
    """Of points 10 px apart across and 5 px down, those at the border of the right frame count."""
    shift = np.array([[1.0, 0, -10], [0, 1, 5], [0, 0, 1]])
    monkeypatch.setattr(record_chain, "homography_in_pixels", lambda _record: shift)
    link = link_by_record((3, 4), RECORD, np.zeros((56, 111), np.uint8), np.zeros((height_px, width_px), np.uint8))
    assert (link.left, link.right, link.inliers, link.near, len(link.left_points)) == (3, 4, 40, 40, columns * rows)
    assert link.left_points.min(axis=0).tolist() == [10, 0]
    assert link.right_points.max(axis=0).tolist() == [10 * (columns - 1), 5 * rows]
    assert link.right_points - link.left_points == pytest.approx(np.tile([-10, 5], (columns * rows, 1)))
