"""The disk space that all sessions share: which of them lose their files when it runs short."""

from __future__ import annotations

import shutil
import stat
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Protocol

from nicegui import Event

from skymosaic.panel.uploads.received import UploadRefusedError
from skymosaic.temporary import temporary_folder

MOST_BYTES = 16 << 30
"""Limit of all sessions' files together."""
LEAST_FREE_BYTES = 1 << 30
"""Limit of what is left on the disk."""
MOST_SESSIONS = 500
IDLE_SECONDS = 300.0
"""A session that did nothing for this time may lose its files to another one, if space runs short."""
BUSY = 503


class Stored(Protocol):
    """What is needed of a session."""

    last_active: float
    changed: Event[[]]

    @property
    def is_busy(self) -> bool:
        """Whether a job or an upload is running."""

    @property
    def stored_bytes(self) -> int:
        """Size of its files."""

    def close(self) -> None:
        """Remove its files."""


def bytes_in(folder: Path) -> int:
    """Size of the files below a folder; one that vanishes meanwhile does not count."""
    total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            status = path.lstat()
            total += status.st_size if stat.S_ISREG(status.st_mode) else 0
    return total


class Storage:
    """A temporary folder with a folder for each session that has files."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._folder = self._stack.enter_context(temporary_folder())
        self._sessions: list[Stored] = []

    def make_folder(self, session: Stored) -> Path:
        """A folder for a session's files.

        Raises
        ------
        UploadRefusedError
            If there is no space, and no session has been idle for long enough to lose its files.
        """
        self.make_room()
        self._sessions.append(session)
        return Path(tempfile.mkdtemp(dir=self._folder))

    def make_room(self) -> None:
        """Remove the files of sessions, the longest idle first, until the limits hold; raises as `make_folder`."""
        while self._is_short():
            now = time.monotonic()
            idle = [kept for kept in self._sessions if not kept.is_busy and now - kept.last_active > IDLE_SECONDS]
            if not idle:
                raise UploadRefusedError("the panel has no space left for now; try again later", BUSY)
            longest = min(idle, key=lambda kept: kept.last_active)
            self.forget(longest)
            longest.close()
            longest.changed.emit()

    def forget(self, session: Stored) -> None:
        """A session has no files any more."""
        self._sessions = [kept for kept in self._sessions if kept is not session]

    def close(self) -> None:
        """Remove every file."""
        self._stack.close()

    def _is_short(self) -> bool:
        stored = sum(session.stored_bytes for session in self._sessions)
        free = shutil.disk_usage(self._folder).free
        return len(self._sessions) >= MOST_SESSIONS or stored > MOST_BYTES or free < LEAST_FREE_BYTES
