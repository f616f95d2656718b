"""What tabs, sidebar and drawings of the mosaic page show."""

import asyncio
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from nicegui import Client
from nicegui.page import page as nicegui_page

from golden_model.config import preset_config
from golden_model.records import MATCH
from sim.scene import make_pair
from skymosaic import register
from skymosaic.features.backends import load_backend
from skymosaic.geometry.homography import transfer_error
from skymosaic.panel.options import Options
from skymosaic.panel.pages import drawings
from skymosaic.panel.pages.corners_tab import CornersTab, detect
from skymosaic.panel.pages.drawings import draw_corners
from skymosaic.panel.pages.matches_tab import MatchesTab
from skymosaic.panel.pages.result_tabs import _describe_homography, _list_quality
from skymosaic.panel.pages.runs_page import build_runs_page
from skymosaic.panel.pages.sidebar import PhotographsCard
from skymosaic.panel.results import Picture
from skymosaic.panel.runs import Runs
from skymosaic.panel.session import Session
from skymosaic.panel.widgets import MAX_TILES
from tests.skymosaic.panel import made_up
from tests.skymosaic.panel.visitor import Scenario


def test_the_nearest_line_is_found_only_within_the_distance() -> None:
    lines = np.array([[0, 0, 100, 0], [0, 50, 100, 50], [200, 0, 200, 0]], dtype=np.float64)
    assert drawings.find_nearest(lines, 50, 10, within=12) == 0
    assert drawings.find_nearest(lines, 50, 41, within=12) == 1
    assert drawings.find_nearest(lines, 50, 25, within=12) is None
    assert drawings.find_nearest(lines, 110, 50, within=12) == 1
    assert drawings.find_nearest(lines, 203, 4, within=6) == 2
    assert drawings.find_nearest(lines[:0], 0, 0, within=1e9) is None
    assert drawings.find_nearest(lines[:1], 50, 12, within=12) == 0
    assert drawings.find_nearest(lines[:1], -9, 12, within=15) == 0
    assert drawings.find_nearest(lines[:1], -9, 12, within=14.9) is None


def test_outlines_seams_and_links_lie_where_the_photographs_do() -> None:
    square = np.array([[0.0, 0], [60, 0], [60, 40], [0, 40]])
    outlines = {"a": square, "b": square + 100, "c": np.add(square, (0, 20))}
    drawn = drawings.draw_outlines([square, square + 100])
    assert 'points="100.0,100.0 160.0,100.0 160.0,140.0 100.0,140.0"' in drawn
    assert ('x="30" y="20">1<' in drawn, 'x="130" y="120">2<' in drawn) == (True, True)
    assert 'd="M0.0 0.0L60.0 0.0L60.0 40.0Z"' in drawings.draw_seams([square[:3]])
    linked = [("a", "b", 50), ("a", "left out", 90), ("left out", "b", 90), ("b", "c", 400), ("b", "c", 199)]
    weak, strong, almost, end = drawings.draw_links(outlines, linked).split("/>")
    assert (end, "hsl(119 " in almost) == ("", True)
    assert weak == (
        '<path class="link" style="stroke: hsl(30 75% 55%); stroke-width: 2.0px" d="M30.0 20.0L130.0 120.0"'
    )
    assert strong == (
        '<path class="link" style="stroke: hsl(120 75% 55%); stroke-width: 5.0px" d="M130.0 120.0L30.0 40.0"'
    )


def test_corners_have_ticks_along_their_orientation() -> None:
    corners = np.zeros(2, preset_config("aerial").front_end.pattern.record.dtype)
    corners["x"], corners["y"], corners["level"], corners["sector"] = (168, 320), (32, 48), (0, 1), (4, 9)
    assert drawings.draw_corners(corners, offset_px=50) == (
        '<path class="tick level-0" d="M60.5 2.0l0.0 7.0"/><path class="dot level-0" d="M60.5 2.0h0"/>'
        '<path class="tick level-1" d="M70.0 3.0l-12.9 -5.4"/><path class="dot level-1" d="M70.0 3.0h0"/>'
    )


def test_matches_are_drawn_rejected_ones_first_and_the_chosen_one_on_top() -> None:
    matches = np.zeros(3, MATCH.dtype)
    matches["left_x"], matches["left_y"], matches["right_x"], matches["right_y"] = (16, 32, 48), 8, (160, 176, 192), 24
    lines = drawings.locate_matches(matches, offset_px=100)
    assert lines.tolist() == [[1, 0.5, 110, 1.5], [2, 0.5, 111, 1.5], [3, 0.5, 112, 1.5]]
    assert drawings.draw_matches(lines, ["inlier", "outlier", "rejected"], [0, 2]) == (
        '<path class="match rejected" d="M3.0 0.5L112.0 1.5"/><path class="match inlier" d="M1.0 0.5L110.0 1.5"/>'
    )
    assert drawings.draw_chosen_match(lines[1], "outlier") == (
        '<path class="match chosen-back" d="M2.0 0.5L111.0 1.5"/><path class="match chosen outlier" '
        'd="M2.0 0.5L111.0 1.5"/><path class="chosen-end outlier" d="M2.0 0.5h0M111.0 1.5h0"/>'
    )


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "field.png"
    cv2.imwrite(str(path), make_pair(seed=9, size=(400, 300)).images[0])
    return path


@pytest.mark.parametrize("detector", ["harris", "fast"])
def test_the_slider_shows_the_corners_of_a_run(picture: Path, detector: str) -> None:
    pixels, counts = np.asarray(cv2.imread(str(picture))), set()
    for position in {"harris": (19, 30, 38), "fast": (2, 20, 34)}[detector]:
        options = Options.of_preset("aerial").changed("detector", detector).changed("position", position)
        (shown,) = detect([picture], options)
        (found,) = load_backend("golden").run([pixels], options.choose_method()[1])
        assert np.array_equal(shown, found.features)
        counts.add(len(shown))
    assert len(counts) == 3


def test_without_cell_selection_the_threshold_rises_until_all_corners_fit(picture: Path) -> None:
    lowest = Options.of_preset("thesis").changed("position", 19)
    (shown,) = detect([picture], lowest)
    assert 0 < len(shown) <= lowest.choose_method()[1].front_end.max_features


@pytest.mark.parametrize(
    ("descriptor", "name", "drawn"),
    [("ilbp-128", "field.png", 1), ("akaze", "field.png", 0), ("ilbp-128", "gone.png", 0)],
)
def test_corners_are_drawn_until_they_fit_the_options(picture: Path, descriptor: str, name: str, drawn: int) -> None:
    """Options that cannot be combined change nothing, and a session that is closed ends it."""
    said: list[str] = []
    tab: Any = CornersTab.__new__(CornersTab)
    tab._session = SimpleNamespace(options=Options.of_preset("aerial").changed("descriptor", descriptor))
    photograph: Any = SimpleNamespace(working=picture.with_name(name), working_size=(400, 300))
    tab._photographs, tab._drawn = (photograph, photograph), ()
    tab._viewer = SimpleNamespace(draw=said.append)
    tab._counts = SimpleNamespace(set_text=said.append)
    asyncio.run(tab._detect_and_draw())
    assert not tab._detecting
    assert len(said) == 2 * drawn
    if drawn:
        corners = detect([picture, picture], tab._session.options)
        assert said[0] == "".join(draw_corners(found, x) for found, x in zip(corners, (0, 412), strict=True))
        assert re.fullmatch(rf"{len(corners[0])} and {len(corners[0])} corners, detected in [1-9]\d* ms", said[1])
        assert tab._drawn == tab._inputs()


def test_a_homography_is_described_by_its_turn_scale_and_shift() -> None:
    cos, sin = np.cos(np.radians(30)), np.sin(np.radians(30))
    turned = np.array([[1.5 * cos, -1.5 * sin, 7], [1.5 * sin, 1.5 * cos, -3], [0, 0, 1]])
    assert _describe_homography(turned).endswith("rotates by 30.00°, scales by 1.5000, shifts by 7.0, -3.0 px")


def test_quality_is_measured_on_inliers_and_correct_matches() -> None:
    left, right = make_pair(9, size=(320, 240)).images
    pair = register(left, right)
    assert pair.homography is not None
    found = _list_quality(pair)
    ends = pair.points("inliers")
    rmse_px = np.sqrt(np.mean(transfer_error(pair.homography, ends.left, ends.right) ** 2))
    assert float(found["RMSE of the inliers"].removesuffix(" px")) == pytest.approx(rmse_px, abs=0.05)
    assert float(found["recall of the rules"]) > 0.8
    assert float(found["1 - precision"]) < 0.2
    assert found["computed by"] == "golden"
    assert found["confidence"].startswith("good: ")
    refined = [_list_quality(pair.with_homography(pair.homography, refined_inliers=n))["refined by"] for n in (0, 7)]
    assert refined == ["no dense flow", "7 points of dense flow"]


@pytest.mark.parametrize(
    ("count", "done", "text"),
    [
        (3, None, "3 photographs"),
        (3, 1, "3 photographs, 1 read"),
        (3, 3, "3 photographs"),
        (MAX_TILES, 0, f"{MAX_TILES} photographs, 0 read"),
        (MAX_TILES + 1, None, f"{MAX_TILES + 1} photographs, the first {MAX_TILES} are shown"),
    ],
)
def test_photographs_are_counted_while_they_are_read(count: int, done: int | None, text: str) -> None:
    reading = None if done is None else SimpleNamespace(steps=SimpleNamespace(done=done))
    said: list[Any] = []
    card: Any = SimpleNamespace(
        _session=SimpleNamespace(inputs=SimpleNamespace(photographs=[None] * count, reading=reading)),
        _count=SimpleNamespace(set_text=said.append),
        _tiles=SimpleNamespace(show=said.append),
    )
    card._read = lambda: PhotographsCard._read(card)
    PhotographsCard._tick(card)
    assert said == [text, *([] if done is None else [done])]


@pytest.fixture
def tab(run_in_loop: Callable[[Scenario], None]) -> MatchesTab:
    """Eight matches: one is rejected, one off the homography; the right picture begins at 332 px."""
    made: list[MatchesTab] = []

    async def build() -> None:
        with Client(nicegui_page("/matches"), request=None):
            pictures = Picture("/left", 320, 120), Picture("/right", 320, 120, 332)
            made.append(MatchesTab(made_up.pair("a.png", "b.png", Options.of_preset("aerial")), pictures))

    run_in_loop(build)
    return made[0]


def state(tab: MatchesTab) -> tuple[str, bool]:
    """What is said of the match shown, and whether it is explained."""
    return tab._number.text, "px from the homography" in tab._explanation.content


def test_hovering_explains_a_match_and_a_click_keeps_it(tab: MatchesTab) -> None:
    assert state(tab) == ("8 matches", False)
    tab._hover(40, 100.1, 1)
    assert state(tab) == ("match 1 of 8", True)
    # Nothing is within 10 px of the screen.
    tab._hover(40, 100.3, 1)
    tab._hover(70, 91, 2)
    assert state(tab) == ("match 1 of 8", True)
    tab._pick(70, 85, 1)
    tab._hover(40, 90, 1)
    assert state(tab) == ("match 2 of 8, pinned", True)
    tab._pick(5, 5, 1)
    assert state(tab) == ("8 matches", False)


def test_the_buttons_step_through_the_matches_that_are_drawn(tab: MatchesTab) -> None:
    shown = []
    for by in (1, 1, -1, -1, 1):
        tab._step(by)
        shown.append(tab._number.text)
    # The sixth is off the homography, the seventh rejected; only inliers are drawn.
    assert shown == [f"match {number} of 8, pinned" for number in (1, 2, 1, 8, 1)]
    tab._pick(5, 5, 1)
    tab._step(-1)
    assert tab._number.text == "match 8 of 8, pinned"
    pair = replace(tab._pair, matches=tab._pair.matches[:7])
    tab.show(pair)
    assert tab._number.text == "7 matches"
    tab._step(1)
    tab.show(pair)
    assert tab._number.text == "match 1 of 7, pinned"
    for checkbox in tab._filters.values():
        checkbox.value = False
    tab._step(1)
    assert tab._number.text == "match 1 of 7, pinned"


def test_lines_are_spread_over_all_matches(tab: MatchesTab) -> None:
    tab._verdicts = ["rejected", *["inlier"] * 2000]
    counts = []
    for tab._density in range(8):
        chosen = tab._candidates()
        counts.append(len(chosen))
        assert (chosen[0], len({*chosen})) == (1, len(chosen))
        assert chosen[-1] > 2000 - 2000 / len(chosen)
    assert counts == [25, 50, 100, 200, 400, 800, 1600, 2000]
    tab._verdicts, tab._density = ["inlier"] * 26, 0
    assert tab._candidates() == [*range(25)]
    tab._verdicts = ["inlier"] * 25
    assert tab._candidates() == [*range(25)]


TITLE = "3 photographs: <b>a flight</b>"


@pytest.fixture
def finished(tmp_path: Path) -> Path:
    """What a run has made."""
    (tmp_path / "run" / "report").mkdir(parents=True)
    (tmp_path / "run" / "report" / "index.html").write_text("<title>a report</title>")
    (tmp_path / "run" / "mosaic.png").write_bytes(b"pixels")
    (tmp_path / "run" / "tiles").mkdir()
    (tmp_path / "run" / "tiles" / "index.html").write_text("<title>a map</title>")
    return tmp_path / "run"


def test_a_run_is_listed_and_deleted(session: Session, finished: Path, run_in_loop: Callable[[Scenario], None]) -> None:
    run = session.runs.keep(finished, TITLE)

    async def scenario() -> None:
        with Client(nicegui_page("/runs"), request=None) as client:
            build_runs_page(session)
        said = {getattr(each, "text", ""): each for each in client.elements.values()}
        assert said[TITLE].visible
        assert said["mosaic.png"].props["href"] == f"/run/{run.name}/mosaic.png"
        assert said["tiles"].props["href"] == f"/run/{run.name}/tiles/index.html"
        press: Any
        (press,) = said["Delete"]._event_listeners.values()
        press.handler(None)
        assert run.exists(), "once is not enough"
        assert getattr(said["Delete"], "text", "") == "Delete for good"
        press.handler(None)
        assert TITLE not in {getattr(each, "text", "") for each in client.elements.values()}

    run_in_loop(scenario)
    assert not run.exists()


def test_files_of_a_run_are_sent_and_no_others(
    panel: str, owner_address: str, kept: Path, tmp_path: Path, finished: Path
) -> None:
    run = Runs(kept, tmp_path).keep(finished, TITLE)
    with httpx.Client(base_url=panel) as owner:
        owner.get(owner_address)
        assert owner.get(f"/run/{run.name}/mosaic.png").content == b"pixels"
        assert owner.get(f"/run/{run.name}/report/index.html").text == "<title>a report</title>"
        for path in (f"/run/{run.name}/..%2f..%2fsecret", f"/run/..%2f/{run.name}", "/run/../archive"):
            assert owner.get(path).status_code == 404
