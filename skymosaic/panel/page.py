"""The page: the column of controls on the left, what came of them on the right."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from nicegui import ui

from skymosaic.panel.corners_tab import CornersTab
from skymosaic.panel.hardware_tab import HardwareTab
from skymosaic.panel.matches_tab import MatchesTab
from skymosaic.panel.mosaic_tab import build_mosaic_tab
from skymosaic.panel.numbers_tab import build_numbers_tab
from skymosaic.panel.outcomes import MosaicOutcome
from skymosaic.panel.sidebar import ChoicesCard, PhotographsCard, RunCard
from skymosaic.panel.visitors import Visitor

LOGO = (
    '<svg viewBox="0 0 32 32" aria-hidden="true"><g fill="none" stroke-width="2.4">'
    '<rect x="4" y="9" width="16" height="14" rx="2" stroke="#38d9ff" transform="rotate(-8 12 16)"/>'
    '<rect x="13" y="9" width="16" height="14" rx="2" stroke="#ffb020" transform="rotate(7 21 16)"/></g></svg>'
)

STEPS = (
    ("grain", "Corners", "appear as soon as photographs are loaded, and follow the threshold as you move it."),
    ("timeline", "Matches", "are judged by fuzzy rules. Each line tells why it was kept or rejected."),
    ("panorama", "Mosaic", "to zoom into, with homography, errors and times; all of it in one download."),
)


@cache
def _style() -> str:
    return Path(__file__).with_name("style.css").read_text(encoding="utf-8")


def build_page(visitor: Visitor) -> None:
    """Build the page of a visitor, with all that is there already."""
    ui.add_css(_style())
    ui.colors(primary="#0f6e78")
    with ui.element("header").classes("top"):
        ui.html(LOGO, sanitize=False)
        ui.html("skymosaic", tag="h1", sanitize=False)
        ui.label("overlapping photographs in, one mosaic out").classes("tagline")
        ui.element("div").classes("grow")
        download = ui.button("Download everything", icon="download").props(
            'outline dense no-caps color=white href="/archive"'
        )
    with ui.element("div").classes("layout"):
        with ui.element("aside").classes("stack").props('aria-label="Photographs and choices"'):
            cards = PhotographsCard(visitor), ChoicesCard(visitor), RunCard(visitor)
        with ui.element("main").classes("stack"):
            results = Results(visitor)

    def update() -> None:
        for card in cards:
            card.update()
        results.update()
        download.set_visibility(visitor.outcome is not None)

    visitor.changed.subscribe(update)
    update()


class Results:
    """The tabs of the right side."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._outcome: MosaicOutcome | None = None
        self._hardware: HardwareTab | None = None
        self._welcome = ui.element("div").classes("card welcome")
        with self._welcome:
            self._build_welcome()
        self._tabs_card = ui.element("div").classes("card results")
        with self._tabs_card:
            with ui.tabs().props("dense no-caps align=left inline-label") as self._tabs:
                tabs = {name: ui.tab(name) for name in ("Corners", "Matches", "Mosaic", "Numbers", "Hardware")}
            with ui.tab_panels(self._tabs, value="Corners", animated=False, keep_alive=True) as self._panels:
                places = {name: ui.tab_panel(tab).props(f'aria-label="{name}"') for name, tab in tabs.items()}
                with places.pop("Corners"):
                    self._corners = CornersTab(visitor)
                self._places = places
        self._fill()

    def update(self) -> None:
        """Show the visitor's photographs, choices and outcome as they are now."""
        visitor = self._visitor
        self._welcome.set_visibility(not visitor.photographs and visitor.outcome is None)
        self._tabs_card.set_visibility(not self._welcome.visible)
        self._corners.update()
        if visitor.outcome is not self._outcome:
            self._outcome = visitor.outcome
            self._fill()
            self._panels.set_value("Mosaic")
        if self._hardware is not None:
            self._hardware.update()

    def _fill(self) -> None:
        outcome = self._outcome
        for place in self._places.values():
            place.clear()
        if outcome is None:
            for place in self._places.values():
                with place:
                    ui.label("Make the mosaic first.").classes("hint empty")
            return
        left, right = (f"/picture/{path.name}" for path in outcome.workings[:2])
        with self._places["Matches"]:
            MatchesTab(outcome.pairs[0], (left, right))
        with self._places["Mosaic"]:
            build_mosaic_tab(outcome)
        with self._places["Numbers"]:
            build_numbers_tab(outcome, outcome.pairs[0])
        with self._places["Hardware"]:
            self._hardware = HardwareTab(self._visitor, outcome)

    def _build_welcome(self) -> None:
        ui.html("Two overlapping photographs in, one mosaic out", tag="h2", sanitize=False)
        ui.label(
            "Load two or more photographs on the left, or begin with a flight that is rendered here. Nothing leaves "
            "this machine."
        ).classes("lead")
        ui.button("Try the built-in flight", icon="flight", on_click=self._visitor.load_built_in_pair).props(
            "unelevated no-caps size=lg"
        )
        with ui.element("div").classes("what"):
            for icon, title, words in STEPS:
                with ui.element("div"):
                    ui.icon(icon)
                    ui.html(title, tag="h3", sanitize=False)
                    ui.label(words).classes("hint")
