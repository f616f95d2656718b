"""The left column: photographs, choices, and the button that runs them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from skymosaic.errors import InputError
from skymosaic.panel.choices import OPTIONS, Choices
from skymosaic.panel.drop_zone import DropZone
from skymosaic.panel.outcomes import Upload
from skymosaic.panel.slider import Slider
from skymosaic.panel.uploads import MEBIBYTE, PHOTOGRAPH
from skymosaic.panel.visitors import Visitor

LABELS = {
    "preset": "Preset",
    "detector": "Detector",
    "descriptor": "Descriptor",
    "rule_base": "Fuzzy rules",
    "estimator": "Estimator",
    "blending": "Blending",
    "backend": "Backend",
}


def heading(number: str, text: str) -> None:
    """A numbered heading of the column."""
    ui.html(f'<span class="step">{number}</span>{text}', tag="h2", sanitize=False)


class PhotographsCard:
    """Uploads and what is loaded."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._shown: list[Upload] | None = None
        with ui.element("section").classes("card"):
            with ui.element("div").classes("card-head"):
                heading("1", "Photographs")
                ui.button("Built-in flight", icon="flight", on_click=visitor.load_built_in_pair).props(
                    "flat dense no-caps size=sm"
                )
            DropZone(
                url="/upload/photograph",
                accept="image/*,.tif,.tiff",
                multiple=True,
                label="Choose photographs",
                title="Drop photographs here, or choose",
                hint=f"two or more that overlap · up to {PHOTOGRAPH.limit_bytes // MEBIBYTE} MB each",
                on_refused=lambda line: ui.notify(line, type="negative", timeout=10_000, close_button="OK"),
            )
            self._list = ui.element("ul").classes("photographs").props('aria-label="Photographs loaded"')
        self.update()

    def update(self) -> None:
        """Show the photographs there are now."""
        if self._shown == self._visitor.photographs:
            return
        self._shown = list(self._visitor.photographs)
        self._list.clear()
        with self._list:
            for position, upload in enumerate(self._shown):
                self._row(position, upload)

    def _row(self, position: int, upload: Upload) -> None:
        visitor = self._visitor
        with ui.element("li"):
            ui.element("img").props(f'src="/picture/{upload.working.name}" alt=""')
            with ui.element("div").classes("what"):
                ui.label(upload.name).classes("name")
                ui.label(" · ".join(("x".join(map(str, upload.size)), *upload.notes))).classes("hint")
            if position == 0 and len(visitor.photographs) > 1:
                ui.button(icon="swap_vert", on_click=visitor.swap_first).props(
                    'flat round dense size=sm aria-label="Exchange the first two photographs"'
                )
            ui.button(icon="close", on_click=lambda: visitor.remove_photograph(upload)).props(
                f'flat round dense size=sm aria-label="Remove {upload.name}"'
            )


class ChoicesCard:
    """Every choice, and the slider that moves the corners at once."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._selects: dict[str, ui.select] = {}
        with ui.element("section").classes("card"):
            heading("2", "Choices")
            with ui.element("div").classes("choices"):
                for name in LABELS:
                    self._selects[name] = self._select(name)
                self._refine = ui.switch("Second pass", on_change=self._on_change("refine")).props("dense")
                self._build_slider()
            self._fault = ui.label().classes("fault").props('role="status"')
        self.update()

    def update(self) -> None:
        """Show the visitor's choices, which another tab or a preset may have changed."""
        choices = self._visitor.choices
        for name, select in self._selects.items():
            select.set_value(getattr(choices, name))
        self._refine.set_value(choices.refine)
        scale = choices.scale
        self._slider_title.set_text(scale.title)
        words = f"{scale.value(choices.position):,}".replace(",", "\u2009")
        self._slider_value.set_text(words)
        self._slider.show(
            lowest=scale.lowest, highest=scale.highest, position=choices.position, label=scale.title, words=words
        )
        self._fault.set_text(fault_of(choices))

    def _select(self, name: str) -> ui.select:
        values = [*OPTIONS[name], *(self._visitor.boards if name == "backend" else ())]
        select = ui.select(values, label=LABELS[name], on_change=self._on_change(name))
        return select.props("outlined dense options-dense").classes("choice")

    def _build_slider(self) -> None:
        with ui.element("div").classes("threshold"):
            with ui.element("div").classes("threshold-head"):
                self._slider_title = ui.label()
                self._slider_value = ui.label().classes("value").props('aria-live="polite"')
            self._slider = Slider(lambda position: self._visitor.choose("position", position))

    def _on_change(self, name: str) -> Callable[[ValueChangeEventArguments[Any]], None]:
        def change(event: ValueChangeEventArguments[Any]) -> None:
            self._visitor.choose(name, event.value)

        return change


class RunCard:
    """The button, and while work runs its progress and its end."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with ui.element("section").classes("card run"):
            self._run = ui.button("Make the mosaic", icon="play_arrow", on_click=visitor.make_mosaic)
            self._run.props("unelevated no-caps").classes("run-button")
            with ui.element("div").classes("running") as self._running:
                with ui.element("div").classes("running-head"):
                    self._title = ui.label().classes("name")
                    ui.button("Cancel", icon="stop", on_click=visitor.cancel).props("outline dense no-caps size=sm")
                ui.linear_progress(show_value=False).props('indeterminate rounded aria-label="Working"')
                self._line = ui.label().classes("hint").props('role="status"')
            self._fault = ui.label().classes("fault").props('role="alert"')
        ui.timer(0.25, self._tick)
        self.update()

    def update(self) -> None:
        """Show whether work runs, and how the last one ended."""
        visitor = self._visitor
        self._run.set_visibility(visitor.job is None)
        self._run.set_enabled(len(visitor.photographs) > 1 and not fault_of(visitor.choices))
        self._running.set_visibility(visitor.job is not None)
        self._fault.set_text(visitor.fault)
        self._tick()

    def _tick(self) -> None:
        job = self._visitor.job
        if job is not None:
            self._title.set_text(job.title)
            self._line.set_text(f"{job.line} · {job.seconds:.0f} s")


def fault_of(choices: Choices) -> str:
    """Why choices do not go together; empty where they do."""
    try:
        choices.settled()
    except (InputError, ValueError) as error:
        return str(error)
    return ""
