"""Files as users name them: a pattern such as ``flight/*.jpg`` stands for what it matches, in the order of numbers.

All that goes through folders, for a pattern with ``**`` too, walks by the rule of `walk_folders`.
"""

import contextlib
import glob
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path

from skymosaic.common.errors import InputError, reading
from skymosaic.common.temporary import PAGE


def expand_pattern(path: Path) -> list[Path]:
    """The files and folders that a name stands for: itself, unless it is a pattern that matches others.

    ``**`` stands for folders at any depth, and at the end for all files in them. Shells expand patterns, but neither
    Python nor the command prompt of Windows does.
    """
    if not glob.has_magic(str(path)) or os.path.lexists(path):
        return [path]
    matches = sorted(set(_match(path)), key=lambda match: natural_order(str(match)))
    # Folders would give the files in them again.
    files = [match for match in matches if not match.is_dir()] if "**" in path.parts else []
    return files or matches or [path]


def _match(path: Path) -> Iterator[Path]:
    parts = path.parts
    if "**" not in parts:
        # `Path.glob` does not start at absolute paths.
        yield from map(Path, glob.glob(str(path)))  # noqa: PTH207
        return
    # `glob` would follow links to folders, even in circles.
    at = parts.index("**")
    for top in _match(Path(*parts[:at])):
        with contextlib.suppress(InputError):
            for folder, _ in walk_folders(top):
                yield from _match(Path(glob.escape(str(folder)), *(parts[at + 1 :] or "*")))


def walk_folders(folder: Path, depth: float = math.inf, *, strict: bool = False) -> Iterator[tuple[Path, list[Path]]]:
    """A folder and those inside, each with its files in order, without hidden ones, links, and folders with a page.

    Raises
    ------
    InputError
        If the folder cannot be read; where ``strict``, also if one inside cannot be.
    """
    # File systems and unfinished copies leave files whose names start with a dot.
    inside = [path for path in list_folder(folder) if not path.name.startswith(".")]
    inside.sort(key=lambda path: natural_order(path.name))
    # A link to nothing, or to where nobody may look, is left out by name later.
    yield folder, [path for path in inside if not is_folder(path)]
    for path in inside if depth > 0 else ():
        # A page for a browser is that of a report or of tiles.
        if is_folder(path) and not path.is_symlink() and not os.path.lexists(path / PAGE):
            try:
                yield from walk_folders(path, depth - 1, strict=strict)
            except InputError:
                if strict:
                    raise


def is_folder(path: Path) -> bool:
    """Whether a path names a folder; False for a name that the file system cannot have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def list_folder(folder: Path) -> list[Path]:
    """List what a folder contains.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    with reading(folder, "check its permissions"):
        return list(folder.iterdir())


def only_match(path: Path) -> Path:
    """The one file that a name stands for.

    Raises
    ------
    InputError
        For a pattern that matches several.
    """
    matches = expand_pattern(path)
    if len(matches) > 1:
        raise InputError(f"{path}: matches {len(matches)} files, from {matches[0]} on; name one of them")
    return matches[0]


def natural_order(name: str) -> list[tuple[int, str]]:
    """Sorting key that compares numbers in names by value: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]
