"""Runs independent calls at once: on the threads of this machine, or on a Dask cluster."""

from __future__ import annotations

import asyncio
import importlib
import math
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from golden_model.text import how_to_install, one_line
from skymosaic.errors import InputError

CALLS_PER_WORKER = 8
"""Calls ahead of the one whose result is awaited: enough to keep all workers busy while the caller writes what is done,
few enough to bound the memory of finished results."""
CONNECT_TIMEOUT_S = 10
CPU_SHARE = Path("/sys/fs/cgroup/cpu.max")
"""A container's share of the processors: microseconds of processor time, or max, per how many microseconds."""

Result = TypeVar("Result")
Progress = Callable[[str, int, int], None]
"""Receives a stage, how many of its steps are done, and how many there are (0: unknown)."""


def silent(_stage: str, _done: int, _total: int) -> None:
    """No-op progress callback."""


class Workers:
    """Threads of this process, or the workers of a Dask cluster; a context manager.

    Results depend neither on the kind of workers nor on their number.

    Parameters
    ----------
    address : str or None
        Address of a Dask scheduler (``tcp://host:8786``), whose workers see the photographs under the same paths and
        have skymosaic installed; None: threads.
    progress : callable
        Called after each call.

    Raises
    ------
    InputError
        If the cluster cannot be reached, or the package for it is missing.
    """

    def __init__(self, address: str | None = None, *, progress: Progress = silent) -> None:
        self._client = _connect(address) if address else None
        self._executor: Executor = (
            self._client.get_executor(pure=False) if self._client is not None else ThreadPoolExecutor(_cores())
        )
        self.progress = progress

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        self._executor.shutdown()
        if self._client is not None:
            self._client.close()

    def run(
        self, stage: str, function: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Result]:
        """Call ``function(*each)`` for each of ``arguments``; results come in order, while workers go on."""
        pending: deque[Future[Result]] = deque()
        ahead = CALLS_PER_WORKER * self._count()
        try:
            for each in arguments[:ahead]:
                pending.append(self._submit(function, each))
            for done in range(1, len(arguments) + 1):
                yield pending.popleft().result()
                if ahead + done <= len(arguments):
                    pending.append(self._submit(function, arguments[ahead + done - 1]))
                self.progress(stage, done, len(arguments))
        finally:
            for future in pending:
                future.cancel()

    def _submit(self, function: Callable[..., Result], arguments: tuple[Any, ...]) -> Future[Result]:
        # Bound beforehand: Dask searches the arguments of a call for its own objects, which takes long.
        return self._executor.submit(partial(function, *arguments))

    def _count(self) -> int:
        return sum(self._client.nthreads().values()) if self._client is not None else _cores()


def _cores() -> int:
    """Processors that this process may use; in a container, no more than its share of them."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = CPU_SHARE.read_text(encoding="ascii").split()
        return cores if quota == "max" else min(cores, math.ceil(int(quota) / int(period)))
    except (OSError, ValueError):
        return cores


def _connect(address: str) -> Any:
    try:
        # An extra, and slow to import.
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise InputError(f"a cluster needs the package distributed; {how_to_install('cluster')}") from None
    try:
        # Beforehand: a client that finds no scheduler waits for 20 s when it is removed, and prints a traceback.
        asyncio.run(_reach(distributed, address))
        return distributed.Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    # What is wrong with an address or a protocol decides the kind of error: TypeError, RuntimeError and others.
    except Exception as error:
        reason = one_line(str(error)) or f"nothing that speaks its protocol within {CONNECT_TIMEOUT_S} s"
        raise InputError(f"{address}: no Dask scheduler answers ({reason}); check the address") from None


async def _reach(distributed: Any, address: str) -> None:
    """Connect as a client does; an error of any kind if nothing there speaks Dask's protocol."""
    options = distributed.Security().get_connection_args("client")
    # The limit of `connect` does not cover what follows the connection: a web server waits for a request.
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        comm = await distributed.comm.connect(address, timeout=CONNECT_TIMEOUT_S, **options)
    comm.abort()
