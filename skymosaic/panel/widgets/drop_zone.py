"""The area where files are dropped or chosen for upload."""

from nicegui import ui


class DropZone(ui.element, component="drop_zone.js"):
    """Uploads files to ``url``, one at a time; the server's reasons for refusing files stay until they are dismissed.

    Parameters
    ----------
    url : str
        Receives each file as the body of a POST, its name as the query parameter ``name``.
    accept : str
        Media types and suffixes that the file dialogue offers.
    multiple : bool
        Whether more than one may be chosen.
    label : str
        Accessible name.
    title, hint : str
        Text shown in the area.
    """

    def __init__(self, *, url: str, accept: str, multiple: bool, label: str, title: str, hint: str) -> None:
        super().__init__()
        self.props.update(url=url, accept=accept, multiple=multiple, label=label, title=title, hint=hint)
