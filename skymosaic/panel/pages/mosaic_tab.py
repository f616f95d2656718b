"""Shows the mosaic, with zoom and overlays (outlines, seams, links), and the photographs that were left out."""

from collections.abc import Mapping
from pathlib import Path

from nicegui import ui

from skymosaic.panel.pages import drawings
from skymosaic.panel.pages.page_layout import show_files
from skymosaic.panel.results import MosaicResult, ShownMosaic, picture_address
from skymosaic.panel.widgets.viewer import Viewer


def build_mosaic_tab(result: MosaicResult, thumbnails: Mapping[str, Path]) -> None:
    """Show a run's mosaic, or why there is none; photographs left out with their thumbnails, by name."""
    if result.mosaic is None:
        with ui.element("div").classes("empty"):
            ui.html("No mosaic could be made", tag="h2", sanitize=False)
            ui.label(result.reason).classes("fault")
            ui.label("The Matches tab shows the matches and why they were rejected.").classes("hint")
        return
    MosaicTab(result, result.mosaic)
    if result.left_out:
        _show_left_out(result, thumbnails)


class MosaicTab:
    """The mosaic, switches for its layers, its files, and what is not in it."""

    def __init__(self, result: MosaicResult, mosaic: ShownMosaic) -> None:
        self._layers = {"Outlines": drawings.draw_outlines(mosaic.outlines.values())}
        if mosaic.seams:
            self._layers["Seams"] = drawings.draw_seams(mosaic.seams)
        if result.links:
            self._layers["Links"] = drawings.draw_links(mosaic.outlines, result.links)
        self._shown = dict.fromkeys(self._layers, False)
        with ui.element("div").classes("bar"):
            ui.label(f"{mosaic.size[0]} x {mosaic.size[1]} px, {len(mosaic.outlines)} photographs").classes("name")
            ui.label("Wheel or + and - zoom, drag moves.").classes("hint")
            ui.element("div").classes("grow")
            for name in self._layers:
                self._build_switch(name)
        self._viewer = Viewer("Mosaic", [mosaic.picture], tiles=mosaic.tiles)
        show_files("mosaic", result.files)

    def _build_switch(self, name: str) -> None:
        def show(shown: bool) -> None:
            self._shown[name] = shown
            self._viewer.draw("".join(self._layers[each] for each in self._layers if self._shown[each]))

        ui.switch(name, on_change=lambda event: show(event.value)).props("dense")


def _show_left_out(result: MosaicResult, thumbnails: Mapping[str, Path]) -> None:
    """List the photographs that are not in the mosaic, each with the reason."""
    with ui.element("ul").classes("photographs").props('aria-label="Photographs left out"'):
        for name, reason in result.left_out.items():
            with ui.element("li"):
                if name in thumbnails:
                    ui.element("img").props('alt="" loading="lazy"').props["src"] = picture_address(thumbnails[name])
                ui.label(f"left out: {reason}").classes("fault")
