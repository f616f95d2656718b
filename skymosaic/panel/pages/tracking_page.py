"""The page that follows an object through a video."""

from nicegui import ui

from skymosaic.panel.pages.page_layout import page_layout, show_command, show_files
from skymosaic.panel.pages.sidebar import RunCard, build_heading, build_input, build_option_select, enable_while_idle
from skymosaic.panel.results import InputFile, TrackingResult, picture_address
from skymosaic.panel.session import Session
from skymosaic.panel.widgets.drop_zone import DropZone

CORNERS = ("top left", "top right", "bottom right", "bottom left")


def build_tracking_page(session: Session) -> None:
    """Build the page of a session, with the files and results it already has."""
    with page_layout(session, "/tracking"):
        with ui.element("section").classes("stack").props('aria-label="Object, video and options"'):
            cards = (
                _UploadCard(session, "template", number="1", title="Object", hint="a picture of it, cut out"),
                _UploadCard(session, "video", number="2", title="Video", hint="MP4, MOV, MKV, WebM or AVI"),
            )
            with ui.element("section").classes("card"):
                build_heading("3", "Options")
                with ui.element("div").classes("options"):
                    selects = {name: build_option_select(session, name) for name in ("preset", "backend")}
            run = RunCard(session, "Follow the object", session.track, lambda: bool(session.template and session.video))
        with ui.element("section").classes("stack").props('aria-label="Results"'):
            result_card = _ResultCard(session)

    def update() -> None:
        for card in cards:
            card.update()
        for name, select in selects.items():
            select.set_value(session.options.shown(name))
        run.update()
        result_card.update()

    session.changed.subscribe(update)
    update()


class _UploadCard:
    """A drop zone for one file, and the file that is loaded; ``slot`` is its name in the session."""

    def __init__(self, session: Session, slot: str, *, number: str, title: str, hint: str) -> None:
        self._session, self._slot = session, slot
        self._shown: InputFile | None = None
        with ui.element("section").classes("card"):
            with ui.element("div").classes("card-head"):
                build_heading(number, title)
                if slot == "template":
                    button = ui.button("Built-in film", icon="flight", on_click=session.load_built_in_film)
                    button.props('flat dense no-caps size=sm aria-label="Load the built-in film"')
                    enable_while_idle(button, session)
            what = title.lower()
            DropZone(slot, f"Choose {what}", f"Drop the {what} here, or choose", hint)
            self._container = ui.element("ul").classes("photographs").props(f'aria-label="{title} loaded"')

    def update(self) -> None:
        upload: InputFile | None = getattr(self._session, self._slot)
        if upload is not None and upload is not self._shown:
            self._shown = upload
            self._container.clear()
            with self._container, ui.element("li"):
                build_input(upload)


class _ResultCard:
    """The tracked video and the corners of every frame."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._shown: TrackingResult | None = None
        self._container = ui.element("div").classes("card welcome")
        with self._container:
            ui.html("An object and a video in, its outline in every frame out", tag="h2", sanitize=False)
            ui.label(
                "Give a picture of the object and a video that shows it, or begin with the built-in film of a car. "
                "The object's four corners are mapped into every frame and drawn as a green quadrilateral."
            ).classes("lead")
            button = ui.button("Try the built-in film", icon="flight", on_click=session.load_built_in_film)
            enable_while_idle(button.props("unelevated no-caps size=lg"), session)

    def update(self) -> None:
        result = self._session.tracking_result
        if result is None or result is self._shown:
            return
        self._shown = result
        self._container.clear()
        self._container.classes(remove="welcome")
        with self._container:
            frames = sum(row.corners is not None for row in result.rows)
            ui.label(
                f"Found in {frames} of {len(result.rows)} frames, {1000 * result.seconds_per_frame:.0f} ms per frame"
            ).classes("name").props('role="status"')
            for note in result.notes:
                ui.label(note).classes("hint")
            video = ui.element("video").classes("tracked")
            video.props(
                f'controls loop muted autoplay src="{picture_address(result.video)}" aria-label="Tracked video"'
            )
            _show_corners(result)
            show_files("/file/tracking", result.folder)
            show_command(result.command)


def _show_corners(result: TrackingResult) -> None:
    columns = [{"name": "frame", "label": "frame", "field": "frame", "align": "right"}]
    columns += [{"name": name, "label": f"{name} x, y", "field": name, "align": "right"} for name in CORNERS]
    columns.append({"name": "matches", "label": "matches", "field": "matches", "align": "right"})
    rows = []
    for each in result.rows:
        corners = each.corners or ()
        positions = [f"{x:.1f}, {y:.1f}" for x, y in corners] or ["lost"] * len(CORNERS)
        rows.append({"frame": each.frame, "matches": each.inliers, **dict(zip(CORNERS, positions, strict=True))})
    table = ui.table(columns=columns, rows=rows, row_key="frame", pagination=8)
    table.props('dense flat wrap-cells :rows-per-page-options="[8]" aria-label="Corners of the object"').classes(
        "corner-table"
    )
