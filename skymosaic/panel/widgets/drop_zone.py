"""The area where files are dropped or chosen for upload."""

from nicegui import ui

from skymosaic.panel.uploads import KINDS, MEBIBYTE


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
