"""The visitors, and what each of them has: photographs, choices, outcomes. Nobody's are within reach of another."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec
from weakref import WeakValueDictionary

from nicegui import Event, background_tasks
from nicegui.binding import BindableProperty

from skymosaic.panel import mosaic_tasks, tracking_tasks, upload_tasks
from skymosaic.panel.jobs import Job, JobCancelledError, JobFailedError, Work
from skymosaic.panel.options import Choices
from skymosaic.panel.results import HardwareOutcome, MosaicOutcome, TrackingOutcome, Upload
from skymosaic.panel.uploads import PHOTOGRAPH, VIDEO, UploadRefusedError, receive

MOST_KEPT = 16
"""Visitors whose files are kept; the one who came first goes first, unless its work is running."""
MOST_PHOTOGRAPHS = 60
MOST_BYTES = 4 << 30
"""Of all files of one visitor, results included."""

SLOTS = {
    "photograph": (PHOTOGRAPH, upload_tasks.inspect),
    "template": (PHOTOGRAPH, upload_tasks.inspect),
    "video": (VIDEO, upload_tasks.inspect_video),
}
"""Where files may be uploaded to: the kind each takes, and what a worker does with it."""


_Arguments = ParamSpec("_Arguments")


@dataclass(frozen=True)
class Turns:
    """How many workers run at once; uploads do not wait behind long work."""

    long: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))
    uploads: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))


def _alone(
    start: Callable[Concatenate[Visitor, _Arguments], None],
) -> Callable[Concatenate[Visitor, _Arguments], None]:
    """Let a method that starts a job do nothing while another runs."""

    @wraps(start)
    def start_alone(visitor: Visitor, /, *args: _Arguments.args, **kwargs: _Arguments.kwargs) -> None:
        if visitor.job is None:
            start(visitor, *args, **kwargs)

    return start_alone


class Visitor:
    """One browser's photographs, choices and outcomes; all its tabs share them, and a reload finds them again.

    Attributes
    ----------
    boards : tuple of str
        Backends that are boards.
    job : Job or None
        What is running; controls can be bound to it.
    changed : Event
        Emitted whenever something that pages show has changed.
    fault : str
        Why the last work ended without a result; empty where it did not.
    """

    job = BindableProperty()

    def __init__(self, make_folder: Callable[[Visitor], Path], turns: Turns, boards: tuple[str, ...]) -> None:
        self.boards = boards
        self._make_folder = make_folder
        self._turns = turns
        self._root: Path | None = None
        self._numbers = 0
        self.photographs: list[Upload] = []
        self.choices = Choices.of_preset("aerial")
        self.outcome: MosaicOutcome | None = None
        self.hardware: HardwareOutcome | None = None
        self.template: Upload | None = None
        self.video: Upload | None = None
        self.tracking: TrackingOutcome | None = None
        self.job = None
        self.fault = ""
        self.changed: Event[[]] = Event()

    def picture(self, name: str) -> Path | None:
        """A picture's file: only what is listed here can be read, whatever ``name`` holds."""
        return next((path for path in self._pictures() if path.name == name), None)

    def result_folders(self) -> dict[str, Path]:
        """The folders of the archive, by the names they have in it."""
        return {name: outcome.folder for name, outcome in self._outcomes().items()}

    async def upload(self, slot: str, body: AsyncIterator[bytes], name: str) -> None:
        """Take a file in once it is received, known to be of its kind, and decoded.

        Parameters
        ----------
        slot : str
            A key of `SLOTS`.

        Raises
        ------
        UploadRefusedError
            If it is not taken; nothing of it stays.
        """
        kind, task = SLOTS[slot]
        if slot == "photograph" and len(self.photographs) >= MOST_PHOTOGRAPHS:
            raise UploadRefusedError(f"{MOST_PHOTOGRAPHS} photographs are loaded, and no more may be; remove some", 413)
        path = await receive(body, name, kind, self._folder("uploads") / self._number(), self._room_bytes())
        job = Job(f"Reading {path.name}", path.parent, task, path.name, self._folder("views"))
        try:
            uploaded = await job.run(self._turns.uploads)
        except JobFailedError as error:
            path.unlink()
            raise UploadRefusedError(str(error)) from None
        if slot == "photograph":
            self.photographs.append(uploaded)
        elif slot == "template":
            self._take_film(uploaded, self.video)
        else:
            self._take_film(self.template, uploaded)
        self.changed.emit()

    def keep_photographs(self, kept: Iterable[Upload]) -> None:
        """Forget all other photographs; outcomes made of them stay."""
        before, self.photographs = self.photographs, list(kept)
        self._remove(*(upload for upload in before if upload not in self.photographs))
        self.changed.emit()

    def swap_first(self) -> None:
        """Exchange the first two photographs."""
        self.photographs[:2] = self.photographs[1::-1]
        self.changed.emit()

    def choose(self, name: str, value: Any) -> None:
        """Change one of the choices."""
        if getattr(self.choices, name) != value:
            self.choices = self.choices.changed(name, value)
            self.changed.emit()

    @_alone
    def load_built_in(self, count: int) -> None:
        """Replace the photographs by a built-in pair, or a built-in flight of more."""
        names = [f"{self._number()}_built-in.png" for _ in range(count)]
        task, title = (upload_tasks.render_pair, "pair") if count == 2 else (upload_tasks.render_flight, "flight")
        uploads, views = self._folder("uploads"), self._folder("views")
        self._start(f"Rendering the built-in {title}", uploads, self.keep_photographs, task, names, views)

    @_alone
    def load_built_in_film(self) -> None:
        """Replace template and video by the built-in film of a car."""
        names = f"{self._number()}_car.png", f"{self._number()}_film.mp4"
        folder, views = self._folder("uploads"), self._folder("views")

        def take(film: tuple[Upload, Upload]) -> None:
            self._take_film(*film)

        self._start("Rendering the built-in film", folder, take, upload_tasks.render_pursuit, *names, views)

    @_alone
    def make_mosaic(self) -> None:
        """Run the chosen chain over the photographs."""
        names = [upload.name for upload in self.photographs]
        run, views = self._new_run(names), self._folder("views")
        self._start("Making the mosaic", run, self._take_mosaic, mosaic_tasks.make_mosaic, names, self.choices, views)

    @_alone
    def look_at_pair(self, names: tuple[str, str]) -> None:
        """Register one pair of a flight again, to look at its matches."""
        assert self.outcome is not None
        folder, task = self.outcome.folder, mosaic_tasks.look_at_pair
        self._start("Matching the pair", folder, self._take_mosaic, task, self.outcome, names)

    @_alone
    def compare_hardware(self, backend: str) -> None:
        """Run the pair at hand through hardware."""
        assert self.outcome is not None
        names, choices = self.outcome.pair.names, self.outcome.choices

        def take(outcome: HardwareOutcome) -> None:
            self.hardware = outcome

        task, folder = mosaic_tasks.compare_hardware, self.outcome.folder
        self._start("Comparing with the golden model", folder, take, task, names, choices, backend)

    @_alone
    def track(self) -> None:
        """Follow the template through the video."""
        assert self.template is not None
        assert self.video is not None
        names = [self.template.name, self.video.name]

        def take(outcome: TrackingOutcome) -> None:
            before, self.tracking = self.tracking, outcome
            if before:
                self._remove(before)

        run, views, choices = self._new_run(names), self._folder("views"), self.choices
        self._start("Tracking", run, take, tracking_tasks.follow, *names, choices.preset, choices.backend, views)

    def cancel(self) -> None:
        """End the running job; what it would have brought is lost, what was there before stays."""
        if self.job is not None:
            self.job.cancel()

    def close(self) -> None:
        """End the job and remove every file."""
        self.cancel()
        if self._root is not None:
            shutil.rmtree(self._root, ignore_errors=True)
            self._root, self.photographs, self.template, self.video = None, [], None, None
            self.outcome = self.hardware = self.tracking = None

    def _start(self, title: str, folder: Path, take: Callable[[Any], None], task: Work, *arguments: object) -> None:
        """Run ``task`` in a worker and hand its result to ``take``."""
        self.job, self.fault = Job(title, folder, task, *arguments), ""
        background_tasks.create(self._finish(self.job, take), name=title)
        self.changed.emit()

    async def _finish(self, job: Job, take: Callable[[Any], None]) -> None:
        try:
            take(await job.run(self._turns.long))
        except JobCancelledError:
            self.fault = f"{job.title}: cancelled"
        except JobFailedError as error:
            self.fault = str(error)
        finally:
            self.job = None
            self.changed.emit()

    def _take_mosaic(self, outcome: MosaicOutcome) -> None:
        before, self.outcome, self.hardware = self.outcome, outcome, None
        if before:
            self._remove(before)

    def _take_film(self, template: Upload | None, video: Upload | None) -> None:
        before, self.template, self.video = (self.template, self.video), template, video
        self._remove(*(upload for upload in before if upload and upload not in (template, video)))

    def _outcomes(self) -> dict[str, MosaicOutcome | TrackingOutcome]:
        outcomes = {"mosaic": self.outcome, "tracking": self.tracking}
        return {name: outcome for name, outcome in outcomes.items() if outcome}

    def _pictures(self) -> list[Path]:
        """The files that may be read."""
        uploads = (*self.photographs, self.template, self.video)
        shown = [upload.working for upload in uploads if upload]
        return shown + [path for outcome in self._outcomes().values() for path in outcome.pictures]

    def _remove(self, *gone: Upload | MosaicOutcome | TrackingOutcome) -> None:
        """Remove the files of what has been replaced, but pictures that something else shows."""
        for each in gone:
            if isinstance(each, Upload):
                (self._folder("uploads") / each.name).unlink(missing_ok=True)
            for path in set(each.pictures).difference(self._pictures()):
                path.unlink(missing_ok=True)

    def _folder(self, name: str) -> Path:
        if self._root is None:
            self._root = self._make_folder(self)
        folder = self._root / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def _new_run(self, names: Sequence[str]) -> Path:
        """A folder with the files a run needs; those of runs that left no outcome are removed."""
        finished = self.result_folders().values()
        for path in self._folder("runs").iterdir():
            if path not in finished:
                shutil.rmtree(path)
        run = self._folder(f"runs/{self._number()}")
        for name in names:
            (run / name).hardlink_to(self._folder("uploads") / name)
        return run

    def _number(self) -> str:
        """Two digits or more for a name, never given twice."""
        self._numbers += 1
        return f"{self._numbers:02}"

    def _room_bytes(self) -> int:
        files = self._root.rglob("*") if self._root else ()
        return MOST_BYTES - sum(path.stat().st_size for path in files if path.is_file())


class Visitors:
    """All visitors, by the number in their signed cookie.

    One who only looks is forgotten with the page; one with files is kept until others need the room.

    Parameters
    ----------
    boards : tuple of str
        Backends that are boards, ``board:HOST``, which everyone may choose.
    """

    def __init__(self, boards: tuple[str, ...] = ()) -> None:
        self._boards = boards
        self._folder = tempfile.TemporaryDirectory(prefix="skymosaic-panel-")
        self._present: WeakValueDictionary[str, Visitor] = WeakValueDictionary()
        self._kept: list[Visitor] = []
        self._turns = Turns()

    def of(self, number: str) -> Visitor:
        """The visitor with that number, new or known."""
        visitor = self._present.get(number)
        if visitor is None:
            visitor = self._present[number] = Visitor(self._keep, self._turns, self._boards)
        return visitor

    def close(self) -> None:
        """End every job and remove every file."""
        for visitor in list(self._present.values()):
            visitor.close()
        self._folder.cleanup()

    def _keep(self, visitor: Visitor) -> Path:
        idle = [kept for kept in self._kept if kept.job is None]
        if len(self._kept) >= MOST_KEPT and idle:
            self._kept.remove(idle[0])
            idle[0].close()
            idle[0].changed.emit()
        self._kept.append(visitor)
        return Path(tempfile.mkdtemp(dir=self._folder.name))
