"""Takes in one upload: receives the file, checks its kind, and decodes it in a worker that ends with its visitor."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from skymosaic.panel.results import Upload, picture_name
from skymosaic.panel.tasks import upload_tasks
from skymosaic.panel.tasks.jobs import Job, JobCancelledError, JobFailedError, Limits
from skymosaic.panel.uploads.received import PHOTOGRAPH, VIDEO, UploadRefusedError, receive
from skymosaic.panel.uploads.storage import BUSY

SLOTS = ("photograph", "template", "video")
"""What a file may be uploaded as."""
LIMITS = Limits(processor_seconds=20, seconds=120, memory_bytes=2 << 30)
"""Of the worker that decodes an upload."""
MOST_UPLOADS = 128
"""Uploads of all sessions at once; the others are told to try again."""
POLL_SECONDS = 0.5

IsGone = Callable[[], Awaitable[bool]]


@dataclass(frozen=True)
class JobQueues:
    """Limits on how many workers run at once; uploads have a queue of their own and never wait for long jobs."""

    long: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))
    uploads: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))
    uploading: set[object] = field(default_factory=set)

    def admit(self, ticket: object) -> None:
        """Count an upload, until its ticket is discarded; raises UploadRefusedError if there are too many."""
        if len(self.uploading) >= MOST_UPLOADS:
            raise UploadRefusedError("the panel is receiving too many files; try again in a moment", BUSY)
        self.uploading.add(ticket)


async def never_gone() -> bool:
    """For a body that does not come from a browser."""
    return False


async def take_in(
    slot: str,
    body: AsyncIterator[bytes],
    name: str,
    *,
    part: Path,
    views: Path,
    room_bytes: int,
    queue: asyncio.Semaphore,
    is_gone: IsGone,
    keep_damaged: bool = False,
) -> Upload:
    """Receive a file, as `skymosaic.panel.uploads.received.receive`, and decode it.

    Parameters
    ----------
    slot : str
        One of `SLOTS`.
    body : async iterator of bytes
    name : str
        The file's name in the browser.
    part, views : Path
        Where the file is stored until it is complete, and the folder of the pictures for the page.
    room_bytes : int
        Longest file.
    queue : asyncio.Semaphore
        Of the workers.
    is_gone : callable
        Asked, once the body has been received, whether the browser has gone: then the worker is ended.
    keep_damaged : bool
        Accept a damaged photograph, with what can be decoded of it.

    Raises
    ------
    UploadRefusedError
        If the file is refused; it is removed completely.
    """
    kind = VIDEO if slot == "video" else PHOTOGRAPH
    task = upload_tasks.inspect_video if kind is VIDEO else partial(upload_tasks.inspect, keep_damaged=keep_damaged)

    # A result may still show the picture of a photograph that has been removed: its name is not free.
    def is_taken(kept: str) -> bool:
        return (views / picture_name(kept)).exists()

    path = await receive(body, name, kind, part, room_bytes=room_bytes, is_taken=is_taken)
    job = Job(f"Reading {path.name}", task, path.parent, path.name, views, limits=LIMITS)
    watch = asyncio.create_task(_cancel_once(is_gone, job))
    accepted = False
    try:
        uploaded: Upload = await job.run(queue)
        accepted = True
    except (JobFailedError, JobCancelledError) as error:
        raise UploadRefusedError(str(error) or f"{path.stem}: the upload was cancelled") from None
    finally:
        watch.cancel()
        if not accepted:
            # A file that cannot be decoded must not stay among the uploads.
            path.unlink(missing_ok=True)
    return uploaded


async def _cancel_once(is_gone: IsGone, job: Job) -> None:
    """End a job as soon as no request waits for it."""
    while not await is_gone():
        await asyncio.sleep(POLL_SECONDS)
    job.cancel()
