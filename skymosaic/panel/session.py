"""The session: the photographs, options and results of the panel's owner."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import Event, background_tasks
from nicegui.binding import BindableProperty

from skymosaic.common.errors import InputError
from skymosaic.panel.folders import Roots
from skymosaic.panel.inputs import Inputs
from skymosaic.panel.options import Options, in_labels
from skymosaic.panel.results import HardwareResult, MosaicResult, TrackingResult
from skymosaic.panel.rules_edit import RulesEdit
from skymosaic.panel.runs import Runs
from skymosaic.panel.session_files import SessionFiles
from skymosaic.panel.tasks import mosaic_tasks, tracking_tasks, upload_tasks
from skymosaic.panel.tasks.jobs import Job, JobCancelledError, JobFailedError, Task


class Session:
    """The owner's photographs, options and results, shared by all browsers and tabs and kept when a page is reloaded.

    Finished runs are kept in ``runs``, which has room for all other files. Folders below ``roots`` may be opened, and
    ``boards`` chosen as backends, ``board:HOST``.
    """

    job = BindableProperty()
    """The running job, or None; controls can be bound to it."""

    def __init__(self, runs: Runs, roots: Roots, boards: tuple[str, ...] = ()) -> None:
        self.runs, self.boards = runs, boards
        self.files = SessionFiles(runs.unfinished)
        self.changed: Event[[]] = Event()
        """Emitted whenever something that a page shows has changed."""
        self.inputs = Inputs(self.files, roots, self.changed, lambda: self.options.keeps_damaged)
        self._job_queue = asyncio.Semaphore(1)
        self._mosaic_inputs: tuple[object, ...] = ()
        self.options = Options.of_preset("aerial")
        self.mosaic_result: MosaicResult | None = None
        self.hardware_result: HardwareResult | None = None
        self.tracking_result: TrackingResult | None = None
        self.rules_edit: RulesEdit | None = None
        """Other rules for the pair that is shown; None where no rules decide."""
        self.job = None
        self.fault = ""
        """Why the last job ended without a result; empty if it had one, or was cancelled, as ``note`` says."""
        self.note = ""

    @property
    def results(self) -> dict[str, MosaicResult | TrackingResult]:
        """The results that have a folder, by the names of these folders in the archive."""
        results = {"mosaic": self.mosaic_result, "tracking": self.tracking_result}
        return {name: result for name, result in results.items() if result}

    @property
    def is_outdated(self) -> bool:
        """Whether options or photographs have changed since the mosaic was made."""
        return self.mosaic_result is not None and self._mosaic_inputs != (self.options, *self.inputs.photographs)

    def set_option(self, name: str, value: Any) -> None:
        """Change one of the options."""
        options = self.options.changed(name, value)
        if options != self.options:
            self.options = options
            self.changed.emit()

    def load_built_in(self, count: int) -> None:
        """Replace the photographs by the built-in pair, or by a built-in flight of more than two."""
        names = [f"{self.files.new_number()}_built-in.png" for _ in range(count)]
        self._render("Rendering photographs", self.inputs.set_photographs, upload_tasks.render_photographs, names)

    def load_built_in_film(self) -> None:
        """Replace template and video by the built-in film of a car."""
        names = [f"{self.files.new_number()}_{name}" for name in ("car.png", "film.mp4")]
        self._render("Rendering the film of a car", self.inputs.set_film, upload_tasks.render_pursuit, names)

    def _render(self, title: str, accept: Callable[[Any], None], task: Task, names: list[str]) -> None:
        folder, pictures = self.files.folder("uploads"), self.files.folder("pictures/uploads")
        self._start(title, accept, task, folder, names, pictures)

    def make_mosaic(self) -> None:
        """Make a mosaic of the photographs with the options as they are."""
        if self.job is not None:
            return
        # As they are now: both may change while the job runs.
        inputs = self.options, *self.inputs.photographs
        run, pictures = self.files.new_run(self.inputs.photographs, self._shown_folders)

        def accept(result: MosaicResult) -> None:
            self._mosaic_inputs = inputs
            self._show_result(replace(result, folder=self._keep(result.folder, title)))

        paths = [each.path for each in self.inputs.photographs]
        place = ", ".join(paths[:2]) if self.inputs.photographs[0].is_upload else Path(paths[0]).parent
        title = f"{len(paths)} photographs: {place}"
        self._start("Making the mosaic", accept, mosaic_tasks.make_mosaic, run, paths, self.options, pictures)

    def look_at_pair(self, names: tuple[str, str]) -> None:
        """Register one pair of a flight again, to show its matches."""
        assert self.mosaic_result is not None

        folder, task = self.mosaic_result.folder, mosaic_tasks.look_at_pair
        self._start("Matching the pair", self._show_result, task, folder, self.mosaic_result, names)

    def compare_hardware(self, backend: str) -> None:
        """Run the pair that is shown through hardware."""
        assert self.mosaic_result is not None
        result = self.mosaic_result
        paths = tuple(result.paths[name] for name in result.pair_names)
        accept = partial(setattr, self, "hardware_result")
        task, title = mosaic_tasks.compare_hardware, "Comparing with the golden model"
        self._start(title, accept, task, result.folder, paths, result.options, backend)

    def track(self) -> None:
        """Follow the template through the video."""
        if self.job is not None:
            return
        assert self.inputs.template is not None
        assert self.inputs.video is not None
        names = self.inputs.template.name, self.inputs.video.name
        run, pictures = self.files.new_run([self.inputs.template, self.inputs.video], self._shown_folders)

        def accept(result: TrackingResult) -> None:
            self.tracking_result = replace(result, folder=self._keep(result.folder, " in ".join(names)))

        self._start("Tracking", accept, tracking_tasks.follow, run, *names, self.options, pictures)

    def cancel(self) -> None:
        """Cancel the running job; earlier results stay."""
        if self.job is not None:
            self.job.cancel()

    def close(self) -> None:
        """Cancel the job and the reading of a folder."""
        self.cancel()
        self.inputs.stop_reading()

    def _start(self, title: str, accept: Callable[[Any], None], task: Task, folder: Path, *arguments: object) -> None:
        """Run ``task`` in a worker and hand its result to ``accept``; nothing happens while another job runs."""
        if self.job is not None:
            return
        self.job, self.fault, self.note = Job(title, task, folder, *arguments), "", ""
        background_tasks.create(self._finish(self.job, accept), name=title)
        self.changed.emit()

    async def _finish(self, job: Job, accept: Callable[[Any], None]) -> None:
        try:
            accept(await job.run(self._job_queue))
        except JobCancelledError:
            self.note = f"{job.title}: cancelled"
        except JobFailedError as error:
            self.fault = in_labels(error)
        finally:
            self.job = None
            self.changed.emit()

    @property
    def _shown_folders(self) -> set[str]:
        """Names of the folders of runs and pictures that the page shows."""
        # A run and its pictures have the same name.
        shown = {result.pictures.name for result in self.results.values()}
        return {"uploads", *shown, *(each.thumbnail.parent.name for each in self.inputs.photographs)}

    def _keep(self, run: Path, title: str) -> Path:
        """Keep a run's folder beyond the session; returns where it is now."""
        try:
            return self.runs.keep(run, title)
        except (InputError, OSError) as error:
            self.fault = f"the run is shown, but could not be kept: {error}"
            return run

    def _show_result(self, result: MosaicResult) -> None:
        self.mosaic_result, self.hardware_result = result, None
        self.rules_edit = RulesEdit(result) if RulesEdit.applies_to(result) else None
