"""No output is an input: finds what an output would replace, under each of its names, by links and other spellings."""

import contextlib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from skymosaic.common.errors import InputError
from skymosaic.common.temporary import resolved


def refuse_inputs(output: Path, inputs: Iterable[Path], own: str = "") -> None:
    """Raise `InputError` if an output would replace an input; parameters as those of `find_replaced`."""
    if found := find_replaced(output, inputs, own):
        name, file = found
        if own:
            part = name.relative_to(output).parts[0]
            raise InputError(f"{output}: its {part} holds {file}, one of the inputs; choose another folder")
        same = "" if name == file else f"the same file as {file}, "
        raise InputError(f"{output}: is {same}one of the inputs; choose another name")


def find_replaced(output: Path, files: Iterable[Path], own: str = "") -> tuple[Path, Path] | None:
    """Find a name that an output replaces, and the file under it, if that is one of ``files``.

    Parameters
    ----------
    files : iterable of Path
        What must stay; of folders, all that is in them.
    own : str
        Regular expression of the names that are replaced in the folder ``output``; empty: the output is a file.
    """
    names = {key: name for name in (_list_own(output, own) if own else [output]) for key in _keys(name)}
    for file in files:
        place, top = resolved(file), resolved(output)
        found = [names[key] for key in (*_keys(file), *place.parents) if key in names]
        # What is not there yet: another output.
        if not found and own and top in place.parents:
            found = [output / name for name in place.relative_to(top).parts[:1] if _fits(own, name)]
        if found:
            return found[0], file
    return None


def _keys(path: Path) -> Iterator[Path | tuple[int, int]]:
    """What two names of one file have in common: the place to which they lead, or the file's number on its disk."""
    yield resolved(path)
    # There is no file yet, or none can have this name.
    with contextlib.suppress(OSError, ValueError):
        status = path.stat()
        yield status.st_dev, status.st_ino


def _list_own(folder: Path, own: str) -> Iterator[Path]:
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if _fits(own, path.name):
                yield from (path, *path.rglob("*"))


def _fits(own: str, name: str) -> bool:
    # macOS and Windows take MOSAIC.JPG for the same file.
    return re.fullmatch(own, name, re.IGNORECASE) is not None
