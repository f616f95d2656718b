"""Folders as one zip file, made while it is sent: nothing is written and nothing large is held."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

_CHUNK_BYTES = 1 << 20
_COMPRESSED = (".jpg", ".png", ".webp", ".mp4", ".mkv", ".avi")


class _Outlet(io.RawIOBase):
    """What a zip file is written to, as to a pipe; `take` empties it."""

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
    """The bytes of a zip file with every file of ``folders``, each below its folder's name, a mebibyte at a time."""
    outlet = _Outlet()
    with zipfile.ZipFile(outlet, "w") as archive:
        for name, folder in folders.items():
            for path in sorted(path for path in folder.rglob("*") if path.is_file()):
                entry = zipfile.ZipInfo.from_file(path, f"{name}/{path.relative_to(folder)}")
                entry.compress_type = zipfile.ZIP_STORED if path.suffix in _COMPRESSED else zipfile.ZIP_DEFLATED
                with path.open("rb") as source, archive.open(entry, "w") as target:
                    while chunk := source.read(_CHUNK_BYTES):
                        target.write(chunk)
                        yield outlet.take()
    yield outlet.take()
