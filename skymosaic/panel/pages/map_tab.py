"""A mosaic with GPS on a map: the mosaic and its outlines over a plain grid; no other server is asked for anything.

Leaflet comes with NiceGUI, which serves it locally.
"""

from __future__ import annotations

import math

from nicegui import ui

from skymosaic.panel.results import MapView
from skymosaic.panel.tasks.map_picture import METRES_A_DEGREE

TILE_PX = 256
SHOWN_PX = 600
"""About the size of the map on the page, for the first zoom."""
GRID = {"color": "#7a8c99", "weight": 1, "opacity": 0.5, "interactive": False}
OUTLINE = {"color": "#ffb020", "weight": 1.5, "fill": False, "interactive": False}


def build_map_tab(shown: MapView | None) -> None:
    """Show a georeferenced mosaic, or why there is none."""
    if shown is None:
        ui.label(
            "This mosaic has no place on a map: that needs GPS in the photographs' EXIF data, and photographs whose "
            "layout agrees with it."
        ).classes("hint empty")
        return
    south, west, north, east = shown.bounds
    with ui.element("div").classes("bar"):
        ui.label(shown.crs).classes("name")
        ui.label(f"Grid of {shown.grid_m:g} m. Drag moves, the wheel zooms.").classes("hint")
        ui.element("div").classes("grow")
        switch = ui.switch("Outlines on the map").props("dense")
    longest = max(east - west, (north - south) / math.cos(math.radians(north)))
    zoom = math.log2(SHOWN_PX / TILE_PX * 360 / longest)
    options = {"attributionControl": False, "maxZoom": 26, "zoomSnap": 0.25}
    page_map = ui.leaflet(((south + north) / 2, (west + east) / 2), round(4 * zoom) // 4, options=options)
    page_map.classes("map").props('role="region" aria-label="Map"')
    # NiceGUI begins with a map of the world from another server.
    page_map.clear_layers()
    for line in _grid(shown):
        page_map.generic_layer(name="polyline", args=[line, GRID])
    page_map.image_overlay(
        url=f"/picture/{shown.picture.name}",
        bounds=[[south, west], [north, east]],
        options={"alt": "The mosaic"},
    )
    outlines = [
        page_map.generic_layer(name="polygon", args=[corners, OUTLINE | {"opacity": 0}])
        for corners in shown.outlines.values()
    ]

    def show_outlines(visible: bool) -> None:
        for outline in outlines:
            outline.run_method("setStyle", {"opacity": 1 if visible else 0})

    switch.on_value_change(lambda event: show_outlines(event.value))


def _grid(shown: MapView) -> list[list[tuple[float, float]]]:
    """Lines of the grid, one mosaic's size beyond it on each side."""
    south, west, north, east = shown.bounds
    high, wide = north - south, east - west
    south, north, west, east = south - high, north + high, west - wide, east + wide
    step = shown.grid_m / METRES_A_DEGREE
    step_east = step / math.cos(math.radians((south + north) / 2))
    rows = [south + step * number for number in range(math.ceil((north - south) / step) + 1)]
    columns = [west + step_east * number for number in range(math.ceil((east - west) / step_east) + 1)]
    return [[(row, west), (row, east)] for row in rows] + [[(south, column), (north, column)] for column in columns]
