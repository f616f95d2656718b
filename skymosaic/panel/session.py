"""A session: the photographs, options and results of one browser."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import Event, background_tasks
from nicegui.binding import BindableProperty

from skymosaic.common.errors import InputError
from skymosaic.panel.folders import OPEN, Roots
from skymosaic.panel.options import Options, in_labels
from skymosaic.panel.results import Decoded, HardwareResult, InputFile, MosaicResult, TrackingResult
from skymosaic.panel.rules_edit import RulesEdit
from skymosaic.panel.runs import Runs
from skymosaic.panel.session_files import MAX_BYTES, SessionFiles
from skymosaic.panel.tasks import mosaic_tasks, tracking_tasks, upload_tasks
from skymosaic.panel.tasks.jobs import Job, JobCancelledError, JobFailedError, Limits, Task
from skymosaic.panel.uploads import KINDS, MAX_UPLOADS_AT_ONCE, MAX_UPLOADS_OF_ALL, UploadRefusedError, receive

DECODING_LIMITS = Limits(seconds=120, processor_seconds=60, memory_bytes=2 << 30)


class Queues:
    """Limits for all sessions together: workers that run at once, for jobs, uploads and folders, and uploads under way.

    Uploads and folders have queues of their own and never wait for long jobs.
    """

    def __init__(self) -> None:
        self.jobs, self.uploads, self.folders = map(asyncio.Semaphore, (2, 2, 1))
        self.arriving = asyncio.Semaphore(MAX_UPLOADS_OF_ALL)


class Session:
    """One browser's photographs, options and results, shared by all its tabs and kept when a page is reloaded.

    Its folder is made when it gets its first file.
    """

    job = BindableProperty()
    """The running job, or None; controls can be bound to it."""

    def __init__(self, boards: tuple[str, ...], queues: Queues, make_folder: Callable[[Session], Path]) -> None:
        self.boards = boards
        """Backends that are boards."""
        self._queues = queues
        self._arriving = 0
        self.files = SessionFiles(partial(make_folder, self))
        self.last_active = time.monotonic()
        """When the last job or upload ended, s of the monotonic clock."""
        self._mosaic_inputs: tuple[object, ...] = ()
        self.roots = Roots()
        """Which folders may be opened; none unless the visitor came by the address that the panel printed."""
        self.runs: Runs | None = None
        """Where finished runs are kept; None for other visitors, whose runs go with the session."""
        self.photographs: list[InputFile] = []
        """Uploads, or the photographs of an opened folder."""
        self.reading: Job | None = None
        """Makes the thumbnails of the opened folder, in the order of the photographs."""
        self.unread = ""
        """What of the folder is not read, and which of its photographs could not be; empty if nothing."""
        self.options = Options.of_preset("aerial")
        self.mosaic_result: MosaicResult | None = None
        self.hardware_result: HardwareResult | None = None
        self.tracking_result: TrackingResult | None = None
        self.rules_edit: RulesEdit | None = None
        """Other rules for the pair that is shown; None where no rules decide."""
        self.template: InputFile | None = None
        self.video: InputFile | None = None
        self.job = None
        self.fault = ""
        """Why the last job ended without a result; empty if it had one."""
        self.changed: Event[[]] = Event()
        """Emitted whenever something that a page shows has changed."""

    @property
    def is_busy(self) -> bool:
        """Whether a job or an upload is running."""
        return self.job is not None or self._arriving > 0

    @property
    def results(self) -> dict[str, MosaicResult | TrackingResult]:
        """The results that have a folder, by the names of these folders in the archive."""
        results = {"mosaic": self.mosaic_result, "tracking": self.tracking_result}
        return {name: result for name, result in results.items() if result}

    @property
    def is_outdated(self) -> bool:
        """Whether options or photographs have changed since the mosaic was made."""
        return self.mosaic_result is not None and self._mosaic_inputs != (self.options, *self.photographs)

    async def upload(self, slot: str, body: AsyncIterator[bytes], name: str) -> None:
        """Receive a file for a slot, a key of `skymosaic.panel.uploads.KINDS`, check its kind and decode it.

        Raises
        ------
        UploadRefusedError
            If the file is refused, or too many are under way; it is removed completely.
        """
        if self._arriving >= MAX_UPLOADS_AT_ONCE:
            raise UploadRefusedError(f"{MAX_UPLOADS_AT_ONCE} files are arriving already; wait for them", 429)
        if self._queues.arriving.locked():
            raise UploadRefusedError("too many files are arriving from all visitors; try again", 503)
        self._arriving += 1
        try:
            async with self._queues.arriving:
                part = self.files.folder("uploads") / f"{self.files.new_number()}.part"
                path = await receive(body, name, KINDS[slot], part, room_bytes=MAX_BYTES - self.files.size_bytes)
                decoded = await self._decode(path, slot, self.files.folder("pictures/uploads"))
        except JobFailedError as error:
            path.unlink()
            raise UploadRefusedError(str(error)) from None
        finally:
            self._arriving -= 1
        self.last_active = time.monotonic()
        uploaded = InputFile.of_upload(path.name, decoded)
        if slot == "photograph":
            self.set_photographs((*(each for each in self.photographs if each.is_upload), uploaded))
        else:
            self._set_film({slot: uploaded})

    async def open_folder(self, path: str) -> None:
        """Load the photographs of a folder of this machine in place of those that are loaded; nothing is copied.

        Raises
        ------
        InputError
            For a folder outside of the roots or without photographs, or a link that leads out.
        """
        folder = await asyncio.to_thread(self.roots.find_folder, path)
        listing = await asyncio.to_thread(self.roots.list_photographs, folder)
        self._stop_reading()
        pictures = self.files.folder(f"pictures/{self.files.new_number()}")
        names = [photograph.name for photograph in listing.pictures]
        self.unread = listing.describe_unread(OPEN)
        self.reading = Job(f"Reading {folder}", upload_tasks.make_thumbnails, folder, names, pictures)
        background_tasks.create(self._finish_reading(self.reading, len(names)), name="reading")
        self.set_photographs(
            InputFile(str(each), pictures / f"{number}.jpg") for number, each in enumerate(listing.pictures, 1)
        )

    async def _finish_reading(self, job: Job, photographs: int) -> None:
        try:
            faults = await job.run(self._queues.folders)
        except JobCancelledError:
            return
        except JobFailedError as error:
            faults = [str(error)]
        if job is self.reading:
            count = f"{len(faults)} of {photographs} photographs could not be read" if len(faults) > 1 else ""
            named = "; the first: ".join(filter(None, (count, *faults[:1])))
            self.reading, self.unread = None, "; ".join(filter(None, (self.unread, named)))
            self.changed.emit()

    async def _decode_in_place(self, photograph: InputFile) -> None:
        try:
            photograph.decoded = await self._decode(Path(photograph.path), "photograph", photograph.thumbnail.parent)
        except JobFailedError as error:
            self.unread = str(error)
        self.changed.emit()

    async def _decode(self, path: Path, slot: str, pictures: Path) -> Decoded:
        """Decode a file in a worker, and save its working picture."""
        inspect_photograph = partial(upload_tasks.inspect_photograph, keep_damaged=self.options.keeps_damaged)
        task = upload_tasks.inspect_video if slot == "video" else inspect_photograph
        job = Job(f"Reading {path.name}", task, path.parent, path.name, pictures, limits=DECODING_LIMITS)
        decoded: Decoded = await job.run(self._queues.uploads)
        return decoded

    def set_photographs(self, photographs: Iterable[InputFile]) -> None:
        """Show other photographs; results made from those before stay, and so do files of a folder."""
        before, self.photographs = self.photographs, list(photographs)
        self.files.remove(set(before).difference(self.photographs))
        if all(each.is_upload for each in self.photographs):
            self._stop_reading()
        # Of a folder only the first two are decoded, whose corners are shown.
        for photograph in self.photographs[:2]:
            if photograph.decoded is None:
                background_tasks.create(self._decode_in_place(photograph), name="decoding")
        self.changed.emit()

    def swap_first(self) -> None:
        """Swap the first two photographs."""
        self.set_photographs((*self.photographs[1::-1], *self.photographs[2:]))

    def _stop_reading(self) -> None:
        """Forget the folder that was opened."""
        if self.reading is not None:
            self.reading.cancel()
        self.reading, self.unread = None, ""

    def set_option(self, name: str, value: Any) -> None:
        """Change one of the options."""
        options = self.options.changed(name, value)
        if options != self.options:
            self.options = options
            self.changed.emit()

    def load_built_in(self, count: int) -> None:
        """Replace the photographs by the built-in pair, or by a built-in flight of more than two."""
        names = [f"{self.files.new_number()}_built-in.png" for _ in range(count)]
        self._render("Rendering photographs", self.set_photographs, upload_tasks.render_photographs, names)

    def load_built_in_film(self) -> None:
        """Replace template and video by the built-in film of a car."""
        names = [f"{self.files.new_number()}_{name}" for name in ("car.png", "film.mp4")]
        self._render("Rendering the film of a car", self._set_film, upload_tasks.render_pursuit, names)

    def _render(self, title: str, accept: Callable[[Any], None], task: Task, names: list[str]) -> None:
        folder, pictures = self.files.folder("uploads"), self.files.folder("pictures/uploads")
        self._start(title, accept, task, folder, names, pictures)

    def make_mosaic(self) -> None:
        """Make a mosaic of the photographs with the options as they are."""
        if self.job is not None:
            return
        # As they are now: both may change while the job runs.
        inputs = self.options, *self.photographs
        run, pictures = self.files.new_run(self.photographs, self._shown_folders)

        def accept(result: MosaicResult) -> None:
            self._mosaic_inputs = inputs
            self._show_result(replace(result, folder=self._keep(result.folder, title)))

        paths = [each.path for each in self.photographs]
        place = ", ".join(paths[:2]) if self.photographs[0].is_upload else Path(paths[0]).parent
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
        assert self.template is not None
        assert self.video is not None
        names = self.template.name, self.video.name
        run, pictures = self.files.new_run([self.template, self.video], self._shown_folders)

        def accept(result: TrackingResult) -> None:
            self.tracking_result = replace(result, folder=self._keep(result.folder, " in ".join(names)))

        self._start("Tracking", accept, tracking_tasks.follow, run, *names, self.options, pictures)

    def cancel(self) -> None:
        """Cancel the running job; earlier results stay."""
        if self.job is not None:
            self.job.cancel()

    def close(self) -> None:
        """Cancel the job and remove every file."""
        self.cancel()
        self._stop_reading()
        if self.files.clear():
            self.photographs, self.template, self.video = [], None, None
            self.mosaic_result = self.hardware_result = self.tracking_result = self.rules_edit = None
            self.changed.emit()

    def _start(self, title: str, accept: Callable[[Any], None], task: Task, folder: Path, *arguments: object) -> None:
        """Run ``task`` in a worker and hand its result to ``accept``; nothing happens while another job runs."""
        if self.job is not None:
            return
        self.job, self.fault = Job(title, task, folder, *arguments), ""
        background_tasks.create(self._finish(self.job, accept), name=title)
        self.changed.emit()

    async def _finish(self, job: Job, accept: Callable[[Any], None]) -> None:
        try:
            accept(await job.run(self._queues.jobs))
        except JobCancelledError:
            self.fault = f"{job.title}: cancelled"
        except JobFailedError as error:
            self.fault = in_labels(error)
        finally:
            self.job, self.last_active = None, time.monotonic()
            self.changed.emit()

    @property
    def _shown_folders(self) -> set[str]:
        """Names of the folders of runs and pictures that the page shows."""
        # A run and its pictures have the same name.
        shown = {result.pictures.name for result in self.results.values()}
        return {"uploads", *shown, *(each.thumbnail.parent.name for each in self.photographs)}

    def _keep(self, run: Path, title: str) -> Path:
        """Keep a run's folder beyond the session, if it is one of this machine's user; returns where it is now."""
        try:
            return self.runs.keep(run, title) if self.runs else run
        except (InputError, OSError) as error:
            self.fault = f"the run is shown, but could not be kept: {error}"
            return run

    def _show_result(self, result: MosaicResult) -> None:
        self.mosaic_result, self.hardware_result = result, None
        self.rules_edit = RulesEdit(result) if RulesEdit.applies_to(result) else None

    def _set_film(self, film: Mapping[str, InputFile]) -> None:
        """Replace the template, the video, or both."""
        for slot, file in film.items():
            before = getattr(self, slot)
            self.files.remove([before] if before else [])
            setattr(self, slot, file)
        self.changed.emit()
