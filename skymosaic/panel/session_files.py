"""The files of the session."""

import itertools
import shutil
import zipfile
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from skymosaic.panel.results import InputFile, Run, find_inside

MAX_BYTES = 4 << 30
"""Size of all files of the session, results included."""


class SessionFiles:
    """A folder with ``uploads``; ``runs``, a folder of inputs and outputs for each run; and ``pictures``.

    The pictures are what the page shows of the uploads and of each run, in folders of the same names, and of an opened
    folder.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._numbers = itertools.count(1)

    def folder(self, name: str) -> Path:
        """A folder below the session's; it is made where it does not exist."""
        folder = self._root / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def new_number(self) -> str:
        """Two digits or more for a file name, different on every call."""
        return f"{next(self._numbers):02}"

    @property
    def size_bytes(self) -> int:
        """Size of all files; one that vanishes meanwhile does not count."""
        total = 0
        for path in self._root.rglob("*"):
            with suppress(OSError):
                total += path.stat().st_size if path.is_file() else 0
        return total

    def find_picture(self, folder: str, name: str) -> Path | None:
        """Find a picture that is shown; None for any other name."""
        return find_inside(self._root / "pictures", f"{folder}/{name}")

    def write_archive(self, results: Mapping[str, Run]) -> Path:
        """Pack the folders of all results into a zip file, which the caller removes."""
        path = self.folder("archives") / f"{self.new_number()}.zip"
        try:
            with zipfile.ZipFile(path, "w") as archive:
                for name, result in results.items():
                    for file in sorted(result.folder.rglob("*")):
                        archive.write(file, f"{name}/{file.relative_to(result.folder)}")
        except OSError:
            # A part of it would leave even less room on a full disk.
            path.unlink(missing_ok=True)
            raise
        return path

    def new_run(self, inputs: Iterable[InputFile], shown: Collection[str]) -> tuple[Path, Path]:
        """Make a run's folder and that of its pictures; remove those that are not among the names ``shown``."""
        for path in (*self.folder("runs").iterdir(), *self.folder("pictures").iterdir()):
            if path.name not in shown:
                shutil.rmtree(path)
        number = self.new_number()
        run, pictures = self.folder(f"runs/{number}"), self.folder(f"pictures/{number}")
        for upload in inputs:
            if upload.is_upload:
                # Hard links: the run keeps its photographs when they are removed from the page, and costs no space.
                (run / upload.name).hardlink_to(self.folder("uploads") / upload.name)
        return run, pictures

    def remove(self, inputs: Iterable[InputFile]) -> None:
        """Remove the files of uploads; those of an opened folder are not the session's."""
        for upload in inputs:
            if upload.is_upload:
                (self.folder("uploads") / upload.name).unlink(missing_ok=True)
                upload.thumbnail.unlink(missing_ok=True)
