"""Temporary files named after their process, so that a later run can remove those of a killed process."""

import contextlib
import functools
import os
import re
import shutil
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def temporary_file(folder: Path) -> Iterator[Path]:
    """Context of a new hidden file in ``folder``, removed at the end unless it has been renamed."""
    remove_left_overs(folder, hidden=True)
    handle, name = tempfile.mkstemp(prefix=_prefix(hidden=True), dir=folder)
    os.close(handle)
    try:
        yield Path(name)
    finally:
        Path(name).unlink(missing_ok=True)


@contextlib.contextmanager
def temporary_folder(beside: Path | None = None) -> Iterator[Path]:
    """Context of a new folder, removed at the end: hidden inside ``beside``, or in the system's temporary folder."""
    hidden = beside is not None
    parent = beside or Path(tempfile.gettempdir())
    remove_left_overs(parent, hidden=hidden)
    with tempfile.TemporaryDirectory(prefix=_prefix(hidden=hidden), dir=parent, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@functools.cache
def remove_left_overs(folder: Path, *, hidden: bool) -> None:
    """Remove temporary files and folders of this machine's ended processes; once per folder."""
    pattern = re.compile(re.escape(_prefix(hidden=hidden).rpartition("-")[0].rpartition("-")[0]) + r"-(\d+)-")
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            match = pattern.match(path.name)
            if match is None or _is_running(int(match[1])):
                continue
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                with contextlib.suppress(OSError):
                    path.unlink()


def _prefix(*, hidden: bool) -> str:
    # With the machine's name, because other machines may share the folder, and their processes cannot be asked.
    machine = re.sub(r"[^A-Za-z0-9]", "", socket.gethostname())[:32]
    return f"{'.' if hidden else ''}skymosaic-{machine}-{os.getpid()}-"


def _is_running(process: int) -> bool:
    # On Windows, os.kill would end the process instead of asking for it.
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
