"""The mosaic page: controls in the left column, results in the right one."""

from nicegui import ui

from skymosaic.panel.options import fault_of
from skymosaic.panel.pages.corners_tab import CornersTab
from skymosaic.panel.pages.matches_tab import MatchesTab
from skymosaic.panel.pages.page_layout import page_layout
from skymosaic.panel.pages.result_tabs import HardwareTab, build_mosaic_tab, build_numbers_tab
from skymosaic.panel.pages.rules_editor import RulesEditor
from skymosaic.panel.pages.sidebar import OptionsCard, PhotographsCard, RunCard, enable_while_idle
from skymosaic.panel.results import MosaicResult
from skymosaic.panel.session import Session

STEPS = (
    ("grain", "Corners", "appear as soon as photographs are loaded, and follow the threshold as you move it."),
    ("timeline", "Matches", "are weighed by fuzzy rules. Point at a line to see why it was kept or rejected."),
    ("panorama", "Mosaic", "with zoom, homography, errors and times; everything in one download."),
)


def build_mosaic_page(session: Session) -> None:
    """Build the page of a session, with the photographs and results it already has."""

    def is_ready() -> bool:
        count = len(session.inputs.photographs)
        return count > 1 and not fault_of(session.options, count)

    with page_layout(session, "/") as updates:
        with ui.element("section").classes("stack").props('aria-label="Photographs and options"'):
            updates.append(PhotographsCard(session).update)
            updates.append(OptionsCard(session).update)
            updates.append(RunCard(session, "Make the mosaic", session.make_mosaic, is_ready).update)
        with ui.element("section").classes("stack").props('aria-label="Results"'):
            updates.append(ResultTabs(session).update)


class ResultTabs:
    """The tabs with the results, in the right column."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._result: MosaicResult | None = None
        self._hardware: HardwareTab | None = None
        self._editor: RulesEditor | None = None
        self._welcome = ui.element("div").classes("card welcome")
        with self._welcome:
            self._build_welcome()
        self._tabs_card = ui.element("div").classes("card results")
        with self._tabs_card:
            with ui.element("div").classes("bar"):
                with ui.tabs().props("dense no-caps align=left inline-label") as self._tabs:
                    tabs = {name: ui.tab(name) for name in ("Corners", "Matches", "Mosaic", "Numbers", "Hardware")}
                self._outdated = ui.label("Options or photographs have changed since this run.").classes("changed")
                self._outdated.props('role="status"')
            with ui.tab_panels(self._tabs, value="Corners", animated=False, keep_alive=True) as self._panels:
                panels = {name: ui.tab_panel(tab).props(f'aria-label="{name}"') for name, tab in tabs.items()}
                # Corners follow the photographs and options; the other tabs show a result and are filled by `_fill`.
                with panels.pop("Corners"):
                    self._corners = CornersTab(session)
                self._result_panels = panels
        self._fill()

    def update(self) -> None:
        """Show the session's photographs, options and results as they are now."""
        session = self._session
        self._welcome.set_visibility(not session.inputs.photographs and session.mosaic_result is None)
        self._tabs_card.set_visibility(not self._welcome.visible)
        self._corners.update()
        if session.mosaic_result is not self._result:
            before, self._result = self._result, session.mosaic_result
            self._fill()
            # Looking at another pair of the flight is not a new run: the Matches tab stays open.
            if not (before and self._result and before.folder == self._result.folder):
                self._panels.set_value("Mosaic")
        if self._hardware is not None:
            self._hardware.update()
        if self._editor is not None:
            self._editor.update()
        self._outdated.set_visibility(session.is_outdated)

    def _fill(self) -> None:
        result = self._result
        self._hardware = self._editor = None
        for panel in self._result_panels.values():
            panel.clear()
        if result is None:
            for panel in self._result_panels.values():
                with panel:
                    ui.label("Make the mosaic first.").classes("hint empty")
            return
        with self._result_panels["Matches"]:
            # Two photographs have only one pair.
            if result.links:
                titles = {(left, right): f"{left} and {right}, {count} inliers" for left, right, count in result.links}
                with ui.element("div").classes("bar"):
                    select = ui.select(titles, label="Pair of the flight", value=result.pair_names)
                    select.props("outlined dense options-dense").classes("pair-select")
                    look = ui.button("Look at it", on_click=lambda: self._session.look_at_pair(select.value))
                    enable_while_idle(look.props("outline no-caps"), self._session)
            edit = self._session.rules_edit
            matches = MatchesTab(edit.pair if edit else result.pair, result.working)
            self._editor = RulesEditor(self._session, matches) if edit else None
        with self._result_panels["Mosaic"]:
            build_mosaic_tab(result, {each.name: each.thumbnail for each in self._session.inputs.photographs})
        with self._result_panels["Numbers"]:
            build_numbers_tab(result)
        with self._result_panels["Hardware"]:
            self._hardware = HardwareTab(self._session, result)

    def _build_welcome(self) -> None:
        ui.html("Two overlapping photographs in, one mosaic out", tag="h2", sanitize=False)
        ui.label(
            "Load two or more photographs, or begin with a rendered example. Nothing leaves this machine."
        ).classes("lead")
        button = ui.button("Try the built-in pair", icon="flight", on_click=lambda: self._session.load_built_in(2))
        enable_while_idle(button.props("unelevated no-caps size=lg"), self._session)
        with ui.element("div").classes("what"):
            for icon, title, words in STEPS:
                with ui.element("div"):
                    ui.icon(icon)
                    ui.html(title, tag="h3", sanitize=False)
                    ui.label(words).classes("hint")
