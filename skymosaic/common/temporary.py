"""Temporary files named after their process, so that a later run can remove those of a killed process."""

import contextlib
import errno
import functools
import os
import re
import secrets
import shutil
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

PAGE = "index.html"
"""The page of a folder that is made for a browser."""
_expected_new: set[Path] = set()
"""Outputs that were not there when they were checked, and may not replace what has appeared under their names."""


def expect_new(path: Path, *, new: bool) -> None:
    """Say whether an output will be new, or may replace what is there; from its first publication on, it may."""
    (_expected_new.add if new else _expected_new.discard)(_place(path))


def publish(temporary: Path, path: Path) -> None:
    """Give a complete temporary file its name; FileExistsError if another file has it that was not to be replaced."""
    if not _is_expected_new(path):
        temporary.replace(path)
        return
    try:
        # Unlike renaming, this replaces nothing.
        os.link(temporary, path)
    except FileExistsError:
        raise
    # The file system has no hard links.
    except OSError:
        path.touch(exist_ok=False)
        temporary.replace(path)
    expect_new(path, new=False)


def _is_expected_new(path: Path) -> bool:
    return _place(path) in _expected_new


def _place(path: Path) -> Path:
    return resolved(path.parent) / path.name


@contextlib.contextmanager
def temporary_file(folder: Path) -> Iterator[Path]:
    """Context of a new hidden file in ``folder``, removed at the end unless it has been renamed."""
    remove_left_overs(folder, hidden=True)
    path = folder / f"{_prefix(hidden=True)}{secrets.token_hex(8)}"
    # Not by `tempfile`, whose files are their owner's alone: this one becomes an ordinary file.
    path.touch(exist_ok=False)
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def temporary_folder(beside: Path | None = None) -> Iterator[Path]:
    """Context of a new folder, removed at the end: hidden inside ``beside``, or in the system's temporary folder."""
    hidden = beside is not None
    parent = beside or Path(tempfile.gettempdir())
    remove_left_overs(parent, hidden=hidden)
    with tempfile.TemporaryDirectory(prefix=_prefix(hidden=hidden), dir=parent, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@contextlib.contextmanager
def staged_folder(target: Path, own: str) -> Iterator[Path]:
    """Context of a hidden folder beside ``target`` whose content takes the place of the old one at the end.

    On any failure ``target`` stays as it is. A new folder appears at once. In an existing one the page, by which
    readers come in, goes first and comes last; if it was to be new, there must be nothing to replace.

    Parameters
    ----------
    target : Path
        Created with its parents if it is missing.
    own : str
        Regular expression of the names that are ours and go; whatever else is in ``target`` is somebody's work.
    """
    new = _is_expected_new(target)
    expect_new(target, new=False)
    target = resolved(target)
    with temporary_folder(existing_parent(target)) as folder:
        staged, old = folder / "new", folder / "old"
        for each in (staged, old):
            each.mkdir()
        yield staged
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists():
            staged.rename(target)
            return
        # Emptied rather than replaced, because it may be the user's current folder.
        leaving = [path for path in target.iterdir() if re.fullmatch(own, path.name)]
        if leaving and new:
            raise FileExistsError(errno.EEXIST, "files have appeared in it", str(target))
        for path in sorted(leaving, key=lambda path: path.name != PAGE):
            path.rename(old / path.name)
        for path in sorted(staged.iterdir(), key=lambda path: path.name == PAGE):
            path.rename(target / path.name)


def resolved(path: Path) -> Path:
    """The absolute path without symbolic links, as far as they lead anywhere: `Path.resolve` fails for a loop."""
    return Path(os.path.realpath(path))


def existing_parent(path: Path) -> Path:
    """The nearest folder above ``path`` that exists: what is made there is on the same disk, and moved by renaming."""
    return next(parent for parent in path.absolute().parents if parent.exists())


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
