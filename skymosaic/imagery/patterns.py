"""Files as users name them: a pattern such as ``flight/*.jpg`` stands for what it matches, in the order of numbers."""

import glob
import os
import re
from pathlib import Path

from skymosaic.common.errors import InputError


def expand_pattern(path: Path) -> list[Path]:
    """The files and folders that a name stands for: itself, unless it is a pattern that matches others.

    Shells expand patterns, but neither Python nor the command prompt of Windows does.
    """
    if not glob.has_magic(str(path)) or os.path.lexists(path):
        return [path]
    # `Path.glob` does not start at absolute paths.
    matches = glob.glob(str(path))  # noqa: PTH207
    return sorted(map(Path, matches), key=lambda match: natural_order(str(match))) or [path]


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
