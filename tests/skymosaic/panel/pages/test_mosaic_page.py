"""The mosaic page as a user sees it, in headless Chromium: with two photographs."""

import re
from pathlib import Path

from playwright.sync_api import Locator, Page, expect

from tests.skymosaic.panel.visitor import choose, middle_of, names_reached_by_tab, open_tab, photographs_loaded
from tools.panel import PHONE, WINDOW, corner_counts, make_mosaic, mosaic_viewer, open_advanced


def test_a_mosaic_zooms(made: Page) -> None:
    open_tab(made, "Mosaic")
    drawing = mosaic_viewer(made).locator("> svg")
    whole = drawing.get_attribute("viewBox")
    assert float(whole.split()[2]) > 500
    drawing.hover()
    made.mouse.wheel(0, -100)
    expect(drawing).not_to_have_attribute("viewBox", whole)
    after_wheel = drawing.get_attribute("viewBox")
    drawing.focus()
    made.keyboard.press("+")
    expect(drawing).not_to_have_attribute("viewBox", after_wheel)
    mosaic_viewer(made).get_by_role("button", name="Show all").click()
    expect(drawing).to_have_attribute("viewBox", whole)


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


def test_a_dragged_corner_recolours_the_matches(made: Page) -> None:
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
        made.get_by_role("button", name="Save as FLL").click()
    assert "then weight is never" in download.value.path().read_text()
    choose(made, "Fuzzy rules", "aerial")
    made.get_by_role("button", name="Reset").click()
    expect(rejected).to_have_text(at_first)
    made.get_by_role("button", name="Edit the rules").click()


def test_tab_reaches_every_control_and_a_reload_keeps_results(made: Page) -> None:
    open_tab(made, "Matches")
    open_advanced(made)
    names = names_reached_by_tab(made)
    parts = "Choose photographs", "Detector", "Harris threshold", "Make the mosaic", "Matches", "Next match", "Zoom in"
    for part in parts:
        assert any(part in name for name in names), (part, names)
    made.reload()
    expect(mosaic_viewer(made)).to_be_visible()
    open_tab(made, "Corners")
    expect(corner_counts(made)).to_contain_text("corners")


def test_the_button_that_starts_a_run_is_in_reach_at_every_threshold(made: Page) -> None:
    open_tab(made, "Numbers")
    open_advanced(made)
    for size in (WINDOW, PHONE):
        made.set_viewport_size(size)
        for place in ("0", "document.documentElement.scrollHeight"):
            made.evaluate(f"scrollTo(0, {place})")
            button = made.get_by_role("button", name="Make the mosaic")
            expect(button).to_be_in_viewport(ratio=1)
            button.click(trial=True)
    made.set_viewport_size(WINDOW)
    open_tab(made, "Corners")
    open_advanced(made)
    made.get_by_role("slider", name="Harris threshold").click()
    made.keyboard.press("End")
    expect(corner_counts(made)).to_contain_text("0 and 0 corners")


def test_uploaded_photographs_make_a_mosaic(page: Page, photographs: list[Path], silent_board: str) -> None:
    """And a run that takes long is cancelled."""
    page.get_by_label("Choose photographs").set_input_files(photographs)
    expect(photographs_loaded(page)).to_have_count(2)
    choose(page, "Detector", "orb")
    choose(page, "Blending", "multiband")
    make_mosaic(page)
    outdated = page.get_by_text("have changed since this run")
    expect(outdated).to_be_hidden()
    open_tab(page, "Numbers")
    expect(page.get_by_role("tabpanel", name="Numbers")).to_contain_text("--detector orb")
    choose(page, "Blending", "average")
    expect(outdated).to_be_visible()
    choose(page, "Blending", "multiband")
    expect(outdated).to_be_hidden()
    page.get_by_role("button", name="Swap the first two").click()
    expect(outdated).to_be_visible()
    choose(page, "Detector", "harris")
    choose(page, "Backend", f"board:{silent_board}")
    page.get_by_role("button", name="Make the mosaic").click()
    expect(page.get_by_text(re.compile(r"registering · \d+ s"))).to_be_visible()
    page.reload()
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_text("Making the mosaic: cancelled")).to_be_visible()
    expect(page.get_by_role("button", name="Make the mosaic")).to_be_enabled()
