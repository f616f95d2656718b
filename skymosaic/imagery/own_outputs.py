"""Records which pictures in a folder of photographs are mosaics, so that later runs do not use them as input."""

import contextlib
import hashlib
import os
from collections.abc import Collection, Iterable
from functools import lru_cache
from pathlib import Path

from golden_model.small_files import read_small_file
from skymosaic.common.temporary import resolved
from skymosaic.imagery.images import save_bytes

RECORD_NAME = ".skymosaic-outputs"
"""File in the folder of photographs, with a line per mosaic: its SHA-256 and its name."""


def record_output(output: Path, folders: Iterable[Path]) -> None:
    """Record a complete mosaic if a run that reads the folder of all its photographs may find it; others need none."""
    folder = resolved(output).parent
    try:
        common = os.path.commonpath([resolved(each) for each in folders])
    # There is none, as of arrays.
    except ValueError:
        return
    if not folder.is_relative_to(common):
        return
    record = {name: digest for name, digest in _read_record(folder).items() if (folder / name).exists()}
    record[output.name] = _known_digest(output)
    # File names may be any bytes but NUL, which stands for a line break here.
    lines = [f"{digest} {name}".replace("\n", "\0") for name, digest in sorted(record.items())]
    text = "".join(f"{line}\n" for line in lines)
    save_bytes(folder / RECORD_NAME, text.encode("utf-8", "surrogateescape"))


def exclude_recorded(pictures: Collection[Path]) -> list[Path]:
    """Leave out recorded mosaics; a file that has changed since is no mosaic any more."""
    records = {folder: _read_record(folder) for folder in {path.parent for path in pictures}}
    found = ((path, records[path.parent].get(path.name)) for path in pictures)
    return [path for path, digest in found if digest is None or _known_digest(path) != digest]


def _read_record(folder: Path) -> dict[str, str]:
    # A name may be one that no file can have.
    with contextlib.suppress(OSError, ValueError):
        text = read_small_file(folder / RECORD_NAME).decode("utf-8", "surrogateescape")
        fields = (line.replace("\0", "\n").partition(" ") for line in text.split("\n") if line)
        return {name: digest for digest, _, name in fields}
    return {}


def _known_digest(path: Path) -> str:
    """The digest of a picture, computed once: a watched folder is listed several times a second."""
    with contextlib.suppress(OSError):
        state = path.stat()
        return _digest_of(path, state.st_size, state.st_mtime_ns)
    # No recorded digest is empty, so an unreadable file is not taken for a mosaic.
    return ""


@lru_cache(maxsize=64)
def _digest_of(path: Path, _size_bytes: int, _changed_ns: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
