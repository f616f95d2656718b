"""The page of the mosaic: the column of controls on the left, what came of them on the right."""

from __future__ import annotations

from nicegui import ui

from skymosaic.panel.corners_tab import CornersTab
from skymosaic.panel.hardware_tab import HardwareTab
from skymosaic.panel.matches_tab import MatchesTab
from skymosaic.panel.mosaic_tab import build_mosaic_tab
from skymosaic.panel.numbers_tab import build_numbers_tab
from skymosaic.panel.options import fault_of
from skymosaic.panel.page_layout import page_frame
from skymosaic.panel.results import MosaicOutcome
from skymosaic.panel.sessions import Visitor
from skymosaic.panel.sidebar import ChoicesCard, PhotographsCard, RunCard, enabled_while_idle

STEPS = (
    ("grain", "Corners", "appear as soon as photographs are loaded, and follow the threshold as you move it."),
    ("timeline", "Matches", "are judged by fuzzy rules. Each line tells why it was kept or rejected."),
    ("panorama", "Mosaic", "to zoom into, with homography, errors and times; all of it in one download."),
)


def build_mosaic_page(visitor: Visitor) -> None:
    """Build the page of a visitor, with all that is there already."""

    def is_ready() -> bool:
        count = len(visitor.photographs)
        return count > 1 and not fault_of(visitor.choices, count)

    with page_frame(visitor, "/"):
        with ui.element("aside").classes("stack").props('aria-label="Photographs and choices"'):
            cards = (
                PhotographsCard(visitor),
                ChoicesCard(visitor),
                RunCard(visitor, "Make the mosaic", visitor.make_mosaic, is_ready),
            )
        with ui.element("main").classes("stack"):
            results = Results(visitor)

    def update() -> None:
        for card in cards:
            card.update()
        results.update()

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
            with ui.element("div").classes("bar"):
                with ui.tabs().props("dense no-caps align=left inline-label") as self._tabs:
                    tabs = {name: ui.tab(name) for name in ("Corners", "Matches", "Mosaic", "Numbers", "Hardware")}
                self._changed = ui.label("Choices or photographs have changed since this run.").classes("changed")
                self._changed.props('role="status"')
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
            is_new_run = (
                self._outcome is None or visitor.outcome is None or visitor.outcome.folder != self._outcome.folder
            )
            self._outcome = visitor.outcome
            self._fill()
            if is_new_run:
                self._panels.set_value("Mosaic")
        if self._hardware is not None:
            self._hardware.update()
        self._changed.set_visibility(self._is_outdated())

    def _is_outdated(self) -> bool:
        """Whether a run would not repeat what is shown."""
        visitor, outcome = self._visitor, self._visitor.outcome
        if outcome is None:
            return False
        photographs = tuple(upload.working for upload in visitor.photographs)
        return (visitor.choices, photographs) != (outcome.choices, outcome.workings)

    def _fill(self) -> None:
        outcome = self._outcome
        for place in self._places.values():
            place.clear()
        if outcome is None:
            for place in self._places.values():
                with place:
                    ui.label("Make the mosaic first.").classes("hint empty")
            return
        left, right = (f"/picture/{name}.png" for name in outcome.pair.names)
        with self._places["Matches"]:
            self._build_pair_choice(outcome)
            MatchesTab(outcome.pair, (left, right))
        with self._places["Mosaic"]:
            build_mosaic_tab(outcome)
        with self._places["Numbers"]:
            build_numbers_tab(outcome, outcome.pair)
        with self._places["Hardware"]:
            self._hardware = HardwareTab(self._visitor, outcome)

    def _build_pair_choice(self, outcome: MosaicOutcome) -> None:
        """Of a flight, the linked pairs to look at; those of two photographs need no choice."""
        if outcome.links:
            titles = {link.names: f"{' and '.join(link.names)}, {link.inliers} inliers" for link in outcome.links}
            with ui.element("div").classes("bar"):
                choice = ui.select(titles, label="Pair of the flight", value=outcome.pair.names)
                choice.props("outlined dense options-dense").classes("pair-choice")
                look = ui.button("Look at it", on_click=lambda: self._visitor.look_at_pair(choice.value))
                enabled_while_idle(look.props("outline no-caps"), self._visitor)

    def _build_welcome(self) -> None:
        ui.html("Two overlapping photographs in, one mosaic out", tag="h2", sanitize=False)
        ui.label(
            "Load two or more photographs on the left, or begin with what is rendered here. Nothing leaves "
            "this machine."
        ).classes("lead")
        button = ui.button("Try the built-in pair", icon="flight", on_click=lambda: self._visitor.load_built_in(2))
        enabled_while_idle(button.props("unelevated no-caps size=lg"), self._visitor)
        with ui.element("div").classes("what"):
            for icon, title, words in STEPS:
                with ui.element("div"):
                    ui.icon(icon)
                    ui.html(title, tag="h3", sanitize=False)
                    ui.label(words).classes("hint")
