"""A cache in the user's folder for slow builds: Verilog and compiled simulators."""

import atexit
import hashlib
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from filelock import AcquireReturnProxy, FileLock, Timeout

from golden_model.user_cache import cache_folder, make_private
from sim.backends.errors import BackendError
from sim.backends.interface import Progress

CHECKSUMS = "checksums"
"""File in each folder of the cache: one line per other file, with its SHA-256 and its path."""
MIN_FREE_BYTES = 64 << 20
"""A build that fails with less free space than this is tried again in a temporary folder."""


def digest(*parts: str) -> str:
    """A short key for ``parts``: it changes when any part changes."""
    state = hashlib.sha256()
    for part in parts:
        # With its length, so that text that moves from one part to the next changes the key, too.
        encoded = part.encode()
        state.update(len(encoded).to_bytes(8, "little") + encoded)
    return state.hexdigest()[:20]


def build_once(name: str, build: Callable[[Path], None], *, what: str, progress: Progress) -> Path:
    """Return the folder ``name`` of the cache; ``build`` fills it the first time.

    Several processes can call it at once: the later ones wait for the first. A killed build leaves no broken folder,
    since a folder gets its final name only when it is complete. The files are compared with their checksums each time,
    and a damaged folder is built again. If the cache cannot be written, a temporary folder serves this process.

    Parameters
    ----------
    name : str
        Folder name: what it contains, and the `digest` of everything it depends on.
    build : callable
        Fills the empty folder it is given; may be called twice.
    what : str
        Name of what is built, for messages.
    progress : callable
        Receives a line when a build starts and one with its duration; not called if the folder exists.

    Raises
    ------
    BackendError
        If neither the cache nor a temporary folder can be written; ``build`` may raise others.
    """
    folder = cache_folder() / name
    if _is_intact(folder):
        return folder
    try:
        make_private(folder.parent)
        with _lock(folder.with_suffix(".lock"), what, progress):
            if not _is_intact(folder):
                _build_in_place(folder, build, what, progress)
    except (OSError, BackendError) as error:
        if isinstance(error, BackendError) and not _is_full(folder.parent):
            raise
        reason = getattr(error, "strerror", None) or "its disk is full"
        progress(f"cannot write the cache {folder.parent} ({reason}); {what} is built for this run only")
        return _build_temporarily(name, build, what, progress)
    return folder


def _build_temporarily(name: str, build: Callable[[Path], None], what: str, progress: Progress) -> Path:
    try:
        folder = _temporary_cache() / name
        if not _is_intact(folder):
            _build_in_place(folder, build, what, progress)
    except OSError as error:
        raise BackendError(
            f"cannot write {what} to a temporary folder: {error.strerror or error}; free space on the disk, or set "
            "XDG_CACHE_HOME or TMPDIR to a folder that can be written"
        ) from error
    return folder


@cache
def _temporary_cache() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="skymosaic-cache-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _is_full(folder: Path) -> bool:
    try:
        return shutil.disk_usage(folder).free < MIN_FREE_BYTES
    except OSError:
        return True


def _build_in_place(folder: Path, build: Callable[[Path], None], what: str, progress: Progress) -> None:
    # Of killed builds: ours alone holds the lock.
    for left_over in folder.parent.glob(f"{folder.name}.*.part"):
        shutil.rmtree(left_over, ignore_errors=True)
    # Each attempt has its own folder, so that a compiler that outlives a killed build cannot write into the next one.
    part = Path(tempfile.mkdtemp(prefix=f"{folder.name}.", suffix=".part", dir=folder.parent))
    where = "once; later runs find it" if folder.parent == cache_folder() else "for this run only,"
    progress(f"building {what} ({where} in {folder.parent})")
    started = time.monotonic()
    try:
        build(part)
        built = sorted(path for path in part.rglob("*") if path.is_file())
        (part / CHECKSUMS).write_text(_checksums(part, built), encoding="utf-8")
        # A damaged one, since a rename replaces empty folders only.
        shutil.rmtree(folder, ignore_errors=True)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    progress(f"built {what} in {time.monotonic() - started:.0f} s")


def _is_intact(folder: Path) -> bool:
    """Whether every file that was built still has its checksum."""
    try:
        recorded = (folder / CHECKSUMS).read_text(encoding="utf-8")
        paths = [folder / line.partition(" ")[2] for line in recorded.splitlines()]
        return bool(paths) and _checksums(folder, paths) == recorded
    except (OSError, ValueError):  # a damaged record may be no UTF-8, or name impossible files
        return False


def _checksums(folder: Path, paths: Iterable[Path]) -> str:
    lines = []
    for path in paths:
        with path.open("rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()} {path.relative_to(folder).as_posix()}\n")
    return "".join(lines)


def _lock(path: Path, what: str, progress: Progress) -> AcquireReturnProxy:
    """Context of an exclusive lock; the system releases it when the process ends, even if it is killed."""
    lock = FileLock(path)
    try:
        return lock.acquire(timeout=0)
    except Timeout:
        progress(f"waiting for another process that builds {what}")
        return lock.acquire()
