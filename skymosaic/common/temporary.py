"""Outputs that appear under their names only when they are complete, and replace nothing that was not to be."""

import contextlib
import errno
import os
import re
from collections.abc import Iterator
from pathlib import Path

from golden_model.temporary import temporary_file, temporary_folder
from skymosaic.common.errors import AppearedError, OutputError

PAGE = "index.html"
"""The page of a folder that is made for a browser."""
_expected_new: set[Path] = set()
"""Outputs that were not there when they were checked, and may not replace what has appeared under their names."""


def expect_new(path: Path, *, new: bool) -> None:
    """Say whether an output will be new, or may replace what is there; from its first publication on, it may."""
    (_expected_new.add if new else _expected_new.discard)(_place(path))


@contextlib.contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Context of a temporary file beside ``path``, renamed to ``path`` at the end and deleted on any failure.

    Raises
    ------
    OutputError
        `AppearedError` if `check_unused` found no such file, and there is one now.
    """
    try:
        with temporary_file(path.parent) as temporary:
            yield temporary
            _publish(temporary, path)
    except FileExistsError:
        raise AppearedError(f"{path}: has appeared since this run began, and stays; choose another name") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another folder") from None


def _publish(temporary: Path, path: Path) -> None:
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
    return next(parent for parent in (*path.absolute().parents, path) if parent.exists())
