"""The page that follows an object through a video."""

from nicegui import ui

from skymosaic.panel.pages.page_layout import page_layout, show_command, show_files
from skymosaic.panel.pages.sidebar import RunCard, build_heading, build_input, build_option, enable_while_idle
from skymosaic.panel.results import InputFile, TrackingResult, picture_address
from skymosaic.panel.session import Session
from skymosaic.panel.widgets import DropZone

CORNERS = ("top left", "top right", "bottom right", "bottom left")


def build_tracking_page(session: Session) -> None:
    """Build the page of a session, with the files and results it already has."""

    def is_ready() -> bool:
        return session.inputs.template is not None and session.inputs.video is not None

    with page_layout(session, "/tracking") as updates:
        with ui.element("section").classes("stack").props('aria-label="Object, video and options"'):
            updates.append(_UploadCard(session, "template", "1", "Object", "a picture of it, cut out").update)
            updates.append(_UploadCard(session, "video", "2", "Video", "MP4, MOV, MKV, WebM or AVI").update)
            with ui.element("section").classes("card"):
                build_heading("3", "Options")
                with ui.element("div").classes("options"):
                    updates += [build_option(session, name) for name in ("preset", "backend")]
            updates.append(RunCard(session, "Follow the object", session.track, is_ready).update)
        with ui.element("section").classes("stack").props('aria-label="Results"'):
            updates.append(_ResultCard(session).update)


class _UploadCard:
    """A drop zone for one file, and the file that is loaded; ``slot`` is its name in the session."""

    def __init__(self, session: Session, slot: str, number: str, title: str, hint: str) -> None:
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
        upload: InputFile | None = getattr(self._session.inputs, self._slot)
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
    labels = {"frame": "frame", **{name: f"{name} x, y" for name in CORNERS}, "matches": "matches"}
    columns = [{"name": name, "label": label, "field": name, "align": "right"} for name, label in labels.items()]
    rows = []
    for each in result.rows:
        corners = each.corners or ()
        positions = [f"{x:.1f}, {y:.1f}" for x, y in corners] or ["lost"] * len(CORNERS)
        rows.append({"frame": each.frame, "matches": each.inliers, **dict(zip(CORNERS, positions, strict=True))})
    table = ui.table(columns=columns, rows=rows, row_key="frame", pagination=8)
    table.props('dense flat wrap-cells :rows-per-page-options="[8]" aria-label="Corners of the object"').classes(
        "corner-table"
    )
