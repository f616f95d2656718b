"""What runs are made from: uploaded files, or the photographs of a folder of this machine."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from functools import partial
from pathlib import Path

from nicegui import Event, background_tasks

from skymosaic.panel.folders import OPEN, Roots
from skymosaic.panel.results import Decoded, InputFile
from skymosaic.panel.session_files import MAX_BYTES, SessionFiles
from skymosaic.panel.tasks import upload_tasks
from skymosaic.panel.tasks.jobs import Job, JobCancelledError, JobFailedError, Limits
from skymosaic.panel.uploads import KINDS, MAX_UPLOADS_AT_ONCE, UploadRefusedError, receive

DECODING_LIMITS = Limits(seconds=120, processor_seconds=60, memory_bytes=2 << 30)


class Inputs:
    """The photographs, and object and video of the tracking page.

    Uploads are stored in ``files``; folders below ``roots`` may be opened. ``changed`` is emitted whenever something
    that a page shows has changed; ``keeps_damaged`` says whether damaged photographs are taken.
    """

    def __init__(
        self, files: SessionFiles, roots: Roots, changed: Event[[]], keeps_damaged: Callable[[], bool]
    ) -> None:
        self._files, self.roots, self._changed, self._keeps_damaged = files, roots, changed, keeps_damaged
        # Workers that run at once, never behind a long run.
        self._upload_queue, self._folder_queue = asyncio.Semaphore(2), asyncio.Semaphore(1)
        self._arriving = 0
        self.photographs: list[InputFile] = []
        """Uploads, or the photographs of an opened folder."""
        self.reading: Job | None = None
        """Makes the thumbnails of the opened folder, in the order of the photographs."""
        self.unread = ""
        """What of the folder is not read, and which of its photographs could not be; empty if nothing."""
        self.template: InputFile | None = None
        self.video: InputFile | None = None

    async def upload(self, slot: str, body: AsyncIterator[bytes], name: str) -> None:
        """Receive a file for a slot, a key of `skymosaic.panel.uploads.KINDS`, check its kind and decode it.

        Raises
        ------
        UploadRefusedError
            If the file is refused, or too many are under way; it is removed completely.
        """
        if self._arriving >= MAX_UPLOADS_AT_ONCE:
            raise UploadRefusedError(f"{MAX_UPLOADS_AT_ONCE} files are arriving already; wait for them", 429)
        self._arriving += 1
        try:
            part = self._files.folder("uploads") / f"{self._files.new_number()}.part"
            path = await receive(body, name, KINDS[slot], part, room_bytes=MAX_BYTES - self._files.size_bytes)
            decoded = await self._decode(path, slot, self._files.folder("pictures/uploads"))
        except JobFailedError as error:
            path.unlink()
            raise UploadRefusedError(str(error)) from None
        finally:
            self._arriving -= 1
        uploaded = InputFile.of_upload(path.name, decoded)
        if slot == "photograph":
            self.set_photographs((*(each for each in self.photographs if each.is_upload), uploaded))
        else:
            self.set_film({slot: uploaded})

    async def open_folder(self, path: str) -> None:
        """Load the photographs of a folder of this machine in place of those that are loaded; nothing is copied.

        Raises
        ------
        InputError
            For a folder outside of the roots or without photographs, or a link that leads out.
        """
        folder = await asyncio.to_thread(self.roots.find_folder, path)
        listing = await asyncio.to_thread(self.roots.list_photographs, folder)
        self.stop_reading()
        pictures = self._files.folder(f"pictures/{self._files.new_number()}")
        names = [photograph.name for photograph in listing.pictures]
        self.unread = listing.describe_unread(OPEN)
        self.reading = Job(f"Reading {folder}", upload_tasks.make_thumbnails, folder, names, pictures)
        background_tasks.create(self._finish_reading(self.reading, len(names)), name="reading")
        self.set_photographs(
            InputFile(str(each), pictures / f"{number}.jpg") for number, each in enumerate(listing.pictures, 1)
        )

    async def _finish_reading(self, job: Job, photographs: int) -> None:
        try:
            faults = await job.run(self._folder_queue)
        except JobCancelledError:
            return
        except JobFailedError as error:
            faults = [str(error)]
        if job is self.reading:
            count = f"{len(faults)} of {photographs} photographs could not be read" if len(faults) > 1 else ""
            named = "; the first: ".join(filter(None, (count, *faults[:1])))
            self.reading, self.unread = None, "; ".join(filter(None, (self.unread, named)))
            self._changed.emit()

    async def _decode_in_place(self, photograph: InputFile) -> None:
        try:
            photograph.decoded = await self._decode(Path(photograph.path), "photograph", photograph.thumbnail.parent)
        except JobFailedError as error:
            self.unread = str(error)
        self._changed.emit()

    async def _decode(self, path: Path, slot: str, pictures: Path) -> Decoded:
        """Decode a file in a worker, and save its working picture."""
        inspect_photograph = partial(upload_tasks.inspect_photograph, keep_damaged=self._keeps_damaged())
        task = upload_tasks.inspect_video if slot == "video" else inspect_photograph
        job = Job(f"Reading {path.name}", task, path.parent, path.name, pictures, limits=DECODING_LIMITS)
        decoded: Decoded = await job.run(self._upload_queue)
        return decoded

    def set_photographs(self, photographs: Iterable[InputFile]) -> None:
        """Show other photographs; results made from those before stay, and so do files of a folder."""
        before, self.photographs = self.photographs, list(photographs)
        self._files.remove(set(before).difference(self.photographs))
        if all(each.is_upload for each in self.photographs):
            self.stop_reading()
        # Of a folder only the first two are decoded, whose corners are shown.
        for photograph in self.photographs[:2]:
            if photograph.decoded is None:
                background_tasks.create(self._decode_in_place(photograph), name="decoding")
        self._changed.emit()

    def swap_first(self) -> None:
        """Swap the first two photographs."""
        self.set_photographs((*self.photographs[1::-1], *self.photographs[2:]))

    def stop_reading(self) -> None:
        """Forget the folder that was opened."""
        if self.reading is not None:
            self.reading.cancel()
        self.reading, self.unread = None, ""

    def set_film(self, film: Mapping[str, InputFile]) -> None:
        """Replace the template, the video, or both."""
        for slot, file in film.items():
            before = getattr(self, slot)
            self._files.remove([before] if before else [])
            setattr(self, slot, file)
        self._changed.emit()
