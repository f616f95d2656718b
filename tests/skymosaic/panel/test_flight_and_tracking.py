"""Flights of more than two photographs, and an object in a video, as a user sees them."""

import csv
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from tools.panel.visit import (
    WINDOW,
    choose,
    corner_counts,
    make_mosaic,
    mosaic_viewer,
    names_reached_by_tab,
    open_page,
    open_tab,
    photographs_loaded,
)

PHOTOGRAPHS = 9
FRAMES = 60


def unpacked(page: Page, folder: Path, name: str) -> Path:
    """A folder where a run's command was repeated on the archive's inputs; its first results are in ``before``."""
    with page.expect_download() as download:
        page.get_by_role("link", name="Download everything").click()
    download.value.save_as(folder / "all.zip")
    with zipfile.ZipFile(folder / "all.zip") as archive:
        archive.extractall(folder)
    run = folder / name
    texts = [path for path in run.rglob("*") if path.suffix in (".csv", ".html", ".json", ".toml", ".txt")]
    assert not any("skymosaic-panel-" in path.read_text() for path in texts), "the server's folder is named"
    run.rename(folder / "before")
    run.mkdir()
    for path in (folder / "before").iterdir():
        if re.match(r"\d\d_|config|command", path.name):
            path.rename(run / path.name)
    program, *arguments = (run / "command.txt").read_text().split()
    assert program == "skymosaic"
    subprocess.run([sys.executable, "-m", "skymosaic", *arguments], cwd=run, check=True, capture_output=True)
    return run


@pytest.fixture(scope="module")
def flight(browser: Browser, panel: str) -> Iterator[Page]:
    """A page of a session that has made the mosaic of the built-in flight."""
    page = open_page(browser, panel)
    page.get_by_role("button", name="Load the built-in flight").click()
    expect(photographs_loaded(page)).to_have_count(PHOTOGRAPHS)
    make_mosaic(page)
    yield page
    page.context.close()


def test_a_flight_becomes_one_mosaic(flight: Page) -> None:
    expect(flight.get_by_role("tabpanel", name="Mosaic")).to_contain_text(f"{PHOTOGRAPHS} photographs")
    flight.get_by_role("switch", name="Outlines").click()
    expect(mosaic_viewer(flight).locator("polygon")).to_have_count(PHOTOGRAPHS)
    flight.get_by_role("switch", name="Seams").click()
    expect(mosaic_viewer(flight).locator("path.seam")).to_have_count(1)
    open_tab(flight, "Numbers")
    expect(flight.get_by_role("tabpanel", name="Numbers")).to_contain_text(f"{PHOTOGRAPHS} of {PHOTOGRAPHS}")


def test_the_matches_of_any_pair_of_a_flight_can_be_shown(flight: Page) -> None:
    open_tab(flight, "Matches")
    panel = flight.get_by_role("tabpanel", name="Matches")
    before = panel.locator("image").last.get_attribute("href")
    flight.get_by_role("combobox", name="Pair of the flight").click()
    flight.get_by_role("option").last.click()
    flight.get_by_role("button", name="Look at it").click()
    expect(panel.locator("image").last).not_to_have_attribute("href", before)
    flight.get_by_role("button", name="Next match").click()
    expect(flight.locator(".explanation")).to_contain_text("px from the homography")
    open_tab(flight, "Mosaic")
    expect(mosaic_viewer(flight)).to_be_visible()


def test_tab_reaches_the_controls_of_a_flight(flight: Page) -> None:
    open_tab(flight, "Matches")
    assert {"Pair of the flight", "Look at it", "Remove all"} <= set(names_reached_by_tab(flight))


@pytest.mark.slow
def test_the_command_of_a_flight_repeats_its_mosaic(flight: Page, tmp_path: Path) -> None:
    again = unpacked(flight, tmp_path, "mosaic")
    assert (again / "report" / "index.html").exists()
    mosaics = [cv2.imread(str(folder / "mosaic.png")) for folder in (again, tmp_path / "before")]
    assert np.array_equal(*mosaics)


def test_options_that_a_flight_cannot_have_are_refused_with_a_reason(flight: Page) -> None:
    choose(flight, "Detector", "orb")
    expect(flight.get_by_text("more than two photographs need Harris or FAST")).to_be_visible()
    expect(flight.get_by_role("button", name="Make the mosaic")).to_be_disabled()
    choose(flight, "Preset", "aerial")
    choose(flight, "Detector", "harris")
    expect(flight.get_by_role("button", name="Make the mosaic")).to_be_enabled()


def test_the_mosaic_stays_when_photographs_are_removed(flight: Page) -> None:
    flight.get_by_role("button", name="Remove all").click()
    expect(photographs_loaded(flight)).to_have_count(0)
    expect(corner_counts(flight)).to_have_count(0)
    flight.reload()
    expect(mosaic_viewer(flight)).to_be_visible()
    open_tab(flight, "Matches")
    shown = flight.get_by_role("tabpanel", name="Matches").locator("image").first.get_attribute("href")
    assert flight.evaluate("address => fetch(address).then(answer => answer.status)", shown) == 200


@pytest.fixture(scope="module")
def tracked(browser: Browser, panel: str) -> Iterator[Page]:
    """A page of a session that has followed the car through the built-in film."""
    page = open_page(browser, panel)
    page.get_by_role("link", name="Tracking").click()
    page.get_by_role("button", name="Try the built-in film").click()
    expect(page.get_by_role("list", name="Video loaded").locator("li")).to_have_count(1)
    page.get_by_role("button", name="Follow the object").click()
    expect(page.get_by_text("Found in")).to_be_visible()
    yield page
    page.context.close()


def test_an_object_is_followed_through_a_video(tracked: Page) -> None:
    expect(tracked.get_by_text(re.compile(rf"Found in {FRAMES} of {FRAMES} frames"))).to_be_visible()
    tracked.wait_for_function("document.querySelector('video').readyState >= 2")
    assert tracked.evaluate("document.querySelector('video').videoWidth") == 640
    table = tracked.get_by_role("table")
    expect(table.locator("tbody tr").first).to_contain_text(re.compile(r"\d+\.\d, \d+\.\d"))
    widths = tracked.evaluate("[document.documentElement.scrollWidth, document.body.scrollWidth]")
    assert max(widths) <= WINDOW["width"]


def test_tab_reaches_the_controls_of_the_tracking_page(tracked: Page) -> None:
    names = names_reached_by_tab(tracked)
    for part in ("Choose object", "Choose video", "Backend", "Follow the object", "Tracked video"):
        assert any(part in name for name in names), (part, names)


@pytest.mark.slow
def test_the_tracking_archive_has_video_and_corners_and_its_command_repeats_them(tracked: Page, tmp_path: Path) -> None:
    again = unpacked(tracked, tmp_path, "tracking")
    rows = list(csv.DictReader((again / "corners.csv").read_text().splitlines()))
    assert len(rows) == FRAMES
    assert all(row["x0"] for row in rows)
    assert (again / "corners.csv").read_text() == (tmp_path / "before" / "corners.csv").read_text()
    with av.open(str(again / "tracked.mp4")) as video:
        assert sum(1 for _ in video.decode(video=0)) == FRAMES


def test_a_reload_keeps_the_tracked_video(tracked: Page) -> None:
    tracked.reload()
    expect(tracked.get_by_text("Found in")).to_be_visible()


def test_an_object_is_accepted_and_files_that_are_no_video_are_refused(page: Page, tmp_path: Path) -> None:
    page.get_by_role("link", name="Tracking").click()
    expect(page.get_by_role("button", name="Follow the object")).to_be_disabled()
    picture, video = tmp_path / "car.png", tmp_path / "film.mp4"
    cv2.imwrite(str(picture), np.random.default_rng(1).integers(0, 256, (80, 120), np.uint8))
    page.get_by_label("Choose object").set_input_files(picture)
    expect(page.get_by_role("list", name="Object loaded").locator("li")).to_have_count(1)
    for body, reason in ((b"#EXTM3U\nfile:///etc/passwd\n", "is not a video"), (b"\0\0\0\x20ftypisom", "cut off")):
        video.write_bytes(body)
        page.get_by_label("Choose video").set_input_files(video)
        expect(page.get_by_text(re.compile(f"film.*{reason}"))).to_be_visible()
    expect(page.get_by_role("list", name="Video loaded").locator("li")).to_have_count(0)
    expect(page.get_by_role("button", name="Follow the object")).to_be_disabled()
