"""The element that shows pictures with a drawing over them: zoom, pan, and tiles where a picture is zoomed into.

Ours rather than OpenSeadragon or Leaflet: the lines of matches have to stay sharp and be found under the pointer at
every zoom, one viewer with the same keys and gestures serves corners, matches and mosaics, and SVG shows a tile like
any other picture. What is left is to choose the tiles, a dozen lines.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict

from nicegui import ui

from skymosaic.panel.results import Picture


class Viewer(ui.element, component="viewer.js"):
    """Pictures with an SVG drawing over them, and an accessible name.

    Tiles are parts in more detail; only those in view are loaded, of the scale that the screen shows.
    """

    def __init__(self, label: str, pictures: Sequence[Picture], tiles: Sequence[Picture] = ()) -> None:
        super().__init__()
        size = max(each.x + each.width for each in pictures), max(each.y + each.height for each in pictures)
        self.props.update(label=label, pictures=list(map(asdict, pictures)), tiles=list(map(asdict, tiles)))
        self.props.update(size=size, drawing="")

    def draw(self, drawing: str) -> None:
        """Replace the drawing, SVG in viewer pixels.

        It is inserted without escaping: numbers and the panel's own words only, never text from a user.
        """
        self.props["drawing"] = drawing

    def highlight(self, drawing: str) -> None:
        """Replace what is drawn on top, without sending the drawing itself again."""
        self.run_method("showHighlight", drawing)

    def on_pointer(self, event: str, handler: Callable[[float, float, float], None]) -> None:
        """Call ``handler`` on "hover" (at most 25 times per second) or "pick" (a click without dragging).

        It gets x and y in viewer pixels, and how many pixels of the screen one of these has.
        """
        self.on(event, lambda sent: handler(*(float(sent.args[name]) for name in ("x", "y", "scale"))))
