"""The thumbnails of many photographs, which appear as they are made."""

from collections.abc import Callable, Mapping, Sequence

from nicegui import ui

from skymosaic.panel.results import InputFile, picture_address

MAX_TILES = 500
"""Browsers stop answering while they lay out thousands."""


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
