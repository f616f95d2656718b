"""The sessions of all browsers, each kept apart from every other one."""

import tempfile
from contextlib import ExitStack
from pathlib import Path
from weakref import WeakValueDictionary

from skymosaic.common.errors import InputError
from skymosaic.common.temporary import temporary_folder
from skymosaic.panel.folders import Roots
from skymosaic.panel.runs import Runs
from skymosaic.panel.session import Queues, Session

MAX_SESSIONS = 64
"""Sessions with files; beyond this number, the one that has been idle the longest loses its files."""


class Sessions:
    """All sessions, by the identifier in their signed cookie.

    Every session offers the boards, ``board:HOST``; owners may open folders of the roots. Their runs are kept in the
    folder ``runs``, with all files meanwhile; None: they are not kept.

    Raises
    ------
    InputError
        If the folder of the runs cannot be made.
    """

    def __init__(self, boards: tuple[str, ...] = (), roots: Roots | None = None, runs: Path | None = None) -> None:
        self._boards, self._roots = boards, roots or Roots()
        self._queues = Queues()
        self._stack = ExitStack()
        try:
            if runs:
                runs.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.folder = self._stack.enter_context(temporary_folder(runs))
            """Where all files are; the next start removes it if this process is killed."""
        except OSError as error:
            raise InputError(f"{runs}: cannot be made ({error.strerror}); name another folder with --runs") from None
        self.runs = Runs(runs, self.folder) if runs else None
        # A session without files is forgotten when its page is closed.
        self._open: WeakValueDictionary[str, Session] = WeakValueDictionary()
        self._with_files: list[Session] = []

    def get(self, identifier: str, *, is_owner: bool = False) -> Session:
        """The session with this identifier, a new one if there is none; an owner's may open folders from now on."""
        session = self._open.get(identifier)
        if session is None:
            session = self._open[identifier] = Session(self._boards, self._queues, self._make_folder)
        if is_owner:
            session.roots, session.runs = self._roots, self.runs
        return session

    def _make_folder(self, session: Session) -> Path:
        """Make the folder of a session's files; beyond `MAX_SESSIONS`, the longest idle one loses its files."""
        idle = [each for each in self._with_files if not each.is_busy]
        if len(self._with_files) >= MAX_SESSIONS and idle:
            longest_idle = min(idle, key=lambda each: each.last_active)
            longest_idle.close()
            self._with_files.remove(longest_idle)
        self._with_files.append(session)
        return Path(tempfile.mkdtemp(dir=self.folder))

    def close(self) -> None:
        """Cancel every job and remove every file."""
        for session in list(self._open.values()):
            session.close()
        self._stack.close()
