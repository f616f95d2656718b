"""The mosaic with zoom, and the outlines of its photographs."""

from __future__ import annotations

from nicegui import ui

from skymosaic.panel.pages import drawings
from skymosaic.panel.results import MosaicResult
from skymosaic.panel.widgets.viewer import Picture, Viewer


def build_mosaic_tab(result: MosaicResult) -> None:
    """Show a run's mosaic, or why there is none."""
    if result.mosaic is None:
        with ui.element("div").classes("empty"):
            ui.html("No mosaic could be made", tag="h2", sanitize=False)
            ui.label(result.reason).classes("fault")
            ui.label("The Matches tab shows what was found and why matches were rejected.").classes("hint")
        return
    mosaic = result.mosaic
    with ui.element("div").classes("bar"):
        ui.label(f"{mosaic.size[0]} x {mosaic.size[1]} px, {len(mosaic.outlines)} photographs").classes("name")
        ui.label("Wheel or + and - zoom, drag moves.").classes("hint")
        ui.element("div").classes("grow")
        switch = ui.switch("Outlines").props("dense")
    viewer = Viewer("Mosaic", [Picture(f"/picture/{mosaic.picture.name}", *mosaic.shown_size)])
    markup = drawings.outlines(mosaic.outlines.values())
    switch.on_value_change(lambda event: viewer.draw(markup if event.value else ""))
    for reason in result.left_out:
        ui.label(f"left out: {reason}").classes("fault")
