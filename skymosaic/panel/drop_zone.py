"""Where files are dropped or chosen."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui


class DropZone(ui.element, component="drop_zone.js"):
    """Sends files to ``url``, one at a time.

    Parameters
    ----------
    url : str
        Takes each file as the body of a POST, its name as the parameter ``name``.
    accept : str
        Media types and suffixes the file dialogue offers.
    multiple : bool
        Whether more than one may be chosen.
    label : str
        Accessible name.
    title, hint : str
        What is read in it.
    on_refused : callable
        Receives the server's line for each file it did not take.
    """

    def __init__(
        self,
        *,
        url: str,
        accept: str,
        multiple: bool,
        label: str,
        title: str,
        hint: str,
        on_refused: Callable[[str], None],
    ) -> None:
        super().__init__()
        self.props.update(url=url, accept=accept, multiple=multiple, label=label, title=title, hint=hint)
        self.on("refused", lambda event: on_refused(str(event.args)))
