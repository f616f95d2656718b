"""Everything that the product writes for people, looked at in a real browser, and held against what it shows."""

import json
import os
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from typer.testing import CliRunner

from bench.rendered_pairs import write_set
from sim.scene import Flight, make_pair
from skymosaic.cli.commands import COMMANDS, app
from skymosaic.flight.checking.check import check_flight
from skymosaic.flight.picture.formats import OutputForm
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.registration.pair import Pair
from skymosaic.reports.flight import write_flight_report, write_report
from tests.skymosaic.panel.states import FOLDER_STATES, LONG_STATES, STATES, write_flight
from tests.system.command_line import captured
from tests.system.looking import (
    VIEWS,
    alike,
    drawn,
    listen,
    look,
    marks_beside_curves,
    patch,
    pictures_of,
    share_on_corners,
)
from tests.system.test_sequence_map import with_gps
from tools.panel import PHONE, WINDOW, open_page, running_panel

ROOT = Path(__file__).parents[2]
PLACED, METRES_A_PIXEL = 4, 0.15
MIN_ALIKE = 0.7
"""Correlation of what lies around the ends of a line between two pictures of the same ground."""
MIN_ON_CORNERS = 0.4
"""Two pixels beside them, a seventh of the points lie on corners by chance."""
PAGES = {"flight/index.html": 1, "pair/index.html": 4, "tiles/index.html": None, "thesis/index.html": 17}
"""Written pages, and how many pictures each has."""
LOOKED_AT = (
    "index.html", "tutorials/rejected_match.html", "reference/command_line.html", "explanation/painter.html",
    "gallery.html",
)  # fmt: skip
"""Pages of the site in which axe-core looks for barriers: of the others, each is like one of these."""
SCHEMES = {"light": "default", "dark": "slate"}
"""What the site calls its colours."""
LARGE = ("reference/golden_model.html", "reference/hardware.html")
"""Pages that take long: megabytes of what the page of the API consists of, too. The fast tests have their beginning."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    """Reports of a flight and of a pair, map tiles, and the page of the thesis, in one folder."""
    folder = tmp_path_factory.mktemp("written")
    taken = [folder / f"DJI_{number:04}.jpg" for number in range(PLACED + 1)]
    for path, image, pose in zip(taken, flight.images[:PLACED], flight.poses, strict=False):
        with_gps(path, image, METRES_A_PIXEL * pose.x_px, -METRES_A_PIXEL * pose.y_px)
    # It has to be flown again.
    with_gps(taken[-1], np.random.default_rng(0).integers(0, 255, (360, 480, 3), np.uint8), 0, 0)
    with open_run(taken, MosaicOptions()) as run:
        (made,) = run.write(folder / "m.tif", OutputForm(tiles=folder / "tiles"))
        # The ground is honest; a link that contradicts is made of the last one, and of the first a weak one.
        first, *others, last = made.layout.links
        weak = replace(first, left_points=first.left_points[:9], right_points=first.right_points[:9])
        layout = replace(
            made.layout,
            links=(weak, *others),
            contradicting=(last,),
            errors_px=(made.layout.errors_px[0][:9], *made.layout.errors_px[1:-1]),
        )
        shown, check = replace(made, layout=layout), check_flight(run.flight)
        write_flight_report(folder / "flight", [shown], check)
    return folder


@pytest.fixture(scope="module")
def pair(written: Path) -> Pair:
    """The pair whose report is in the folder."""
    with open_run(sorted(written.glob("*.jpg"))[:2], MosaicOptions()) as run:
        write_report(written / "pair", run.flight, run.write(written / "m.png"))
        assert run.flight.pair is not None
        return run.flight.pair


@pytest.fixture(scope="module")
def thesis(written: Path) -> None:
    """The page of the thesis as the command writes it, of one pair."""
    pair, data = make_pair(seed=5, size=(350, 260)), written / "<rendered>"
    left, right = pair.images
    write_set(data, [("only", "real", left, right, pair.homography_between(0, 1))])
    result = CliRunner().invoke(app, ["thesis", "--data", str(data), "-o", str(written / "thesis")])
    assert result.exit_code == 0, result.output
    assert {path.name for path in (written / "thesis").iterdir()} == {"index.html", "measurements.csv"}


@pytest.mark.usefixtures("pair")
def test_reports_speak_in_words_and_without_folders(written: Path) -> None:
    for name in ("flight", "pair"):
        page = (written / name / "index.html").read_text()
        text = unescape(re.sub(r"<[^>]+>", "\n", page.partition("<main>")[2]))
        assert re.findall(r"\b[a-z]+_[a-z_]+\b|True|False|None|\{|\}", text) == []
        assert str(written) not in page
        assert "DJI_0001" in text


@pytest.mark.usefixtures("pair", "thesis")
@pytest.mark.parametrize("name", PAGES)
def test_every_written_page_can_be_looked_at(browser: Browser, written: Path, name: str) -> None:
    page = open_page(browser, "about:blank")
    heard = listen(page)
    page.goto((written / name).as_uri())
    page.wait_for_function("document.images.length > 0")
    found = look(page)
    # A tile without ground is not written, and the page asks once.
    found += [each for each in heard if not re.search(r"ERR_FILE_NOT_FOUND .*/tiles/\d+/\d+/\d+\.webp'", each)]
    pictures = page.locator("img").count()
    page.context.close()
    assert found == [], "\n".join(found)
    assert pictures == (PAGES[name] or pictures)


@pytest.mark.usefixtures("thesis")
def test_the_page_of_the_thesis_has_every_table(browser: Browser, written: Path) -> None:
    page = open_page(browser, (written / "thesis" / "index.html").as_uri())
    text = page.locator("main").inner_text()
    page.context.close()
    for words in (*(f"Table IV-{number}:" for number in range(1, 8)), "Figure IV-6:", "those of <rendered>"):
        assert words in text


def test_links_are_red_if_and_only_if_they_contradict(browser: Browser, written: Path) -> None:
    page = open_page(browser, (written / "flight" / "index.html").as_uri())
    linked = page.locator("figure", has_text="red where the layout disagrees")
    lines = linked.locator("svg line").evaluate_all(
        """all => all.map(line => [line.textContent, getComputedStyle(line).stroke.match(/\\d+/g).map(Number),
            ...["x1", "y1", "x2", "y2"].map(end => line[end].baseVal.value)])"""
    )
    names = linked.locator("svg text").evaluate_all(
        "all => Object.fromEntries(all.map(t => [t.textContent, [t.x.baseVal[0].value, t.y.baseVal[0].value]]))"
    )
    page.context.close()
    (mosaic,) = json.loads((written / "flight" / "report.json").read_text())["mosaics"]
    assert len(lines) == len(mosaic["links"]) + len(mosaic["contradicting"])
    assert min(link["ties"] for link in mosaic["links"]) < 10, "a weak link is among them"
    red = []
    for words, (r, g, b), *ends in lines:
        left, right = re.findall(r"DJI_\d+", words)
        assert ends == names[left] + names[right]
        if r > 1.5 * max(g, b):
            red.append([left, right])
    assert red == [[Path(name).stem for name in link] for link in mosaic["contradicting"]]


def build_site(folder: Path, **environment: str) -> Path:
    """The site; a link, a page or a reference that does not exist is an error."""
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = captured(command, cwd=ROOT, env={**os.environ, **environment})
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With few modules of the model and of the hardware."""
    return build_site(tmp_path_factory.mktemp("site"), SITE_MODULES="few")


def test_every_page_of_the_site_can_be_looked_at_without_a_network(browser: Browser, site: Path) -> None:
    # The page of what does not exist is for servers, by whose root it finds its style.
    look_at_pages(browser, site, {path.relative_to(site).as_posix() for path in site.rglob("*.html")} - {"404.html"})


@pytest.mark.slow
def test_the_large_pages_of_the_site_can_be_looked_at(browser: Browser, tmp_path: Path) -> None:
    look_at_pages(browser, build_site(tmp_path), {*LARGE})


def look_at_pages(browser: Browser, site: Path, names: set[str]) -> None:
    asked, wrong = set(), []
    for window, scheme in VIEWS:
        # A new one, since a browser keeps the colours in which it opened the site.
        page = open_page(browser, "about:blank", viewport=window, color_scheme=scheme)
        heard = listen(page)
        page.on("request", lambda request: asked.add(request.url))
        for name in sorted(names if (window, scheme) == VIEWS[-1] else names.intersection(LOOKED_AT)):
            heard.clear()
            page.goto((site / name).as_uri())
            assert page.locator("body").get_attribute("data-md-color-scheme") == SCHEMES[scheme]
            found = look(page, [(window, scheme)], for_barriers=name in LOOKED_AT)
            wrong += [f"{name}: {each}" for each in found + heard]
        page.context.close()
    assert wrong == [], "\n".join(wrong)
    assert len(asked) > 10
    assert {address.partition(":")[0] for address in asked} <= {"file", "data", "blob"}


def test_the_site_has_every_command(site: Path) -> None:
    commands = (site / "reference" / "command_line.html").read_text(encoding="utf-8")
    for name in COMMANDS:
        assert f"skymosaic {name}" in commands


def misplaced_corners(page: Page) -> list[str]:
    """What is wrong with the corners that the panel draws."""
    drawing = "".join(page.locator("path.dot").evaluate_all("all => all.map(path => path.getAttribute('d'))"))
    points = np.array(re.findall(r"M(\S+) (\S+?)h0", drawing), np.float64)
    wrong = []
    for picture, left in pictures_of(page, "Corners of the photographs"):
        own = points[(points[:, 0] >= left) & (points[:, 0] < left + picture.shape[1])] - (left, 0)
        wrong += [] if share_on_corners(picture, own) > MIN_ON_CORNERS else [f"from {left} px, corners beside corners"]
    return wrong


def misplaced_matches(page: Page) -> list[str]:
    """What is wrong with the inliers that the panel draws: their ends show the same ground."""
    (left, _), (right, shift) = pictures_of(page, "Matches between the photographs")
    paths = page.locator("path.match.inlier:not(.chosen)").evaluate_all("all => all.map(p => p.getAttribute('d'))")
    ends = np.array([re.findall(r"[\d.]+", path) for path in paths], np.float64) - (0, 0, shift, 0)
    same = [alike(patch(left, end[:2]), patch(right, end[2:])) for end in ends]
    return [] if np.median(same) > MIN_ALIKE else [f"ends of matches show other ground: {np.median(same):.2f}"]


CHECKS: dict[str, tuple[Callable[[Page], list[str]], ...]] = {
    "corners": (misplaced_corners,),
    "matches": (misplaced_matches, marks_beside_curves),
    "rules editor": (marks_beside_curves,),
    "matches of a flight": (misplaced_matches, marks_beside_curves),
}
"""What the drawings of some states of the panel show."""


def walk(browser: Browser, panel: str, states: dict[str, Callable[[Page], None]], *, views: int = 2) -> list[str]:
    """Go through the states; returns what is wrong with each, in both views or in one of them by turns."""
    page = open_page(browser, "about:blank", color_scheme="light")
    # A request under way that is never answered: what the page shows meanwhile must have no barriers either.
    page.route("**/never-answered", lambda _route: None)
    heard, found = listen(page), []
    page.goto(panel)
    page.evaluate("() => { const x = new XMLHttpRequest(); x.open('GET', '/never-answered'); x.send(); }")
    for number, (name, reach) in enumerate(states.items()):
        reach(page)
        drawn(page)
        wrong = [each for check in CHECKS.get(name, ()) for each in check(page)]
        wrong += look(page, VIEWS if views == 2 else VIEWS[number % 2 :][:1]) + heard
        page.set_viewport_size(WINDOW)
        page.emulate_media(color_scheme="light")
        found += [f"{name}: {each}" for each in wrong]
        heard.clear()
    page.context.close()
    return found


@pytest.mark.parametrize("views", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_panel_with_a_pair_can_be_looked_at(browser: Browser, tmp_path: Path, views: int) -> None:
    with running_panel(tmp_path) as address:
        found = walk(browser, address, STATES, views=views)
    assert found == [], "\n".join(found)


@pytest.mark.slow
def test_the_panel_with_a_flight_and_a_film_can_be_looked_at(browser: Browser, tmp_path: Path) -> None:
    with running_panel(tmp_path) as address:
        found = walk(browser, address, LONG_STATES)
    assert found == [], "\n".join(found)


@pytest.mark.slow
def test_folders_and_runs_can_be_looked_at(browser: Browser, tmp_path: Path) -> None:
    write_flight(tmp_path / "flight")
    with running_panel(tmp_path, "--root", "flight") as address:
        found = walk(browser, address, FOLDER_STATES)
    assert found == [], "\n".join(found)


def test_what_is_wrong_with_a_page_is_found(browser: Browser) -> None:
    page = browser.new_page()
    heard = listen(page)
    page.set_content(
        """<html><body><main><button></button><p style="color: #ccc">`mask` it</p><script>gone()</script>
        <img alt="" src="data:image/png;base64,iVBO"><div style="width: 400px">wide</div>
        <img alt="" width="90" src="data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'/>">
        </main></body></html>"""
    )
    found = "\n".join(look(page, [(PHONE, "light")]) + heard)
    page.close()
    faults = "button-name", "color-contrast", "html-has-lang", "cannot be shown", "one colour", "px wide", "gone"
    for each in (*faults, "`mask`"):
        assert each in found
