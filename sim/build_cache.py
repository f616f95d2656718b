"""A cache in the user's folder for what takes long to build: Verilog and compiled simulators."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sim.backend import BackendError, Progress


def cache_folder() -> Path:
    """The project's folder in ``XDG_CACHE_HOME``, or in ``~/.cache`` if that is not set."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "skymosaic"


def digest(*parts: str) -> str:
    """A short key for ``parts``: it changes when any part changes."""
    state = hashlib.sha256()
    for part in parts:
        encoded = part.encode()
        state.update(len(encoded).to_bytes(8, "little") + encoded)
    return state.hexdigest()[:20]


def digest_files(paths: Iterable[Path]) -> str:
    """A key for the names and contents of files, in the order of their names."""
    return digest(*(text for path in sorted(paths) for text in (path.name, path.read_text(encoding="utf-8"))))


def cached(name: str, build: Callable[[Path], None], *, what: str, progress: Progress) -> Path:
    """Return the folder ``name`` of the cache; ``build`` fills it the first time.

    Several processes can call it at once: the later ones wait for the first. A build that is killed leaves no broken
    folder, since a folder gets its final name only when it is complete.

    Parameters
    ----------
    name : str
        Folder name: what it contains, and the `digest` of everything that it depends on.
    build : callable
        Fills the empty folder it is given.
    what : str
        Name of what is built, for messages.
    progress : callable
        Receives a line when a build starts and one with its duration; not called if the folder exists.

    Raises
    ------
    BackendError
        If the cache cannot be written; ``build`` may raise others.
    """
    folder = cache_folder() / name
    if folder.is_dir():
        return folder
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with _locked(folder.with_suffix(".lock"), what, progress):
            if not folder.is_dir():
                _build_in_place(folder, build, what, progress)
    except OSError as error:
        raise BackendError(
            f"cannot write the cache {folder.parent}: {error.strerror or error}; "
            "set XDG_CACHE_HOME to a folder that can be written"
        ) from error
    return folder


def _build_in_place(folder: Path, build: Callable[[Path], None], what: str, progress: Progress) -> None:
    # Each attempt has its own folder, so that a compiler that outlives a killed build cannot write into the next one.
    # The folders that killed builds left are removed here: we hold the lock, so no other build is running.
    for left_over in folder.parent.glob(f"{folder.name}.*.part"):
        shutil.rmtree(left_over, ignore_errors=True)
    part = Path(tempfile.mkdtemp(prefix=f"{folder.name}.", suffix=".part", dir=folder.parent))
    progress(f"building {what} (once; later runs find it in {folder.parent})")
    started = time.monotonic()
    try:
        build(part)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    progress(f"built {what} in {time.monotonic() - started:.0f} s")


@contextmanager
def _locked(path: Path, what: str, progress: Progress) -> Iterator[None]:
    """Hold an exclusive lock; the system releases it when the process ends, even if it is killed."""
    with path.open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            progress(f"waiting for another process that builds {what}")
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
