"""Matches and rules of a finished run as a user sees them: most in headless Chromium."""

import re
import statistics
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from nicegui import Client
from nicegui.page import page as nicegui_page
from playwright.sync_api import Locator, Page, expect

from skymosaic.panel.options import Options
from skymosaic.panel.pages.matches_tab import MatchesTab
from skymosaic.panel.results import Picture
from skymosaic.panel.widgets.viewer import Pointer
from tests.skymosaic.panel import made_up
from tests.skymosaic.panel.visitor import Scenario
from tools.panel.visit import choose, middle_of, open_advanced, open_tab

RECOLOUR_LIMIT_MS = 1000


# These come first: after the first test with a browser, no other event loop can run here.
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
    tab._hover(Pointer(40, 100.1, 1))
    assert state(tab) == ("match 1 of 8", True)
    # Nothing is within 10 px of the screen.
    tab._hover(Pointer(40, 100.3, 1))
    tab._hover(Pointer(70, 91, 2))
    assert state(tab) == ("match 1 of 8", True)
    tab._pick(Pointer(70, 85, 1))
    tab._hover(Pointer(40, 90, 1))
    assert state(tab) == ("match 2 of 8, pinned", True)
    tab._pick(Pointer(5, 5, 1))
    assert state(tab) == ("8 matches", False)


def test_the_buttons_step_through_the_matches_that_are_drawn(tab: MatchesTab) -> None:
    shown = []
    for by in (1, 1, -1, -1, 1):
        tab._step(by)
        shown.append(tab._number.text)
    # The sixth is off the homography, the seventh rejected; only inliers are drawn.
    assert shown == [f"match {number} of 8, pinned" for number in (1, 2, 1, 8, 1)]
    tab._pick(Pointer(5, 5, 1))
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


def test_a_rejected_match_is_explained(made: Page) -> None:
    open_tab(made, "Matches")
    for kind in ("kept, on the homography", "rejected by the rules"):
        made.get_by_role("checkbox", name=kind).click()
    viewer = made.get_by_role("group", name="Matches between the photographs")
    line = viewer.locator("path.match.rejected:not(.chosen)").first
    expect(line).to_be_attached()
    viewer.locator("> svg").hover()  # waits until the viewer has its final position
    x, y = middle_of(line)
    made.mouse.move(x, y)
    explanation = made.locator(".explanation")
    expect(explanation).to_contain_text("Rejected. The rules give it the weight")
    for words in ("px from the homography", "distance", "margin to the second best", "strength", "weight"):
        expect(explanation).to_contain_text(words)
    expect(explanation.locator("svg circle")).to_have_count(6)
    expect(explanation.locator("tr.dominant")).to_have_count(1)
    made.mouse.click(x, y)
    expect(made.get_by_role("status", name="Match shown")).to_contain_text("pinned")
    for kind in ("kept, on the homography", "rejected by the rules"):
        made.get_by_role("checkbox", name=kind).click()


def test_some_inliers_are_drawn_first_and_a_slider_draws_more(made: Page) -> None:
    open_tab(made, "Matches")
    viewer = made.get_by_role("group", name="Matches between the photographs")
    lines = viewer.locator("path.match:not([class*=chosen])")
    expect(viewer.locator("path.match.inlier:not(.chosen)")).to_have_count(100)
    expect(lines).to_have_count(100)
    slider = made.get_by_role("slider", name="Maximum number of lines")
    expect(slider).to_have_attribute("aria-valuetext", "100 lines")
    slider.press("End")
    expect(slider).not_to_have_attribute("aria-valuetext", "100 lines")
    slider.press("Home")
    expect(slider).to_have_attribute("aria-valuetext", "25 lines")
    expect(lines).to_have_count(25)


def take(corner: Locator) -> tuple[float, float]:
    """Press the pointer on a corner, which may still move while the editor opens; returns its middle, px."""
    for _ in range(50):
        corner.hover()
        corner.page.mouse.down()
        box = corner.bounding_box()
        if box and corner.evaluate("corner => corner === document.activeElement"):
            return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        corner.page.mouse.up()
    raise AssertionError("the corner cannot be taken")


def test_a_dragged_corner_recolours_the_matches(made: Page, tmp_path: Path) -> None:
    open_tab(made, "Matches")
    made.get_by_role("button", name="Edit the rules").click()
    rejected = made.get_by_role("checkbox", name="rejected by the rules")
    at_first = rejected.text_content() or ""
    # Each curve carries the name of its term.
    assert made.locator(".curves-plot .set-name").all_text_contents()[:4] == ["low", "high", "big", "small"]
    text = made.get_by_role("textbox", name="Rules, in FLL")
    # Many of its lines, before anything is typed.
    expect(text).to_be_visible()
    assert text.evaluate("area => area.clientHeight") > 200
    corner = made.get_by_role("slider", name="Corner 1 of distance: low, high")
    undo = made.get_by_role("button", name="Undo")
    expect(undo).to_be_disabled()
    x, y = take(corner)
    made.mouse.move(x - 20, y, steps=5)
    made.mouse.up()
    expect(rejected).not_to_have_text(at_first)
    effect = made.get_by_role("status", name="Effect of the rules")
    expect(effect).to_contain_text("predicted error")
    assert "low Ramp 0.34 0.1" not in text.input_value()
    # One drag is one version.
    undo.click()
    expect(rejected).to_have_text(at_first)
    expect(undo).to_be_disabled()
    text.fill(text.input_value().replace("then weight is sure", "then weight is"))
    expect(made.get_by_text("line 45: rule")).to_be_visible()
    expect(rejected).to_have_text(at_first)
    made.get_by_role("button", name="Reset").click()
    expect(made.get_by_text("line 45: rule")).to_be_hidden()
    expect(text).to_have_value(re.compile("then weight is sure"))
    text.fill(text.input_value().replace("then weight is sure", "then weight is never"))
    expect(rejected).not_to_have_text(at_first)
    made.get_by_role("button", name="Use for the next run").click()
    open_advanced(made)
    expect(made.get_by_role("combobox", name="Fuzzy rules")).to_have_value("own")
    with made.expect_download() as download:
        made.get_by_role("button", name="Download everything").or_(
            made.get_by_role("link", name="Download everything")
        ).click()
    download.value.save_as(tmp_path / "all.zip")
    with zipfile.ZipFile(tmp_path / "all.zip") as archive:
        assert "then weight is never" in archive.read("mosaic/edited_rules.fll").decode()
        assert "then weight is sure" in archive.read("mosaic/rules.fll").decode()
    with made.expect_download() as download:
        made.get_by_role("button", name="Save as FLL").click()
    assert "then weight is never" in download.value.path().read_text()
    choose(made, "Fuzzy rules", "aerial")
    made.get_by_role("button", name="Reset").click()
    expect(rejected).to_have_text(at_first)
    made.get_by_role("button", name="Edit the rules").click()


@pytest.mark.slow  # On an idle machine only.
def test_a_moved_corner_recolours_the_matches_within_a_second(made: Page) -> None:
    """From the pointer's move to the next frame the browser paints, for two photographs of 640x480."""
    open_tab(made, "Matches")
    made.get_by_role("button", name="Edit the rules").click()
    corner = made.get_by_role("slider", name="Corner 1 of distance: low, high")
    made.evaluate(
        """() => {
            const drawing = document.querySelector('[aria-label="Matches between the photographs"] > svg g');
            // The browser itself moves the pointer again when what lies below it has changed.
            addEventListener("pointermove", () => (window.moved ||= performance.now()), true);
            new MutationObserver(() => requestAnimationFrame(() => (window.painted = performance.now())))
                .observe(drawing, { childList: true });
        }"""
    )
    milliseconds = []
    for offset_px in (-40, 40) * 5:
        x, y = take(corner)
        made.evaluate("window.moved = window.painted = 0")
        made.mouse.move(x + offset_px, y)
        made.wait_for_function("window.moved && window.painted > window.moved")
        milliseconds.append(made.evaluate("window.painted - window.moved"))
        made.mouse.up()
        # The rules at the drop may be painted once more.
        made.wait_for_function("performance.now() > window.painted + 500")
    print(f"rule to matches: median {statistics.median(milliseconds):.0f} ms, worst {max(milliseconds):.0f} ms")
    made.get_by_role("button", name="Reset").click()
    made.get_by_role("button", name="Edit the rules").click()
    assert statistics.median(milliseconds) < RECOLOUR_LIMIT_MS


def test_the_keyboard_steps_through_the_matches(made: Page) -> None:
    open_tab(made, "Matches")
    made.get_by_role("button", name="Next match").focus()
    shown = made.get_by_role("status", name="Match shown")
    seen = set()
    for _ in range(3):
        before = shown.text_content() or ""
        made.keyboard.press("Enter")
        expect(shown).not_to_have_text(before)
        seen.add(shown.text_content())
    assert len(seen) == 3
