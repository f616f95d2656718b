"""Runs long tasks in processes of their own, which report progress and can be cancelled at any moment.

A thread inside OpenCV or a compiled simulator cannot be stopped, but a process can: cancelling a job kills its worker
and everything the worker started, compilers included.
"""

import asyncio
import importlib
import multiprocessing
import os
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Protocol

from golden_model.text import one_line
from sim.backends.errors import BackendError
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.panel.tasks.containment import IS_POSIX, end_group, lead_group, limit_worker, took_too_long

# Workers are forked from a helper process that has imported the libraries once and shares nothing else with the server.
# Where nothing forks, each imports them itself.
_processes: Any = multiprocessing.get_context("forkserver" if IS_POSIX else "spawn")

MAX_SOCKET_FOLDER = 86
"""Bytes: the path of a socket has 104 on some systems, and multiprocessing adds 17."""
MIN_SECONDS = 1.0
"""No estimate of the time left until a stage has run for this long."""
Task = Callable[..., Any]
"""A function of a module, called in the worker as ``task(folder, *arguments, progress=progress)``.

Arguments and result must be picklable; ``progress`` is a `Progress`.
"""


class Progress(Protocol):
    """Takes a line of progress, or a stage with the number of its steps, done and in total."""

    def __call__(self, line: str, done: int = 0, total: int = 0, /) -> None:
        """Report progress."""


class Steps:
    """How many steps of the current stage are ``done``, and the seconds left in it."""

    def __init__(self) -> None:
        self.done, self._total = 0, 0
        self._stage, self._started, self._done_at_start = "", 0.0, 0

    @property
    def share(self) -> float | None:
        """Share that is done, 0 to 1; None while the stage has no steps."""
        return self.done / self._total if self._total else None

    def follow(self, stage: str, done: int, total: int) -> None:
        """Note the progress of a stage; ``total`` is 0 if it has no steps."""
        self.done, self._total = done, total
        if stage != self._stage:
            self._stage, self._started, self._done_at_start = stage, time.monotonic(), done

    def seconds_left(self) -> float | None:
        """Estimate the time left from the steps of this stage so far; None without enough of them."""
        seconds, steps = time.monotonic() - self._started, self.done - self._done_at_start
        if self.share is None or steps < 1 or seconds < MIN_SECONDS:
            return None
        return seconds / steps * (self._total - self.done)


@dataclass(frozen=True)
class Limits:
    """What a worker may use: seconds until its result, and address space beyond what it has at its start.

    The wall time also contains waiting for other workers; what a file may cost is ``processor_seconds``. Memory is not
    limited everywhere, see `skymosaic.panel.tasks.containment.MISSING_LIMITS`.
    """

    seconds: float
    processor_seconds: int
    memory_bytes: int


class JobFailedError(Exception):
    """The task ended without a result; the message is one line that says why."""


class JobCancelledError(Exception):
    """The job was cancelled."""


def prepare_workers(folder: Path | None = None) -> None:
    """Start the helper process that workers are forked from, so that the first job does not wait for its imports.

    Its socket lies in ``folder``, or in the system's temporary folder, where a killed server would leave it. Where
    nothing forks there is no helper.
    """
    if not IS_POSIX:
        return
    tasks = ("mosaic_tasks", "tracking_tasks", "upload_tasks")
    _processes.set_forkserver_preload([f"skymosaic.panel.tasks.{name}" for name in tasks])
    if folder is not None and len(os.fsencode(folder)) <= MAX_SOCKET_FOLDER:
        # There is no public way. A folder that multiprocessing makes itself it also removes, after ours has gone.
        multiprocessing.current_process()._config["tempdir"] = str(folder)  # type: ignore[attr-defined]
    importlib.import_module("multiprocessing.forkserver").ensure_running()


class Job:
    """A task that runs once, in a worker process; without limits, until it is cancelled.

    The title says what is running, as the page shows it. The task reads and writes in ``folder``, its first argument,
    and failure messages name files relative to it.
    """

    def __init__(self, title: str, task: Task, folder: Path, *arguments: object, limits: Limits | None = None) -> None:
        self.title = title
        self.line = "waiting for a free worker"
        """The latest line of progress."""
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
                    raise JobFailedError(f"took more than {seconds:g} s; try a smaller file") from None
                finally:
                    # A worker that has sent its result is about to end by itself; any other is ended.
                    if process.exitcode is None and not self._has_result:
                        self.cancel()
                    await asyncio.to_thread(process.join)

    def cancel(self) -> None:
        """End the task now, together with every process it started."""
        self._cancelled.set()
        if self._process is not None and self._process.pid is not None:
            # The worker's first instruction makes it the leader of a process group; before that it has no children.
            end_group(self._process.pid)
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
                assert self._process is not None
                await asyncio.to_thread(self._process.join)
                if self._limits is not None and took_too_long(self._process.exitcode):
                    limit = self._limits.processor_seconds
                    raise JobFailedError(f"took more than {limit} s of processor time; try a smaller file") from None
                # Without a message: killed from outside, by the system for its memory, or by a fault in a library.
                raise JobFailedError("the worker died (out of memory?); try smaller photographs") from None
            self._has_result = kind != "progress"
            if kind == "done":
                return value
            if kind == "failed":
                raise JobFailedError(value)
            self.line, done, total = value
            self.steps.follow(self.line, done, total)
            if total:
                self.line += f": {done} of {total}"


def _end_with_server() -> None:
    """Wait for the server's death, which a killed one does not announce, and end the worker and all that it started."""
    server = multiprocessing.parent_process()
    assert server is not None
    server.join()
    end_group(os.getpid())
    # Without groups, the worker may be gone before what ends it.
    os._exit(1)


def _run_in_worker(
    sender: Connection, limits: Limits | None, task: Task, folder: Path, arguments: tuple[object, ...]
) -> None:
    lead_group()
    threading.Thread(target=_end_with_server, daemon=True).start()
    if limits is not None:
        limit_worker(limits.processor_seconds, limits.memory_bytes)

    def progress(line: str, done: int = 0, total: int = 0) -> None:
        sender.send(("progress", (one_line(line), done, total)))

    try:
        message = "done", task(folder, *arguments, progress=progress)
    except (InputError, RegistrationError, BackendError) as error:
        # The page shows the message: it must not reveal where on this machine the file lies.
        message = "failed", str(error).replace(one_line(f"{folder}{os.sep}"), "")
    except MemoryError:
        message = "failed", "needs more memory than one file may take; try a smaller one"
    except Exception as error:
        traceback.print_exc()
        fault = one_line(f"unexpected {type(error).__name__}: {error}")
        message = "failed", f"{fault}; the traceback is in the panel's terminal"
    sender.send(message)
