"""Slow builds, of Verilog and compiled simulators: once for all processes, kept in the user's cache."""

import atexit
import contextlib
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from threading import RLock

import numpy as np

from golden_model.cache import Arrays, Cache, cache_folder
from golden_model.temporary import hold, temporary_folder
from sim.backends.errors import BackendError
from sim.backends.interface import Progress

MIN_FREE_BYTES = 64 << 20
"""A build that fails with less free space than this is tried again in the system's temporary folder."""
_made: dict[tuple[Path, str], Path] = {}
"""Folders of this process, by the cache and the name of what is in them."""
_making = RLock()
"""Held by the thread that fills a folder; one build may need another."""


def build_once(name: str, build: Callable[[Path], None], *, what: str, progress: Progress) -> Path:
    """Return a folder of this process with the files of a build; ``build`` makes them the first time.

    Several processes can call it at once: the later ones wait for the first. All files are one entry of the cache, so a
    killed build leaves none, and a damaged one is built again. If the cache cannot be written, the build serves this
    process alone.

    Parameters
    ----------
    name : str
        What is built, and the `digest` of everything it depends on.
    build : callable
        Fills the empty folder it is given; may be called twice.
    what : str
        Name of what is built, for messages.
    progress : callable
        Receives a line when a build starts and one with its duration; not called if the cache has it.

    Raises
    ------
    BackendError
        If neither the cache nor a temporary folder can be written; ``build`` may raise others.
    """
    kept_in = cache_folder()
    with _making:
        if (kept_in, name) not in _made:
            try:
                _made[kept_in, name] = _provide(name, build, kept_in, what, progress)
            except (OSError, BackendError) as error:
                if isinstance(error, BackendError) and not _is_full(kept_in):
                    raise
                reason = getattr(error, "strerror", None) or "its disk is full"
                progress(f"cannot write the cache {kept_in} ({reason}); {what} is built for this run only")
                _made[kept_in, name] = _provide_temporarily(name, build, what, progress)
        return _made[kept_in, name]


def keep_only(folder: Path, name: str) -> None:
    """Remove all other files of a build, most of which are large and have served their purpose."""
    for path in folder.iterdir():
        if path.name != name:
            path.unlink()


def _provide(name: str, build: Callable[[Path], None], kept_in: Path, what: str, progress: Progress) -> Path:
    kept_in.mkdir(mode=0o700, parents=True, exist_ok=True)
    entries = Cache(kept_in, tell=lambda reason: progress(f"{what} is not kept for the next run: {reason}"))
    with _new_folder(name, kept_in) as folder:
        if (files := entries.load(name)) is None:
            with _only_one(kept_in / f"{name}.lock", what, progress):
                if (files := entries.load(name)) is None:
                    _build(folder, build, f"once; later runs find it in {kept_in}", what, progress)
                    entries.save(name, _read(folder))
                    return folder
        _write(folder, files)
    return folder


def _provide_temporarily(name: str, build: Callable[[Path], None], what: str, progress: Progress) -> Path:
    try:
        with _new_folder(name, None) as folder:
            if (files := Cache(cache_folder()).load(name)) is None:
                _build(folder, build, f"for this run only, in {folder.parent}", what, progress)
            else:
                _write(folder, files)
    except OSError as error:
        raise BackendError(
            f"cannot write {what} to a temporary folder: {error.strerror or error}; free space on the disk, or set "
            "XDG_CACHE_HOME or TMPDIR to a folder that can be written"
        ) from error
    return folder


@contextlib.contextmanager
def _new_folder(name: str, beside: Path | None) -> Iterator[Path]:
    """Context that fills a new folder, which stays until this process ends if it does not fail."""
    # Each attempt has its own, so that a compiler that outlives a failed build cannot write into the next one.
    folder = Path(tempfile.mkdtemp(prefix=f"{name}-", dir=_own_folder(beside)))
    try:
        yield folder
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


@cache
def _own_folder(beside: Path | None) -> Path:
    """The folder of this process: in the cache, since programs may not run from the system's temporary folder."""
    stack = contextlib.ExitStack()
    folder = stack.enter_context(temporary_folder(beside))
    atexit.register(stack.close)
    return folder


def _is_full(folder: Path) -> bool:
    try:
        return shutil.disk_usage(folder).free < MIN_FREE_BYTES
    except OSError:
        return True


def _build(folder: Path, build: Callable[[Path], None], kept: str, what: str, progress: Progress) -> None:
    progress(f"building {what} ({kept})")
    started = time.monotonic()
    build(folder)
    progress(f"built {what} in {time.monotonic() - started:.0f} s")


def _read(folder: Path) -> Arrays:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): np.fromfile(path, np.uint8) for path in paths}


def _write(folder: Path, files: Arrays) -> None:
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data.tobytes())
        # Programs are among them.
        path.chmod(0o700)


@contextlib.contextmanager
def _only_one(lock: Path, what: str, progress: Progress) -> Iterator[None]:
    """Context of an exclusive lock, with a line if it must be waited for."""
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(hold(lock, timeout_s=0))
        except TimeoutError:
            progress(f"waiting for another process that builds {what}")
            stack.enter_context(hold(lock))
        yield
