"""The finished runs, kept until they are deleted."""

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path

from golden_model.temporary import temporary_folder
from skymosaic.common.errors import InputError
from skymosaic.common.provenance import to_json
from skymosaic.imagery.images import save_bytes
from skymosaic.panel.results import find_inside

MANIFEST = "run.json"


@contextmanager
def open_runs(folder: Path) -> Iterator["Runs"]:
    """Context of the runs in a folder, which is made where it does not exist.

    What is not finished is removed at the end, or by the next start if this process is killed.

    Raises
    ------
    InputError
        If the folder cannot be made.
    """
    with ExitStack() as stack:
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            unfinished = stack.enter_context(temporary_folder(folder))
        except OSError as error:
            raise InputError(f"{folder}: cannot be made ({error.strerror}); name another folder with --runs") from None
        yield Runs(folder, unfinished)


class Runs:
    """A folder with a folder for each run, of the same disk as ``unfinished``.

    A run is written in ``unfinished`` and renamed when it is complete, and renamed back before it is removed: whenever
    the panel is killed, a run is whole or gone.
    """

    def __init__(self, folder: Path, unfinished: Path) -> None:
        self._folder, self.unfinished = folder, unfinished

    def keep(self, folder: Path, title: str) -> Path:
        """Move a finished run's folder here; returns its new place."""
        now = datetime.now().astimezone()
        save_bytes(folder / MANIFEST, to_json({"title": title, "finished": f"{now:%Y-%m-%d %H:%M}"}))
        return folder.rename(self._folder / f"{now:%Y%m%d-%H%M%S-%f}")

    def __iter__(self) -> Iterator[tuple[Path, str, str]]:
        """Folder, title and time of each run, the latest first."""
        for manifest in sorted(self._folder.glob(f"[0-9]*/{MANIFEST}"), reverse=True):
            # Whatever else lies here is somebody's own.
            with suppress(OSError, ValueError, KeyError, TypeError):
                read = json.loads(manifest.read_text(encoding="utf-8"))
                yield manifest.parent, str(read["title"]), str(read["finished"])

    def delete(self, name: str) -> None:
        """Remove a run; nothing happens to one that is gone."""
        if folder := self.find_file(name, MANIFEST):
            shutil.rmtree(folder.parent.rename(self.unfinished / f"deleted-{name}"), ignore_errors=True)

    def find_file(self, name: str, path: str) -> Path | None:
        """A file of a run; None for whatever lies elsewhere, links followed."""
        manifest = find_inside(self._folder, f"{name}/{MANIFEST}")
        is_run = manifest is not None and manifest.parent.parent == self._folder.resolve()
        return find_inside(self._folder / name, path) if is_run else None
