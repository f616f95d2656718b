"""The left column: photographs, options, and the button that starts a run."""

from collections.abc import Callable
from functools import partial
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.disableable_element import DisableableElement
from nicegui.events import ValueChangeEventArguments

from golden_model.text import one_line
from skymosaic.panel.options import LABELLED, OPTION_VALUES, fault_of
from skymosaic.panel.pages.folder_picker import FolderPicker
from skymosaic.panel.results import InputFile, picture_address
from skymosaic.panel.session import Session
from skymosaic.panel.widgets import MAX_TILES, DropZone, Slider, Thumbnails

BUILT_IN = {"Pair": 2, "Flight": 9}
"""Number of photographs in each built-in example."""
MAX_ROWS = 6
"""With more photographs than this, tiles replace the rows, so that all are visible."""


def build_heading(number: str, text: str) -> None:
    """Build a numbered heading of the column."""
    ui.html(f'<span class="step">{number}</span>{text}', tag="h2", sanitize=False)


def build_input(file: InputFile) -> None:
    """Build thumbnail and name of a file, and size and notes once it is decoded."""
    image = ui.element("img").props('alt=""')
    image.props["src"] = picture_address(file.thumbnail)
    with ui.element("div").classes("what"):
        ui.label(file.name).classes("name")
        if file.decoded:
            ui.label(" · ".join(("x".join(map(str, file.decoded.size)), *file.decoded.notes))).classes("hint")


def enable_while_idle(control: DisableableElement, session: Session) -> None:
    """Disable a control that starts a job while a job runs."""
    control.bind_enabled_from(session, "job", lambda job: job is None)


class PhotographsCard:
    """The upload area and the list of photographs."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._shown: tuple[object, ...] = ()
        self._tiles: Thumbnails | None = None
        with ui.element("section").classes("card"):
            with ui.element("div").classes("card-head"):
                build_heading("1", "Photographs")
                with ui.element("div").classes("built-in"):
                    for title, count in BUILT_IN.items():
                        button = ui.button(title, icon="flight", on_click=partial(session.load_built_in, count))
                        button.props(f'flat dense no-caps size=sm aria-label="Load the built-in {title.lower()}"')
                        enable_while_idle(button, session)
            FolderPicker(session.inputs)
            title, hint = "Drop photographs here, or choose", "two or more that overlap"
            DropZone("photograph", "Choose photographs", title, hint, multiple=True)
            self._container = ui.element("div").classes("loaded")
            self._warnings = ui.label().classes("warnings").props('role="status" aria-label="Warnings"')
            with ui.element("div").classes("card-head") as self._summary:
                self._count = ui.label().classes("hint")
                ui.button("Remove all", on_click=lambda: session.inputs.set_photographs(())).props(
                    "flat dense no-caps size=sm"
                )
        # A folder is read without an event for each photograph, so that is polled.
        ui.timer(0.25, self._tick)

    def update(self) -> None:
        """Show the photographs as they are now."""
        inputs, result = self._session.inputs, self._session.mosaic_result
        problems = result.problems if result else {}
        warnings = [f"{name}: {', '.join(faults)}" for name, faults in problems.items()]
        warnings += [inputs.unread] if inputs.unread else []
        self._warnings.set_text("\n".join(map(one_line, warnings)))
        self._warnings.set_visibility(bool(warnings))
        shown = (problems, inputs.reading is None, [(each, each.decoded) for each in inputs.photographs])
        if self._shown == shown:
            return
        self._shown = shown
        self._summary.set_visibility(len(inputs.photographs) > 2)
        self._container.clear()
        self._tiles = None
        with self._container:
            if len(inputs.photographs) > MAX_ROWS:
                self._tiles = Thumbnails(inputs.photographs, problems, self._read(), self._remove)
            else:
                with ui.element("ul").classes("photographs").props('aria-label="Photographs loaded"'):
                    for position, file in enumerate(inputs.photographs):
                        self._build_row(position, file)
        self._tick()

    def _read(self) -> int:
        """How many photographs have a thumbnail."""
        reading = self._session.inputs.reading
        return reading.steps.done if reading else len(self._session.inputs.photographs)

    def _tick(self) -> None:
        count, read = len(self._session.inputs.photographs), self._read()
        words = [f"{count} photographs"] + ([f"the first {MAX_TILES} are shown"] if count > MAX_TILES else [])
        self._count.set_text(", ".join(words + ([f"{read} read"] if read < count else [])))
        if self._tiles is not None and self._session.inputs.reading:
            self._tiles.show(read)

    def _build_row(self, position: int, file: InputFile) -> None:
        session = self._session
        with ui.element("li"):
            build_input(file)
            if position == 0 and len(session.inputs.photographs) > 1:
                ui.button(icon="swap_vert", on_click=session.inputs.swap_first).props(
                    'flat round dense size=sm aria-label="Swap the first two photographs"'
                )
            remove = ui.button(icon="close", on_click=partial(self._remove, file.name)).props(
                "flat round dense size=sm"
            )
            remove.props["aria-label"] = f"Remove {file.name}"

    def _remove(self, name: str) -> None:
        self._session.inputs.set_photographs(kept for kept in self._session.inputs.photographs if kept.name != name)


class OptionsCard:
    """The preset; behind "Advanced", all other options and the threshold slider, which the corners follow at once."""

    def __init__(self, session: Session) -> None:
        self._session = session
        with ui.element("section").classes("card"):
            build_heading("2", "Options")
            # Above the options: the lower end of the card may be scrolled out of sight.
            self._fault = ui.label().classes("fault").props('role="status"')
            preset, *others = sorted(LABELLED, key=lambda name: name not in OPTION_VALUES)
            self._show_options = [build_option(session, preset)]
            with ui.expansion("Advanced").classes("advanced"), ui.element("div").classes("options"):
                self._show_options += [build_option(session, name) for name in others]
                with ui.element("div").classes("threshold"):
                    with ui.element("div").classes("threshold-head"):
                        self._slider_title = ui.label()
                        self._slider_value = ui.label().classes("value").props('aria-live="polite"')
                    self._slider = Slider(lambda position: session.set_option("position", position))

    def update(self) -> None:
        """Show the session's options, which another tab or a preset may have changed."""
        options = self._session.options
        for show in self._show_options:
            show()
        scale = options.slider_scale
        self._slider_title.set_text(scale.title)
        # A thin space separates thousands.
        words = f"{scale.values[options.position]:,}".replace(",", "\u2009")
        self._slider_value.set_text(words)
        self._slider.show(
            lowest=min(scale.values),
            highest=max(scale.values),
            position=options.position,
            label=scale.title,
            words=words,
        )
        self._fault.set_text(fault_of(options, len(self._session.inputs.photographs)))


def build_option(session: Session, name: str) -> Callable[[], object]:
    """Build the list of an option's values, or the switch of one that is on or off; returns what shows it anew."""

    def change(event: ValueChangeEventArguments[Any]) -> None:
        session.set_option(name, event.value)

    label = LABELLED[name].label
    if name not in OPTION_VALUES:
        switch = ui.switch(label, on_change=change).props("dense")
        return lambda: switch.set_value(session.options.shown(name))
    values = [*OPTION_VALUES[name], *(session.boards if name == "backend" else ())]
    select = ui.select(values, label=label, on_change=change).props("outlined dense options-dense").classes("option")

    def show() -> None:
        shown = session.options.shown(name)
        # Rules of one's own are none of the names.
        offered = values if shown in values else [*values, shown]
        if offered != select.options:
            select.set_options(offered)
        select.set_value(shown)

    return show


class RunCard:
    """The button that starts a job; while a job runs, its progress and a button that cancels it."""

    def __init__(self, session: Session, title: str, run: Callable[[], None], is_ready: Callable[[], bool]) -> None:
        self._session = session
        self._is_ready = is_ready
        with ui.element("section").classes("card run"):
            self._run = ui.button(title, icon="play_arrow", on_click=run)
            self._run.props("unelevated no-caps").classes("run-button")
            with ui.element("div").classes("running") as self._running:
                with ui.element("div").classes("running-head"):
                    self._title = ui.label().classes("name")
                    ui.button("Cancel", icon="stop", on_click=session.cancel).props("outline dense no-caps size=sm")
                self._bar = ui.linear_progress(show_value=False).props('rounded aria-label="Working"')
                self._line = ui.label().classes("hint").props('role="status"')
            self._note = ui.label().classes("hint note").props('role="status"')
            self._fault = ui.label().classes("fault").props('role="alert"')
        # A job's line and seconds change without an event, so they are polled.
        ui.timer(0.25, self._tick)

    def update(self) -> None:
        """Show whether a job runs, and why the last one failed."""
        session = self._session
        self._run.set_visibility(session.job is None)
        self._run.set_enabled(self._is_ready())
        self._running.set_visibility(session.job is not None)
        self._note.set_text(session.note)
        self._fault.set_text(session.fault)
        self._tick()

    def _tick(self) -> None:
        job = self._session.job
        if job is not None:
            self._title.set_text(job.title)
            left = job.steps.seconds_left()
            estimate = f" · about {left:.0f} s left in this step" if left is not None else ""
            self._line.set_text(f"{job.line} · {job.seconds:.0f} s{estimate}")
            self._bar.props["indeterminate"] = job.steps.share is None
            self._bar.set_value(job.steps.share or 0.0)
