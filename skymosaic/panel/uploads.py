"""Receives uploaded files: checks the size while they arrive, and the kind by their first bytes.

Files are never decoded in the server's process, only in a worker. A file keeps its name, without characters that could
mean something to a shell or a file system, and with a number if another file has that name.
"""

import asyncio
import itertools
import re
import shutil
import unicodedata
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import anyio

MEBIBYTE = 1 << 20
STALLED_SECONDS = 20.0
PROGRESS_BYTES = 1 << 16
"""An upload that brings less in `STALLED_SECONDS` is given up: a byte now and then would hold its place for ever."""
MAX_UPLOADS_AT_ONCE = 16
"""A browser sends six at once."""
MIN_FREE_BYTES = 1 << 30
"""Uploads leave this much of the disk free."""
_HEAD_BYTES = 16
_MAX_STEM_LENGTH, _MAX_SUFFIX_LENGTH = 40, 8
_RESERVED_STEMS = ("mosaic", "tracked")
"""Stems of files that a run writes beside what was uploaded."""


class UploadRefusedError(Exception):
    """The file is refused; the message names the file, the fault and what to do; ``status`` is the HTTP status."""

    def __init__(self, line: str, status: int = 422) -> None:
        super().__init__(line)
        self.status = status


@dataclass(frozen=True)
class Kind:
    """A kind of file that can be uploaded."""

    description: str
    """The kind in words, with its formats."""
    signatures: tuple[tuple[int, bytes, str], ...]
    """Offset and bytes that identify a format, and the suffix its files get. Decoders recognise formats by content,
    among them play lists that name other files, so a file without a known signature must never reach them."""
    accept: str
    """Media types and suffixes that the browser's file dialogue offers."""
    limit_bytes: int

    def suffix_of(self, head: bytes) -> str | None:
        """The suffix for a file that begins with ``head``; None if it is of another kind."""
        return next(
            (suffix for offset, mark, suffix in self.signatures if head[offset : offset + len(mark)] == mark), None
        )


PHOTOGRAPH = Kind(
    "a photograph (JPEG, PNG, TIFF, WebP or BMP)",
    (
        (0, b"\x89PNG\r\n\x1a\n", ".png"),
        (0, b"\xff\xd8\xff", ".jpg"),
        (0, b"II*\0", ".tif"),
        (0, b"MM\0*", ".tif"),
        (8, b"WEBP", ".webp"),
        (0, b"BM", ".bmp"),
    ),
    "image/*,.tif,.tiff",
    64 * MEBIBYTE,
)
VIDEO = Kind(
    "a video (MP4, MOV, MKV, WebM or AVI)",
    ((4, b"ftyp", ".mp4"), (0, b"\x1a\x45\xdf\xa3", ".mkv"), (8, b"AVI ", ".avi")),
    "video/*,.mkv",
    512 * MEBIBYTE,
)
KINDS = {"photograph": PHOTOGRAPH, "template": PHOTOGRAPH, "video": VIDEO}
"""What a file may be uploaded as."""


def sanitise_stem(name: str) -> str:
    """Make a harmless stem of a file name: its letters of any script, digits, dashes and underscores, at most 40."""
    # Some browsers send a letter and its accent as two characters, and the accent is no letter.
    stem = unicodedata.normalize("NFC", Path(name).stem)
    return re.sub(r"[^\w-]+", "_", stem)[:_MAX_STEM_LENGTH].strip("_-") or "file"


async def receive(body: AsyncIterator[bytes], name: str, kind: Kind, part: Path, *, room_bytes: int) -> Path:
    """Store an upload under a sanitised, unique name with the suffix of its kind.

    Until it is complete it is stored as ``part``; then it is renamed in the same folder. Its size is limited by
    ``room_bytes``, what is left of the session's, or by its kind, whichever is less.

    Raises
    ------
    UploadRefusedError
        If the file is of another kind, too large or empty, or the disk is full; it is removed completely.
    """
    stem, limit_bytes = sanitise_stem(name), min(kind.limit_bytes, max(0, room_bytes))
    shown = stem + re.sub(r"[^\w.]+", "", Path(name).suffix[:_MAX_SUFFIX_LENGTH])
    if shutil.disk_usage(part.parent).free < MIN_FREE_BYTES + limit_bytes:
        raise UploadRefusedError("the panel's disk is almost full; make room on it", 507)
    try:
        head = await _store(body, part, limit_bytes, shown)
        suffix = kind.suffix_of(head)
        if suffix is None:
            fault = "is not" if head else "is empty, not"
            raise UploadRefusedError(f"{shown}: {fault} {kind.description}; choose another file", 415)
        numbered = (f"{stem}_{number}" for number in itertools.count(2))
        paths = (part.with_name(each + suffix) for each in itertools.chain([stem], numbered))
        # Nothing is awaited between choosing a name and taking it, so no other upload can take it meanwhile.
        return part.rename(next(path for path in paths if path.stem not in _RESERVED_STEMS and not path.exists()))
    except OSError as error:
        raise UploadRefusedError(f"{shown}: cannot be stored ({error.strerror}); make room on the disk", 507) from None
    finally:
        part.unlink(missing_ok=True)


async def _store(body: AsyncIterator[bytes], path: Path, limit_bytes: int, name: str) -> bytes:
    """Write the body to ``path`` as it arrives; return its first bytes."""
    head, size, awaited_bytes = b"", 0, PROGRESS_BYTES
    try:
        async with asyncio.timeout(STALLED_SECONDS) as patience, await anyio.open_file(path, "wb") as file:
            async for chunk in body:
                size += len(chunk)
                if size > limit_bytes:
                    raise UploadRefusedError(
                        f"{name}: larger than the {limit_bytes // MEBIBYTE} MB allowed; reduce it first", 413
                    )
                if size >= awaited_bytes:
                    awaited_bytes = size + PROGRESS_BYTES
                    patience.reschedule(asyncio.get_running_loop().time() + STALLED_SECONDS)
                head = (head + chunk)[:_HEAD_BYTES] if len(head) < _HEAD_BYTES else head
                await file.write(chunk)
    except TimeoutError:
        fault = f"hardly anything arrived for {STALLED_SECONDS:g} s; check the connection and load it again"
        raise UploadRefusedError(f"{name}: {fault}", 408) from None
    return head
