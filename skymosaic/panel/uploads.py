"""Receives files: their size while they arrive, their kind by their first bytes, their pixels in a worker.

Nothing of a file is decoded in the server's own process, and the name it came with serves only to make a new one.
"""

from __future__ import annotations

import re
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import anyio

MEBIBYTE = 1 << 20
_LONGEST_STEM = 40


class UploadRefusedError(Exception):
    """The file is not taken; the line names it, what is wrong and what to do."""

    def __init__(self, line: str, status: int = 422) -> None:
        super().__init__(line)
        self.status = status


@dataclass(frozen=True)
class Kind:
    """What may be uploaded somewhere.

    Attributes
    ----------
    what : str
        In words, with the formats.
    signatures : tuple of (int, bytes, str)
        Offset and bytes that tell a format, and the suffix its files get. The decoders choose by content, some of
        them play lists that name other files: what has no known signature never reaches them.
    limit_bytes : int
    """

    what: str
    signatures: tuple[tuple[int, bytes, str], ...]
    limit_bytes: int

    def suffix_of(self, head: bytes) -> str | None:
        """The suffix for a file that begins with ``head``; None where it is of another kind."""
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
    64 * MEBIBYTE,
)
VIDEO = Kind(
    "a video (MP4, MOV, MKV, WebM or AVI)",
    ((4, b"ftyp", ".mp4"), (0, b"\x1a\x45\xdf\xa3", ".mkv"), (8, b"AVI ", ".avi")),
    512 * MEBIBYTE,
)
_HEAD_BYTES = 16


def safe_stem(name: str) -> str:
    """A stem for the panel's own file names: letters, digits, dash and underscore of the name a file came with."""
    return re.sub(r"[^A-Za-z0-9-]+", "_", Path(name).stem)[:_LONGEST_STEM].strip("_-") or "file"


async def receive(body: AsyncIterator[bytes], name: str, kind: Kind, target: Path, room_bytes: int) -> Path:
    """Store an upload as ``target``, to whose name the stem of its own and a suffix are added.

    Raises
    ------
    UploadRefusedError
        For a file of another kind, too large, or empty; nothing of it stays.
    """
    stem = safe_stem(name)
    part = target.with_suffix(".part")
    try:
        head = await _store(body, part, min(kind.limit_bytes, room_bytes), stem)
        suffix = kind.suffix_of(head)
        if suffix is None:
            fault = "is not" if head else "is empty, not"
            raise UploadRefusedError(f"{stem}: {fault} {kind.what}; choose another file", 415)
        return part.rename(target.with_name(f"{target.name}_{stem}{suffix}"))
    finally:
        part.unlink(missing_ok=True)


async def _store(body: AsyncIterator[bytes], path: Path, limit_bytes: int, stem: str) -> bytes:
    """Write the body to ``path`` as it arrives; returns its first bytes."""
    head, size = b"", 0
    async with await anyio.open_file(path, "wb") as file:
        async for chunk in body:
            size += len(chunk)
            if size > limit_bytes:
                raise UploadRefusedError(
                    f"{stem}: larger than the {limit_bytes // MEBIBYTE} MB there is room for; reduce it first", 413
                )
            head = (head + chunk)[:_HEAD_BYTES] if len(head) < _HEAD_BYTES else head
            await file.write(chunk)
    return head
