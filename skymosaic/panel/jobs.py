"""Long work in a process of its own: progress while it runs, and an end at any moment.

A thread inside OpenCV or a compiled simulator cannot be stopped, a process can: cancelling kills the worker with all
that it started, compilers included.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from sim.backend import BackendError
from skymosaic.errors import InputError, RegistrationError

# Workers are forked from a helper that has imported the libraries once and shares nothing else with the server.
_processes = multiprocessing.get_context("forkserver")

Work = Callable[..., Any]
"""A module's function, called in the worker with its arguments and ``progress``; arguments and result are pickled."""


class JobFailedError(Exception):
    """The work ended without a result; the line says why."""


class JobCancelledError(Exception):
    """The work was ended from outside."""


def prepare_workers() -> None:
    """Start the helper that workers are forked from, so that the first job need not wait for its imports."""
    _processes.set_forkserver_preload(
        ["skymosaic.panel.mosaic_tasks", "skymosaic.panel.tracking_tasks", "skymosaic.panel.upload_tasks"]
    )
    forkserver.ensure_running()


class Job:
    """One piece of work that runs once.

    Parameters
    ----------
    title : str
        What is running, for people.
    folder : Path
        The worker's current folder.
    work : callable
    *arguments
        Of ``work``.

    Attributes
    ----------
    line : str
        The latest line of progress.
    """

    def __init__(self, title: str, folder: Path, work: Work, *arguments: object) -> None:
        self.title = title
        self.line = "waiting for a free worker"
        self._task = (folder, work, arguments)
        self._process: BaseProcess | None = None
        self._created = time.monotonic()
        self._cancelled = asyncio.Event()

    @property
    def seconds(self) -> float:
        """Time since it was created."""
        return time.monotonic() - self._created

    async def run(self, turns: asyncio.Semaphore) -> Any:
        """Do the work in its turn and return its result.

        Raises
        ------
        JobFailedError
            With the work's own line for an expected fault, or with how the worker died.
        JobCancelledError
            If `cancel` was called, before or meanwhile.
        """
        async with turns:
            if self._cancelled.is_set():
                raise JobCancelledError
            self.line = "starting"
            receiver, sender = _processes.Pipe(duplex=False)
            with receiver:
                process = _processes.Process(target=_worker, args=(sender, *self._task))
                with sender:
                    await self._start(process)
                if self._cancelled.is_set():
                    self.cancel()
                try:
                    return await self._outcome(receiver)
                finally:
                    await asyncio.to_thread(process.join)

    def cancel(self) -> None:
        """End the work now, with every process it started."""
        self._cancelled.set()
        if self._process is not None and self._process.pid is not None:
            # The worker leads a group of its own from its first instruction on; before that it has no children.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.kill()

    async def _start(self, process: BaseProcess) -> None:
        try:
            await asyncio.to_thread(process.start)
        except (EOFError, OSError):
            # The helper has been killed; the next worker starts another.
            raise JobFailedError("no worker could be started (out of memory?); try again") from None
        self._process = process

    async def _outcome(self, receiver: Connection) -> Any:
        while True:
            try:
                kind, value = await asyncio.to_thread(receiver.recv)
            except EOFError:
                if self._cancelled.is_set():
                    raise JobCancelledError from None
                raise JobFailedError("the worker died (out of memory?); try smaller photographs") from None
            if kind == "done":
                return value
            if kind == "failed":
                raise JobFailedError(value)
            self.line = value


def _worker(sender: Connection, folder: Path, work: Work, arguments: tuple[object, ...]) -> None:
    os.setsid()
    os.chdir(folder)

    def progress(line: str) -> None:
        sender.send(("progress", line))

    try:
        outcome = "done", work(*arguments, progress=progress)
    except (InputError, RegistrationError, BackendError) as error:
        outcome = "failed", str(error)
    except Exception as error:
        traceback.print_exc()
        outcome = "failed", f"unexpected {type(error).__name__}: {error}; the panel's terminal shows where"
    sender.send(outcome)
