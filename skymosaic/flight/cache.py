"""Results on disk under a key of all their inputs, so that an interrupted run continues where it stopped."""

from __future__ import annotations

import hashlib
import io
import zipfile
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skymosaic.errors import InputError
from skymosaic.imagery.images import save_bytes

VERSION = version("skymosaic")
Arrays = dict[str, NDArray[np.generic]]


class ResultCache:
    """Named arrays by key, one file each.

    Parameters
    ----------
    folder : Path or None
        Made where it is missing; None keeps nothing.

    Raises
    ------
    InputError
        If the folder cannot be made.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"{folder}: cannot be made ({error.strerror}); choose another cache") from None

    def load(self, key: str) -> Arrays | None:
        """What was saved under ``key``; None where nothing was, or the file is damaged."""
        if self._folder is None:
            return None
        try:
            # Opened here: NumPy leaves a file it cannot read open.
            with self._path(self._folder, key).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                return dict(arrays)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None

    def save(self, key: str, arrays: Arrays) -> None:
        """Keep ``arrays`` under ``key``, whole or not at all.

        Raises
        ------
        InputError
            If the file cannot be written, on a full disk for instance.
        """
        if self._folder is None:
            return
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        save_bytes(self._path(self._folder, key), buffer.getvalue())

    @staticmethod
    def _path(folder: Path, key: str) -> Path:
        return folder / f"{key}.npz"


def key_of(*parts: object) -> str:
    """A file name for what was computed from ``parts`` (by their ``repr``) by this version of the package."""
    return hashlib.sha256(repr((VERSION, *parts)).encode()).hexdigest()[:32]
