"""Temporary files and folders, each owned by a lock on a file beside it, which ends with the process that made it.

Locks reach across containers and, where the file system takes part, machines. Numbers of processes do not: in another
container they name nobody, or somebody else.
"""

import contextlib
import errno
import functools
import hashlib
import importlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

SHOWN = "skymosaic-"
HIDDEN = ".skymosaic-"
"""Beginnings of names: in the system's temporary folder, and beside outputs."""
LOCK = ".lock"
"""The end of a lock's name, which begins like that of the file it stands for."""
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)
"""Errors of a file system without locks, or of a server that does not answer for them."""


@contextlib.contextmanager
def hold(path: Path, *, timeout_s: float = -1) -> Iterator[bool]:
    """Context of the lock on a file, which is made for it; the system releases it however this process ends.

    Yields whether there is a lock: where the file system has none, nobody is kept out.

    Parameters
    ----------
    path : Path
        Removed at the end, and by whoever holds its lock after this process has been killed.
    timeout_s : float
        Time to wait for another process that holds it; negative: until it ends.

    Raises
    ------
    TimeoutError
        If another process holds it.
    OSError
        If the file cannot be made.
    """
    # The library would make the folder, too.
    path.parent.stat()
    # Importing it takes longer than printing the help.
    lock = importlib.import_module("filelock").FileLock(
        path, timeout=timeout_s, thread_local=False, fallback_to_soft=False
    )
    try:
        lock.acquire()
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
    try:
        yield bool(lock.is_locked)
    finally:
        # While it is locked: whoever waits for it sees that it is gone, and makes a new one. Windows does not remove
        # what is open; there, releasing does.
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()


def lock_for(path: Path, folder: Path) -> Path:
    """The lock for an output inside ``folder``, the same under whatever name containers see that folder."""
    inside = hashlib.sha256(os.fsencode(path.relative_to(folder))).hexdigest()
    return folder / f"{HIDDEN}{inside[:16]}{LOCK}"


def is_lock(path: Path) -> bool:
    """Whether a file is the lock for a file beside it."""
    return path.name.startswith(HIDDEN) and path.suffix == LOCK


@contextlib.contextmanager
def temporary_file(folder: Path) -> Iterator[Path]:
    """Context of a new hidden file in ``folder``, removed at the end unless it has been renamed."""
    with _own_name(folder, hidden=True) as path:
        try:
            # Not by `tempfile`, whose files are their owner's alone: this one becomes an ordinary file.
            path.touch(exist_ok=False)
            yield path
        finally:
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def temporary_folder(beside: Path | None = None) -> Iterator[Path]:
    """Context of a new folder, removed at the end: hidden inside ``beside``, or in the system's temporary folder."""
    with _own_name(beside or Path(tempfile.gettempdir()), hidden=beside is not None) as path:
        try:
            path.mkdir(mode=0o700)
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)


@contextlib.contextmanager
def _own_name(folder: Path, *, hidden: bool) -> Iterator[Path]:
    remove_left_overs(folder, hidden=hidden)
    path = folder / f"{HIDDEN if hidden else SHOWN}{secrets.token_hex(8)}"
    with hold(path.with_suffix(LOCK)):
        yield path


@functools.cache
def remove_left_overs(folder: Path, *, hidden: bool) -> None:
    """Remove temporary files and folders of ended processes, known by locks that nobody holds; once per folder."""
    with contextlib.suppress(OSError):
        for lock in folder.glob(f"{HIDDEN if hidden else SHOWN}*{LOCK}"):
            with contextlib.suppress(OSError), hold(lock, timeout_s=0) as locked:
                if locked:
                    _remove(lock.with_suffix(""))


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
