"""Files as users name them: a pattern such as ``flight/*.jpg`` stands for what it matches, in the order of numbers."""

import glob
import os
import re
from collections.abc import Iterator
from pathlib import Path

from skymosaic.common.errors import InputError
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
        for folder in _list_folders(top):
            yield from _match(Path(glob.escape(folder), *(parts[at + 1 :] or "*")))


def _list_folders(top: Path) -> Iterator[str]:
    """A folder and those inside; as in `skymosaic.imagery.folders`, no hidden ones, links, reports or tiles."""
    for place, inside, files in os.walk(top):
        if PAGE in files and Path(place) != top:
            inside.clear()
            continue
        inside[:] = [name for name in inside if not name.startswith(".")]
        yield place


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
