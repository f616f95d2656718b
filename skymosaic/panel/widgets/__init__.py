"""Elements of our own, each a class here and a component for the browser beside it."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict

from nicegui import ui
from nicegui.events import GenericEventArguments

from skymosaic.panel.results import InputFile, Picture, picture_address
from skymosaic.panel.uploads import KINDS, MEBIBYTE

OnCorner = Callable[[int, float, float], Awaitable[None]]
INTERVAL_S = 0.05
"""A slider moves at once in the browser, and reports to the server at most 20 times per second."""
MAX_TILES = 500
"""Browsers stop answering while they lay out thousands."""


class Curves(ui.element, component="curves.js"):
    """The membership curves of an input, with corners that a pointer or the arrow keys move.

    ``on_move`` is called with number, position and degree of a corner while it is moved; ``on_drop`` with the same when
    it has been moved. The corner stays there until `release`.
    """

    def __init__(self, on_move: OnCorner, on_drop: OnCorner) -> None:
        super().__init__()
        self.props.update(label="", high=1, curves=[], corners=[])
        self.on("move", _with_numbers(on_move))
        self.on("drop", _with_numbers(on_drop))

    def show(
        self, name: str, high: float, curves: Sequence[tuple[str, str]], corners: Sequence[tuple[float, float, str]]
    ) -> None:
        """Show an input from 0 to ``high``: curves (name, ``x,y`` in shares of the axes), corners (x, degree, name)."""
        self.props.update(label=f"Curves of {name}", high=high, curves=curves, corners=corners)

    def release(self) -> None:
        """Show all corners where the curves have them, but one that is being moved."""
        self.run_method("release")


def _with_numbers(handler: OnCorner) -> Callable[[GenericEventArguments], Awaitable[None]]:
    return lambda event: handler(int(event.args[0]), float(event.args[1]), float(event.args[2]))


class DropZone(ui.element, component="drop_zone.js"):
    """Uploads files, one at a time; the server's reasons for refusing files stay until they are dismissed.

    ``slot`` says what they are: a key of `skymosaic.panel.uploads.KINDS`. ``label`` is the accessible name of the area,
    which shows title and hint.
    """

    def __init__(self, slot: str, label: str, title: str, hint: str, *, multiple: bool = False) -> None:
        super().__init__()
        kind = KINDS[slot]
        limit = f"up to {kind.limit_bytes // MEBIBYTE} MB{' each' if multiple else ''}"
        self.props.update(url=f"/upload/{slot}", accept=kind.accept, multiple=multiple)
        self.props.update(label=label, title=title, hint=f"{hint} · {limit}")


class Slider(ui.element, component="slider.js"):
    """Whole positions from ``lowest`` to ``highest``; ``on_move`` receives the one that the user moves to."""

    def __init__(self, on_move: Callable[[int], None]) -> None:
        super().__init__()
        self._position: int | None = None

        def moved(position: int) -> None:
            self._position = position
            on_move(position)

        self.on("move", lambda event: moved(int(event.args)), throttle=INTERVAL_S)

    def show(self, *, lowest: int, highest: int, position: int, label: str, words: str) -> None:
        """Set the range, the accessible name, the value in words and, if it differs, the thumb's position."""
        self.props.update(min=lowest, max=highest, label=label, words=words)
        # A changed prop would not move a slider that the page has already built; only the method does.
        if self._position is None:
            self.props["start"] = position
        elif position != self._position:
            self.run_method("moveTo", position)
        self._position = position


class Thumbnails(ui.element, component="thumbnails.js"):
    """A tile for each of the first photographs, `MAX_TILES` at most; a border marks one that has problems.

    The first ``read`` of them have a thumbnail. ``remove`` receives the name of a photograph that is clicked.
    """

    def __init__(
        self,
        photographs: Sequence[InputFile],
        problems: Mapping[str, Sequence[str]],
        read: int,
        remove: Callable[[str], None],
    ) -> None:
        super().__init__()
        shown = photographs[:MAX_TILES]
        self.props["photographs"] = [{"name": x.name, "address": picture_address(x.thumbnail)} for x in shown]
        self.props["problems"] = {name: ", ".join(faults) for name, faults in problems.items()}
        self.props["read"] = read
        self.on("remove", lambda event: remove(str(event.args)))

    def show(self, read: int) -> None:
        """Show the first ``read`` thumbnails; the list itself is not sent again."""
        self.run_method("show", read)


class Viewer(ui.element, component="viewer.js"):
    """Pictures with an SVG drawing over them and an accessible name: zoom, pan, and tiles where one is zoomed into.

    Ours rather than OpenSeadragon or Leaflet: the lines of matches have to stay sharp and be found under the pointer at
    every zoom, one viewer with the same keys and gestures serves corners, matches and mosaics, and SVG shows a tile
    like any other picture. Tiles are parts in more detail; only those in view are loaded, of the scale that the screen
    shows.
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
