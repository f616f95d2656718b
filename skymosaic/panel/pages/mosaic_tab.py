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
    layers = {"Outlines": drawings.draw_outlines(result.mosaic.outlines.values())}
    if result.mosaic.seams:
        layers["Seams"] = drawings.draw_seams(result.mosaic.seams)
    if result.links:
        layers["Links"] = drawings.draw_links(result.mosaic.outlines, result.links)
    _show_mosaic(result.mosaic, layers)
    show_files("/file/mosaic", result.folder)
    if result.left_out:
        with ui.element("ul").classes("photographs").props('aria-label="Photographs left out"'):
            for name, reason in result.left_out.items():
                with ui.element("li"):
                    if name in thumbnails:
                        picture = ui.element("img").props('alt="" loading="lazy"')
                        picture.props["src"] = picture_address(thumbnails[name])
                    ui.label(f"left out: {reason}").classes("fault")


def _show_mosaic(mosaic: ShownMosaic, layers: Mapping[str, str]) -> None:
    """Show the mosaic, with a switch for each layer that can be drawn over it."""

    def draw() -> None:
        viewer.draw("".join(layer for name, layer in layers.items() if switches[name].value))

    with ui.element("div").classes("bar"):
        ui.label(f"{mosaic.size[0]} x {mosaic.size[1]} px, {len(mosaic.outlines)} photographs").classes("name")
        ui.label("Wheel or + and - zoom, drag moves.").classes("hint")
        ui.element("div").classes("grow")
        switches = {name: ui.switch(name, on_change=draw).props("dense") for name in layers}
    viewer = Viewer("Mosaic", [mosaic.picture], tiles=mosaic.tiles)
