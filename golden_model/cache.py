"""Results on disk under a key of all their inputs: features and links of flights, netlists, compiled simulators."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from golden_model.small_files import read_small_file
from golden_model.temporary import temporary_file

MAX_ENTRY_BYTES = 256 << 20
"""Many times the features of a photograph or a compiled simulator; a larger file is no entry."""
CHECKSUM_BYTES = hashlib.sha256().digest_size
Arrays = dict[str, NDArray[np.generic]]


def cache_folder() -> Path:
    """The project's folder in the user's cache: on Linux in ``XDG_CACHE_HOME``, or ``~/.cache`` if that is not set."""
    return user_cache_path("skymosaic", appauthor=False)


class Cache:
    """Named arrays by key, one file each, with a checksum.

    The cache never prevents a result: entries that are damaged count as missing, and a cache that cannot be written
    keeps nothing.

    Parameters
    ----------
    folder : Path or None
        Created for its owner alone, or made so: who can write to builds can run code as their owner. None keeps
        nothing.
    required : bool
        The user asked for this folder: it is an error if it cannot be created, and if it exists, its permissions stay.
    tell : callable
        Receives the reason if nothing can be kept from now on.
    limit_bytes : int or None
        Entries that were not used for longest are removed when the cache is opened, until the rest fits.

    Raises
    ------
    OSError
        If a required folder cannot be created.
    """

    def __init__(
        self,
        folder: Path | None,
        *,
        required: bool = False,
        tell: Callable[[str], None] = lambda _reason: None,
        limit_bytes: int | None = None,
    ) -> None:
        self._folder = folder
        self._writable = folder is not None
        self._tell = tell
        self._lock = Lock()
        if folder is None:
            return
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            if required:
                raise
            self._give_up(f"{folder}: cannot be made ({error.strerror})")
        if not required:
            # It may be another user's.
            with contextlib.suppress(OSError):
                folder.chmod(0o700)
        if limit_bytes is not None:
            _remove_oldest(folder, limit_bytes)

    def __reduce__(self) -> tuple[type[Cache], tuple[Path | None]]:
        # Workers of a cluster have folders of their own under this name, or share this one; they tell nobody.
        return Cache, (self._folder,)

    def load(self, key: str) -> Arrays | None:
        """What was saved under ``key``; None if nothing was, or the entry is damaged."""
        if self._folder is None:
            return None
        path = self._folder / f"{key}.entry"
        try:
            entry = read_small_file(path, MAX_ENTRY_BYTES)
            checksum, data = entry[:CHECKSUM_BYTES], entry[CHECKSUM_BYTES:]
            if checksum != _checksum(key, data):
                return None
            loaded = _unpack(data)
        except (OSError, ValueError, TypeError, AttributeError, OverflowError, RecursionError):
            return None
        # In a folder of somebody else, its owner sees to what is old.
        with contextlib.suppress(OSError):
            os.utime(path)
        return loaded

    def save(self, key: str, arrays: Arrays) -> None:
        """Keep ``arrays`` under ``key``, whole or not at all."""
        if self._folder is None or not self._writable:
            return
        data = _pack(arrays)
        path = self._folder / f"{key}.entry"
        try:
            with temporary_file(self._folder) as temporary:
                temporary.write_bytes(_checksum(key, data) + data)
                temporary.replace(path)
        except OSError as error:
            self._give_up(f"{path}: cannot be written ({error.strerror or error}); choose another folder")

    def _give_up(self, reason: str) -> None:
        with self._lock:
            was_writable, self._writable = self._writable, False
        if was_writable:
            self._tell(reason)


NO_CACHE = Cache(None)
"""Keeps nothing."""


def digest(*parts: str) -> str:
    """A short key for ``parts``: it changes when any part changes."""
    state = hashlib.sha256()
    for part in parts:
        # With its length, so that text that moves from one part to the next changes the key, too.
        encoded = part.encode()
        state.update(len(encoded).to_bytes(8, "little") + encoded)
    return state.hexdigest()[:20]


def _remove_oldest(folder: Path, limit_bytes: int) -> None:
    """Remove the entries that were not used for longest, until the rest takes at most ``limit_bytes``."""
    with contextlib.suppress(OSError):
        entries = sorted(
            ((path.stat(), path) for path in folder.glob("*.entry")), key=lambda entry: -entry[0].st_mtime_ns
        )
        total = 0
        for status, path in entries:
            total += status.st_size
            if total > limit_bytes:
                path.unlink()


def _pack(arrays: Arrays) -> bytes:
    """A line of JSON with the types and shapes, then the values.

    NumPy's own files have a Python literal for this, and CPython 3.11 cannot read literals in several threads at once
    (`SystemError`: "AST constructor recursion depth mismatch").
    """
    header = {
        name: (array.dtype.str if array.dtype.names is None else array.dtype.descr, array.shape)
        for name, array in arrays.items()
    }
    return b"\n".join([json.dumps(header).encode(), b"".join(array.tobytes() for array in arrays.values())])


def _unpack(data: bytes) -> Arrays:
    """What `_pack` packed; arrays of objects, which would run code from a shared folder, are refused."""
    header, _, values = data.partition(b"\n")
    arrays, start = {}, 0
    for name, (kind, shape) in json.loads(header).items():
        dtype = np.dtype(
            kind if isinstance(kind, str) else [(field, of, *map(tuple, size)) for field, of, *size in kind]
        )
        arrays[name] = np.frombuffer(values, dtype, math.prod(shape), start).reshape(shape).copy()
        start += arrays[name].nbytes
    return arrays


def _checksum(key: str, data: bytes) -> bytes:
    """SHA-256 of an entry; it covers the key, so that a renamed entry is not taken for another."""
    return hashlib.sha256(key.encode() + data).digest()
