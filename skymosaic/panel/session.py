"""A session: the photographs, options and results of one browser."""

from __future__ import annotations

import shutil
import time
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec

from nicegui import Event, background_tasks
from nicegui.binding import BindableProperty

from skymosaic.panel.options import Options
from skymosaic.panel.results import HardwareResult, MosaicResult, TrackingResult, Upload
from skymosaic.panel.tasks import mosaic_tasks, tracking_tasks, upload_tasks
from skymosaic.panel.tasks.jobs import Job, JobCancelledError, JobFailedError, Task
from skymosaic.panel.uploads.intake import IsGone, JobQueues, never_gone, take_in
from skymosaic.panel.uploads.received import UploadRefusedError
from skymosaic.panel.uploads.storage import Storage, bytes_in

MOST_PHOTOGRAPHS = 60
MOST_BYTES = 4 << 30
"""Limit of all files of one session, results included."""

_Arguments = ParamSpec("_Arguments")


def _only_while_idle(
    start: Callable[Concatenate[Session, _Arguments], None],
) -> Callable[Concatenate[Session, _Arguments], None]:
    """Make a method that starts a job do nothing while another job runs."""

    @wraps(start)
    def start_if_idle(session: Session, /, *args: _Arguments.args, **kwargs: _Arguments.kwargs) -> None:
        if session.job is None:
            start(session, *args, **kwargs)

    return start_if_idle


class Session:
    """One browser's photographs, options and results, shared by all its tabs and kept when a page is reloaded.

    Attributes
    ----------
    boards : tuple of str
        Backends that are boards.
    photographs : list of Upload
    options : Options
    mosaic_result, hardware_result, tracking_result
        The latest of each kind; None before the first.
    template, video : Upload or None
        The object and the video to track it in.
    job : Job or None
        The running job; controls can be bound to it.
    changed : Event
        Emitted whenever something that a page shows has changed.
    fault : str
        Why the last job ended without a result; empty if it had one.
    """

    job = BindableProperty()

    def __init__(self, storage: Storage, queues: JobQueues, boards: tuple[str, ...]) -> None:
        self.boards = boards
        self._storage = storage
        self._queues = queues
        self._root: Path | None = None
        self._names_given = 0
        self._uploads: dict[object, str] = {}
        self.last_active = time.monotonic()
        self.photographs: list[Upload] = []
        self.options = Options.of_preset("aerial")
        self.mosaic_result: MosaicResult | None = None
        self.hardware_result: HardwareResult | None = None
        self.template: Upload | None = None
        self.video: Upload | None = None
        self.tracking_result: TrackingResult | None = None
        self.job = None
        self.fault = ""
        self.changed: Event[[]] = Event()

    def picture(self, name: str) -> Path | None:
        """The file of a picture that is shown; None for any other name, so no request can read another file."""
        return next((path for path in self._pictures() if path.name == name), None)

    def result_file(self, kind: str, name: str) -> Path | None:
        """A file of the result of a kind (a folder of the archive); None for any other name."""
        result = self._results().get(kind)
        return next((path for path in result.files if path.name == name), None) if result else None

    def result_folders(self) -> dict[str, Path]:
        """The folders of the archive, by their names in it."""
        return {name: result.folder for name, result in self._results().items()}

    @property
    def is_busy(self) -> bool:
        """Whether a job or an upload is running."""
        return self.job is not None or bool(self._uploads)

    @property
    def stored_bytes(self) -> int:
        """Size of the session's files."""
        return bytes_in(self._root) if self._root else 0

    async def upload(self, slot: str, body: AsyncIterator[bytes], name: str, is_gone: IsGone = never_gone) -> None:
        """Receive a file, check its kind and decode it.

        Parameters
        ----------
        slot : str
            One of `skymosaic.panel.uploads.intake.SLOTS`.
        body : async iterator of bytes
        name : str
            The file's name in the browser.
        is_gone : callable
            Asked, once the body has been received, whether the browser has gone: then the worker is ended.

        Raises
        ------
        UploadRefusedError
            If the file is refused; it is removed completely.
        """
        # Those that are under way count too: ten uploads at once must not pass the limit together.
        photographs = len(self.photographs) + list(self._uploads.values()).count("photograph")
        if slot == "photograph" and photographs >= MOST_PHOTOGRAPHS:
            raise UploadRefusedError(f"no more than {MOST_PHOTOGRAPHS} photographs can be loaded; remove some", 413)
        ticket = object()
        self._queues.admit(ticket)
        self._uploads[ticket] = slot
        try:
            self._storage.make_room()
            part, views = self._folder("uploads") / f"{self._new_number()}.part", self._folder("views")
            room_bytes, queue = MOST_BYTES - self.stored_bytes, self._queues.uploads
            file = slot, body, name
            uploaded = await take_in(
                *file,
                part=part,
                views=views,
                room_bytes=room_bytes,
                queue=queue,
                is_gone=is_gone,
                keep_damaged=self.options.damaged == "keep",
            )
        finally:
            self._queues.uploading.discard(ticket)
            del self._uploads[ticket]
            self.last_active = time.monotonic()
        if slot == "photograph":
            self.photographs.append(uploaded)
        elif slot == "template":
            self._replace_film(uploaded, self.video)
        else:
            self._replace_film(self.template, uploaded)
        self.changed.emit()

    def keep_photographs(self, kept: Iterable[Upload]) -> None:
        """Remove all other photographs; results made from them stay."""
        before, self.photographs = self.photographs, list(kept)
        self._remove(*(upload for upload in before if upload not in self.photographs))
        self.changed.emit()

    def swap_first(self) -> None:
        """Exchange the first two photographs."""
        self.photographs[:2] = self.photographs[1::-1]
        self.changed.emit()

    def set_option(self, name: str, value: Any) -> None:
        """Change one of the options."""
        if getattr(self.options, name) != value:
            self.options = self.options.changed(name, value)
            self.changed.emit()

    @_only_while_idle
    def load_built_in(self, count: int) -> None:
        """Replace the photographs by the built-in pair, or by a built-in flight of more than two."""
        names = [f"{self._new_number()}_built-in.png" for _ in range(count)]
        task, title = (upload_tasks.render_pair, "pair") if count == 2 else (upload_tasks.render_flight, "flight")
        uploads, views = self._folder("uploads"), self._folder("views")
        self._start(f"Rendering the built-in {title}", self.keep_photographs, task, uploads, names, views)

    @_only_while_idle
    def load_built_in_film(self) -> None:
        """Replace template and video by the built-in film of a car."""
        names = f"{self._new_number()}_car.png", f"{self._new_number()}_film.mp4"
        uploads, views = self._folder("uploads"), self._folder("views")

        def replace_film(film: tuple[Upload, Upload]) -> None:
            self._replace_film(*film)

        self._start("Rendering the built-in film", replace_film, upload_tasks.render_pursuit, uploads, *names, views)

    @_only_while_idle
    def make_mosaic(self) -> None:
        """Make a mosaic of the photographs with the options as they are."""
        names = [upload.name for upload in self.photographs]
        run, views, task = self._new_run(names), self._folder("views"), mosaic_tasks.make_mosaic
        self._start("Making the mosaic", self._replace_mosaic, task, run, names, self.options, views)

    @_only_while_idle
    def look_at_pair(self, names: tuple[str, str]) -> None:
        """Register one pair of a flight again, to show its matches."""
        assert self.mosaic_result is not None
        folder, task = self.mosaic_result.folder, mosaic_tasks.look_at_pair
        self._start("Matching the pair", self._replace_mosaic, task, folder, self.mosaic_result, names)

    @_only_while_idle
    def compare_hardware(self, backend: str) -> None:
        """Run the pair that is shown through hardware."""
        assert self.mosaic_result is not None
        names, options = self.mosaic_result.pair.names, self.mosaic_result.options

        def replace_comparison(result: HardwareResult) -> None:
            self.hardware_result = result

        task, folder = mosaic_tasks.compare_hardware, self.mosaic_result.folder
        self._start("Comparing with the golden model", replace_comparison, task, folder, names, options, backend)

    @_only_while_idle
    def track(self) -> None:
        """Follow the template through the video."""
        assert self.template is not None
        assert self.video is not None
        names = [self.template.name, self.video.name]

        def replace_tracking(result: TrackingResult) -> None:
            before, self.tracking_result = self.tracking_result, result
            if before:
                self._remove(before)

        run, views, task = self._new_run(names), self._folder("views"), tracking_tasks.follow
        self._start("Tracking", replace_tracking, task, run, *names, self.options, views)

    def cancel(self) -> None:
        """Cancel the running job; earlier results stay."""
        if self.job is not None:
            self.job.cancel()

    def close(self) -> None:
        """Cancel the job and remove every file."""
        self.cancel()
        if self._root is not None:
            shutil.rmtree(self._root, ignore_errors=True)
            self._storage.forget(self)
            self._root, self.photographs, self.template, self.video = None, [], None, None
            self.mosaic_result = self.hardware_result = self.tracking_result = None

    def _start(self, title: str, accept: Callable[[Any], None], task: Task, folder: Path, *arguments: object) -> None:
        """Run ``task`` in a worker and hand its result to ``accept``."""
        self.job, self.fault = Job(title, task, folder, *arguments), ""
        background_tasks.create(self._finish(self.job, accept), name=title)
        self.changed.emit()

    async def _finish(self, job: Job, accept: Callable[[Any], None]) -> None:
        try:
            accept(await job.run(self._queues.long))
        except JobCancelledError:
            self.fault = f"{job.title}: cancelled"
        except JobFailedError as error:
            self.fault = str(error)
        finally:
            self.job, self.last_active = None, time.monotonic()
            self.changed.emit()

    def _replace_mosaic(self, result: MosaicResult) -> None:
        before, self.mosaic_result, self.hardware_result = self.mosaic_result, result, None
        if before:
            self._remove(before)

    def _replace_film(self, template: Upload | None, video: Upload | None) -> None:
        before, self.template, self.video = (self.template, self.video), template, video
        self._remove(*(upload for upload in before if upload and upload not in (template, video)))

    def _results(self) -> dict[str, MosaicResult | TrackingResult]:
        """The results with a folder of their own, by its name in the archive."""
        results = {"mosaic": self.mosaic_result, "tracking": self.tracking_result}
        return {name: result for name, result in results.items() if result}

    def _pictures(self) -> list[Path]:
        """The files that a page may request."""
        uploads = (*self.photographs, self.template, self.video)
        shown = [upload.working for upload in uploads if upload]
        return shown + [path for result in self._results().values() for path in result.pictures]

    def _remove(self, *replaced: Upload | MosaicResult | TrackingResult) -> None:
        """Remove the files of what has been replaced, except pictures that are still shown elsewhere."""
        for each in replaced:
            if isinstance(each, Upload):
                (self._folder("uploads") / each.name).unlink(missing_ok=True)
            for path in set(each.pictures).difference(self._pictures()):
                path.unlink(missing_ok=True)

    def _folder(self, name: str) -> Path:
        if self._root is None:
            self._root = self._storage.make_folder(self)
        folder = self._root / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def _new_run(self, names: Sequence[str]) -> Path:
        """A folder with the files that a run needs; removes the folders of runs that ended without a result."""
        finished = self.result_folders().values()
        for path in self._folder("runs").iterdir():
            if path not in finished:
                shutil.rmtree(path)
        run = self._folder(f"runs/{self._new_number()}")
        for name in names:
            # Hard links: the run keeps its photographs when they are removed from the page, and costs no space.
            (run / name).hardlink_to(self._folder("uploads") / name)
        return run

    def _new_number(self) -> str:
        """Two digits or more for a file name, different on every call."""
        self._names_given += 1
        return f"{self._names_given:02}"
