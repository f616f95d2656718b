"""The tracking page as a user sees it."""

import csv
import re
from pathlib import Path

import av
import pytest
from playwright.sync_api import Page, expect

from skymosaic.panel.tasks import upload_tasks
from tests.skymosaic.panel.visitor import names_reached_by_tab, repeat_archive
from tools.panel import WINDOW

FRAMES = 6


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The beginning of the built-in film, and the picture of its car."""
    folder = tmp_path_factory.mktemp("film")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(upload_tasks, "PURSUIT_FRAMES", FRAMES)
        upload_tasks.render_pursuit(folder, ["01_car.png", "02_film.mp4"], folder, progress=lambda *_: None)
    return folder


@pytest.fixture(scope="module")
def tracked(opened: Page, owner_address: str, film: Path) -> Page:
    """The opened page of the module's panel, which has followed a car through a film."""
    opened.goto(owner_address)
    opened.get_by_role("link", name="Tracking").click()
    opened.get_by_label("Choose object").set_input_files(film / "01_car.png")
    expect(opened.get_by_role("list", name="Object loaded").locator("li")).to_have_count(1)
    opened.get_by_label("Choose video").set_input_files(film / "02_film.mp4")
    expect(opened.get_by_role("list", name="Video loaded").locator("li")).to_have_count(1)
    opened.get_by_role("button", name="Follow the object").click()
    expect(opened.get_by_text("Found in")).to_be_visible()
    return opened


def test_an_object_is_followed_through_a_video_by_controls_in_reach(tracked: Page) -> None:
    expect(tracked.get_by_text(re.compile(rf"Found in {FRAMES} of {FRAMES} frames"))).to_be_visible()
    tracked.wait_for_function("document.querySelector('video').readyState >= 2")
    assert tracked.evaluate("document.querySelector('video').videoWidth") == 640
    table = tracked.get_by_role("table")
    expect(table.locator("tbody tr").first).to_contain_text(re.compile(r"\d+\.\d, \d+\.\d"))
    widths = tracked.evaluate("[document.documentElement.scrollWidth, document.body.scrollWidth]")
    assert max(widths) <= WINDOW["width"]
    names = names_reached_by_tab(tracked)
    for part in ("Choose object", "Choose video", "Backend", "Follow the object", "Tracked video"):
        assert any(part in name for name in names), (part, names)


@pytest.mark.slow
def test_the_tracking_archive_has_video_and_corners_and_its_command_repeats_them(tracked: Page, tmp_path: Path) -> None:
    again = repeat_archive(tracked, tmp_path, "tracking")
    rows = list(csv.DictReader((again / "corners.csv").read_text().splitlines()))
    assert len(rows) == FRAMES
    assert all(row["x0"] for row in rows)
    assert (again / "corners.csv").read_text() == (tmp_path / "before" / "corners.csv").read_text()
    with av.open(str(again / "tracked.mp4")) as video:
        assert sum(1 for _ in video.decode(video=0)) == FRAMES
