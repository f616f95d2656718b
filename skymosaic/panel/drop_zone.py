"""Where files are dropped or chosen."""

from __future__ import annotations

from nicegui import ui


class DropZone(ui.element, component="drop_zone.js"):
    """Sends files to ``url``, one at a time; a file that is not taken is told with the server's reason.

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
    ) -> None:
        super().__init__()
        self.props.update(url=url, accept=accept, multiple=multiple, label=label, title=title, hint=hint)
        self.on("refused", lambda event: _tell(str(event.args)))


def _tell(line: str) -> None:
    """Show why a file was not taken."""
    ui.notify(line, type="negative", timeout=10_000, actions=[{"label": "OK", "color": "white"}])
