"""Keeps the frames of a live mosaic until it is composed: files where they are, other pixels in a temporary folder."""

import contextlib
import weakref
from pathlib import Path

import cv2

from golden_model.arrays import Pixels
from golden_model.temporary import temporary_folder
from skymosaic.common.errors import InputError
from skymosaic.imagery.images import save_bytes
from skymosaic.imagery.photographs import Source

MAX_BYTES = 32 << 30
"""About 10,000 key frames of 1080p video."""


class FullError(InputError):
    """No room for another frame; what was placed so far can still be composed."""


class KeptFrames:
    """Keeps frames where they can be read again: files where they are, other pixels in a folder.

    The pixels are written losslessly, as PNG; the folder goes with this object. ``keep_damaged``: of damaged files,
    what can be decoded is used.
    """

    def __init__(self, *, keep_damaged: bool = False) -> None:
        self._keep_damaged = keep_damaged
        self._folders = contextlib.ExitStack()
        # A later run removes the folder of a process that was killed.
        weakref.finalize(self, self._folders.close)
        self._folder: Path | None = None
        self._bytes = 0

    def keep(self, number: int, name: str, pixels: Pixels, file: Path | None) -> Source:
        """Keep a frame, its file if it has one, else its pixels; returns where it can be read again.

        Raises
        ------
        FullError
            If the disk is full, or the frames take more than `MAX_BYTES`.
        InputError
            For a file that cannot be read.
        """
        source = Source(number, name, file or self._store(number, pixels), keep_damaged=self._keep_damaged)
        # Computed now, so that a change is noticed.
        _ = source.digest
        return source

    def _store(self, number: int, pixels: Pixels) -> Path:
        if self._folder is None:
            self._folder = self._folders.enter_context(temporary_folder())
        # The fastest compression: frames must not wait for it.
        _, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        self._bytes += encoded.nbytes
        if self._bytes > MAX_BYTES:
            raise FullError(f"frames take more than {MAX_BYTES >> 30} GB in {self._folder}; write the mosaic so far")
        try:
            save_bytes(path := self._folder / f"{number}.png", encoded.tobytes())
        except InputError as error:
            raise FullError(f"{error}; or set TMPDIR to a folder with more room") from None
        return path
