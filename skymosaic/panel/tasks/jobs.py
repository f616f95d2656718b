"""Long tasks, each in a process of its own: they report progress while they run and can be cancelled at any moment.

A thread inside OpenCV or a compiled simulator cannot be stopped, but a process can: cancelling a job kills its worker
and everything the worker started, compilers included.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import importlib.util
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from sim.backends.interface import BackendError
from skymosaic.errors import InputError, RegistrationError
from skymosaic.panel.steps import Steps

# Workers are forked from a helper process that has imported the libraries once and shares nothing else with the server.
_processes = multiprocessing.get_context("forkserver")

Task = Callable[..., Any]
"""A function of a module, called in the worker as ``task(folder, *arguments, progress=progress)``.

Arguments and result are pickled, so they must be importable and picklable.
"""


@dataclass(frozen=True)
class Limits:
    """What a worker may use.

    Attributes
    ----------
    processor_seconds : int
        Of all its threads.
    seconds : float
        From its start to its result.
    memory_bytes : int
        Address space beyond what it has at its start.
    """

    processor_seconds: int
    seconds: float
    memory_bytes: int


class JobFailedError(Exception):
    """The task ended without a result; the message is one line that says why."""


class JobCancelledError(Exception):
    """The job was cancelled."""


def prepare_workers() -> None:
    """Start the helper process that workers are forked from, so that the first job does not wait for its imports."""
    _processes.set_forkserver_preload(
        [
            "skymosaic.panel.tasks.mosaic_tasks",
            "skymosaic.panel.tasks.tracking_tasks",
            "skymosaic.panel.tasks.upload_tasks",
        ]
    )
    forkserver.ensure_running()


class Job:
    """A task that runs once, in a worker process.

    Parameters
    ----------
    title : str
        What is running, as the page shows it.
    task : callable
    folder : Path
        Where the task reads and writes; its first argument. Failure messages name files relative to it.
    *arguments
        Further arguments of ``task``.
    limits : Limits or None
        None: until it is cancelled.

    Attributes
    ----------
    line : str
        The latest line of progress.
    steps : Steps
        How much of the present stage is done.
    """

    def __init__(self, title: str, task: Task, folder: Path, *arguments: object, limits: Limits | None = None) -> None:
        self.title = title
        self.line = "waiting for a free worker"
        self.steps = Steps()
        self._call = (limits, task, folder, arguments)
        self._limits = limits
        self._process: BaseProcess | None = None
        self._has_result = False
        self._created = time.monotonic()
        self._cancelled = asyncio.Event()

    @property
    def seconds(self) -> float:
        """Seconds since the job was created."""
        return time.monotonic() - self._created

    async def run(self, queue: asyncio.Semaphore) -> Any:
        """Wait in the queue for a free worker, run the task and return its result.

        Raises
        ------
        JobFailedError
            With the task's own message for an expected error, otherwise with how the worker ended.
        JobCancelledError
            If `cancel` was called, before the task started or while it ran.
        """
        async with queue:
            if self._cancelled.is_set():
                raise JobCancelledError
            self.line = "starting"
            receiver, sender = _processes.Pipe(duplex=False)
            with receiver:
                process = _processes.Process(target=_run_in_worker, args=(sender, *self._call))
                # The server's copy of the sending end must be closed, otherwise a dead worker is never noticed.
                with sender:
                    await self._start(process)
                # `cancel` may have been called while the process started and found none to kill.
                if self._cancelled.is_set():
                    self.cancel()
                try:
                    seconds = self._limits.seconds if self._limits else None
                    async with asyncio.timeout(seconds):
                        return await self._receive_result(receiver)
                except TimeoutError:
                    raise JobFailedError(f"it takes more than {seconds:g} s; try a smaller file") from None
                finally:
                    # Only a worker that has ended by itself outlives this line, for a moment.
                    if process.exitcode is None and not self._has_result:
                        self.cancel()
                    await asyncio.to_thread(process.join)

    def cancel(self) -> None:
        """End the task now, together with every process it started."""
        self._cancelled.set()
        if self._process is not None and self._process.pid is not None:
            # The worker's first instruction makes it the leader of a process group; before that it has no children.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.kill()

    async def _start(self, process: BaseProcess) -> None:
        try:
            await asyncio.to_thread(process.start)
        except (EOFError, OSError):
            # The helper process was killed; the next job starts a new one.
            raise JobFailedError("no worker could be started (out of memory?); try again") from None
        self._process = process

    async def _receive_result(self, receiver: Connection) -> Any:
        while True:
            try:
                kind, value = await asyncio.to_thread(receiver.recv)
            except EOFError:
                if self._cancelled.is_set():
                    raise JobCancelledError from None
                raise JobFailedError(await self._why_it_died()) from None
            self._has_result = kind != "progress"
            if kind == "done":
                return value
            if kind == "failed":
                raise JobFailedError(value)
            self.line = value
            self.steps.follow(value)

    async def _why_it_died(self) -> str:
        assert self._process is not None
        await asyncio.to_thread(self._process.join)
        if self._limits and self._process.exitcode == -getattr(signal, "SIGXCPU", 0):
            return f"it takes more than {self._limits.processor_seconds} s of processor time; try a smaller file"
        return "the worker died (out of memory?); try smaller photographs"


def _confine(limits: Limits) -> None:
    """Set limits that the system enforces, where it knows them."""
    if importlib.util.find_spec("resource") is None:
        return
    resource = importlib.import_module("resource")
    # One second more for the signal that cannot be ignored.
    resource.setrlimit(resource.RLIMIT_CPU, (limits.processor_seconds, limits.processor_seconds + 1))
    with contextlib.suppress(OSError):
        # The libraries that are loaded already have reserved far more than they use.
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + limits.memory_bytes
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _run_in_worker(
    sender: Connection, limits: Limits | None, task: Task, folder: Path, arguments: tuple[object, ...]
) -> None:
    os.setsid()
    if limits is not None:
        _confine(limits)

    def progress(line: str) -> None:
        sender.send(("progress", line))

    try:
        message = "done", task(folder, *arguments, progress=progress)
    except (InputError, RegistrationError, BackendError) as error:
        # The page shows the message: it must not reveal where on this machine the file lies.
        message = "failed", str(error).replace(f"{folder}{os.sep}", "")
    except MemoryError:
        message = "failed", "it needs more memory than one file may take; try a smaller one"
    except Exception as error:
        traceback.print_exc()
        message = "failed", f"unexpected {type(error).__name__}: {error}; the traceback is in the panel's terminal"
    sender.send(message)
