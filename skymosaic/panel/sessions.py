"""The sessions of all browsers, each kept apart from every other one's."""

from __future__ import annotations

from weakref import WeakValueDictionary

from skymosaic.panel.session import Session
from skymosaic.panel.uploads.intake import JobQueues
from skymosaic.panel.uploads.storage import Storage


class Sessions:
    """All sessions, by the identifier in their signed cookie.

    A session without files is forgotten when its page is closed; one with files is kept until the room is needed.

    Parameters
    ----------
    boards : tuple of str
        Backends that are boards, ``board:HOST``, offered in every session.
    """

    def __init__(self, boards: tuple[str, ...] = ()) -> None:
        self._boards = boards
        self._storage = Storage()
        self._open: WeakValueDictionary[str, Session] = WeakValueDictionary()
        self._queues = JobQueues()

    def get(self, identifier: str) -> Session:
        """The session with this identifier; a new one if there is none."""
        session = self._open.get(identifier)
        if session is None:
            session = self._open[identifier] = Session(self._storage, self._queues, self._boards)
        return session

    def close(self) -> None:
        """Cancel every job and remove every file."""
        for session in list(self._open.values()):
            session.close()
        self._storage.close()
