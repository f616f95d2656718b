"""The visitors, and what each of them has: photographs, choices, outcomes. Nobody's are within reach of another."""

from __future__ import annotations

import asyncio
import os
import shutil
import tempfile
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

from nicegui import Event, background_tasks

from skymosaic.panel import work
from skymosaic.panel.choices import Choices
from skymosaic.panel.jobs import Job, JobCancelledError, JobFailedError, Work
from skymosaic.panel.outcomes import HardwareOutcome, MosaicOutcome, Upload
from skymosaic.panel.uploads import PHOTOGRAPH, UploadRefusedError, receive

MOST_KEPT = 16
"""Visitors whose files are kept; the one who came first goes first, unless its work is running."""
MOST_PHOTOGRAPHS = 60
MOST_BYTES = 4 << 30
"""Of all files of one visitor, results included."""


@dataclass(frozen=True)
class Turns:
    """How many workers run at once; uploads do not wait behind long work."""

    long: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))
    uploads: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))


class Visitor:
    """One browser's photographs, choices and outcomes; all its tabs share them, and a reload finds them again.

    Attributes
    ----------
    boards : tuple of str
        Backends that are boards.
    changed : Event
        Emitted whenever something that pages show has changed.
    fault : str
        Why the last work ended without a result; empty where it did not.
    """

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
        self.job: Job | None = None
        self.fault = ""
        self.changed: Event[[]] = Event()

    def picture(self, name: str) -> Path | None:
        """A picture's file: only what is listed here can be read, whatever ``name`` holds."""
        listed = [upload.working for upload in self.photographs]
        if self.outcome is not None:
            listed += self.outcome.pictures
        return next((path for path in listed if path.name == name), None)

    def result_folders(self) -> dict[str, Path]:
        """The folders of the archive, by the names they have in it."""
        return {} if self.outcome is None else {"mosaic": self.outcome.folder}

    async def add_photograph(self, body: AsyncIterator[bytes], name: str) -> None:
        """Take an upload in once it is received, known to be a photograph, and decoded.

        Raises
        ------
        UploadRefusedError
            If it is not taken; nothing of it stays.
        """
        if len(self.photographs) >= MOST_PHOTOGRAPHS:
            raise UploadRefusedError(f"{MOST_PHOTOGRAPHS} photographs are loaded, and no more may be; remove some", 413)
        target = self._folder("uploads") / f"{self._number():02}"
        path = await receive(body, name, PHOTOGRAPH, target, self._room_bytes())
        job = Job(f"Reading {path.name}", path.parent, work.inspect, path.name, self._folder("views"))
        try:
            self.photographs.append(await job.run(self._turns.uploads))
        except JobFailedError as error:
            path.unlink()
            raise UploadRefusedError(str(error)) from None
        self.changed.emit()

    def remove_photograph(self, upload: Upload) -> None:
        """Forget a photograph; outcomes made of it stay."""
        self.photographs.remove(upload)
        (self._folder("uploads") / upload.name).unlink()
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

    def load_built_in_pair(self) -> None:
        """Replace the photographs by the built-in ones, rendered in a worker."""
        names = tuple(f"{self._number():02}_built-in_{side}.png" for side in ("left", "right"))

        def take(uploads: list[Upload]) -> None:
            self.photographs = uploads

        folder, views = self._folder("uploads"), self._folder("views")
        self._start("Rendering the built-in flight", folder, take, work.render_pair, names, views)

    def make_mosaic(self) -> None:
        """Run the chosen chain over the photographs, in a folder with all it needs."""
        for path in self._folder("runs").iterdir():
            if self.outcome is None or path != self.outcome.folder:
                shutil.rmtree(path)
        run = self._folder(f"runs/{self._number():02}")
        names = [upload.name for upload in self.photographs]
        for name in names:
            os.link(self._folder("uploads") / name, run / name)

        def take(outcome: MosaicOutcome) -> None:
            self.outcome, self.hardware = outcome, None

        self._start("Making the mosaic", run, take, work.make_mosaic, names, self.choices, self._folder("views"))

    def compare_hardware(self, backend: str) -> None:
        """Run the pair of the last mosaic through hardware."""
        assert self.outcome is not None
        names, choices = self.outcome.pairs[0].names, self.outcome.choices

        def take(outcome: HardwareOutcome) -> None:
            self.hardware = outcome

        folder = self.outcome.folder
        self._start("Comparing with the golden model", folder, take, work.compare_hardware, names, choices, backend)

    def cancel(self) -> None:
        """End the running job; what it would have brought is lost, what was there before stays."""
        if self.job is not None:
            self.job.cancel()

    def close(self) -> None:
        """End the job and remove every file."""
        self.cancel()
        if self._root is not None:
            shutil.rmtree(self._root, ignore_errors=True)
            self._root, self.photographs, self.outcome = None, [], None

    def _start(self, title: str, folder: Path, take: Callable[[Any], None], task: Work, *arguments: object) -> None:
        """Run ``task`` in a worker and hand its result to ``take``; nothing happens while another job runs."""
        if self.job is None:
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

    def _folder(self, name: str) -> Path:
        if self._root is None:
            self._root = self._make_folder(self)
        folder = self._root / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def _number(self) -> int:
        """A number for a name, never given twice."""
        self._numbers += 1
        return self._numbers

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
        self._kept.append(visitor)
        return Path(tempfile.mkdtemp(dir=self._folder.name))
