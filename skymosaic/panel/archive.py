"""Packs folders into a zip file while it is sent, without a temporary file and with about a mebibyte of memory."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

_CHUNK_BYTES = 1 << 20
# Compressing these again would cost time and save nothing.
_COMPRESSED = (".jpg", ".png", ".webp", ".mp4", ".mkv", ".avi")


class _Buffer(io.RawIOBase):
    """Collects what is written to the zip file; not seekable, so that `zipfile` never goes back. `take` empties it."""

    def __init__(self) -> None:
        super().__init__()
        self._written = bytearray()

    def write(self, data: Any, /) -> int:
        self._written += data
        return len(data)

    def take(self) -> bytes:
        taken, self._written = bytes(self._written), bytearray()
        return taken


def zipped(folders: Mapping[str, Path]) -> Iterator[bytes]:
    """A zip file of every file in ``folders``, in pieces of about a mebibyte.

    Parameters
    ----------
    folders : mapping of str to Path
        Each folder, by the name it gets in the archive.
    """
    buffer = _Buffer()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, folder in folders.items():
            for path in sorted(path for path in folder.rglob("*") if path.is_file()):
                entry = zipfile.ZipInfo.from_file(path, f"{name}/{path.relative_to(folder)}")
                entry.compress_type = zipfile.ZIP_STORED if path.suffix in _COMPRESSED else zipfile.ZIP_DEFLATED
                with path.open("rb") as source, archive.open(entry, "w") as target:
                    while chunk := source.read(_CHUNK_BYTES):
                        target.write(chunk)
                        yield buffer.take()
    yield buffer.take()
