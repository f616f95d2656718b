"""What tabs, sidebar and drawings of the mosaic page show."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from nicegui import Client
from nicegui.page import page as nicegui_page

from sim.scene import make_pair
from skymosaic.features.backends import load_backend
from skymosaic.panel.options import Options
from skymosaic.panel.pages import drawings
from skymosaic.panel.pages.corners_tab import detect
from skymosaic.panel.pages.matches_tab import MatchesTab
from skymosaic.panel.pages.runs_page import build_runs_page
from skymosaic.panel.results import Picture
from skymosaic.panel.session import Session
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
