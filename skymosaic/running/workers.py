"""Runs independent calls at once: on the threads of this machine, or on a Dask cluster."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from skymosaic.imagery.photographs import Source
from skymosaic.running.cluster import Cluster

CALLS_PER_WORKER = 8
"""Calls ahead of the one whose result is awaited: enough to keep all workers busy while the caller writes what is done,
few enough to bound the memory of finished results."""
CPU_SHARE = Path("/sys/fs/cgroup/cpu.max")
"""A container's share of the processors: microseconds of processor time, or max, per how many microseconds."""

Result = TypeVar("Result")
Progress = Callable[[str, int, int], None]
"""Receives a stage, how many of its steps are done, and how many there are (0: unknown)."""


class _BlasLimit:
    """Keeps BLAS, whose threads are those of the whole process, to one while at least one `Workers` is in use."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._users = 0

    def acquire(self) -> None:
        """Add a user."""
        with self._lock:
            if self._users == 0:
                self._limits = threadpool_limits(1, user_api="blas")
            self._users += 1

    def release(self) -> None:
        """Remove a user; after the last one BLAS has as many threads as before."""
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._limits.restore_original_limits()


_blas_limit = _BlasLimit()


def silent(_stage: str, _done: int, _total: int) -> None:
    """No-op progress callback."""


class _Threads:
    """The threads of this process, one for each core, with the methods of `Cluster`."""

    def __init__(self) -> None:
        self.threads = _cores()
        self._executor = ThreadPoolExecutor(self.threads)
        self.close = self._executor.shutdown

    def submit(self, function: Callable[..., Any], arguments: tuple[Any, ...], _kept: Sequence[str]) -> Any:
        return self._executor.submit(function, *arguments)

    def result(self, future: Any, _what: str) -> Any:
        return future.result()


class Workers:
    """Threads of this process, or the workers of a Dask cluster; a context manager.

    Results depend neither on the kind of workers nor on their number.

    Parameters
    ----------
    address : str or None
        Of a Dask scheduler, see `skymosaic.running.cluster.Cluster`; None: threads.
    progress : callable
        Called after each call.
    sources, memory_bytes
        What the workers of a cluster must be able to read and keep.

    Raises
    ------
    InputError
        If the cluster cannot be reached or used, or the package for it is missing.
    """

    def __init__(
        self,
        address: str | None = None,
        *,
        progress: Progress = silent,
        sources: Sequence[Source] = (),
        memory_bytes: int = 0,
    ) -> None:
        self.progress = progress
        self._pool: Cluster | _Threads = (
            Cluster(address, lambda line: progress(line, 0, 0), sources, memory_bytes) if address else _Threads()
        )
        # Each core has a thread of ours. More of them would wait in turns, and a BLAS spins while it waits.
        _blas_limit.acquire()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        self._pool.close()
        _blas_limit.release()

    @property
    def are_elsewhere(self) -> bool:
        """Whether they may see other files than this process."""
        return isinstance(self._pool, Cluster)

    def run(
        self,
        stage: str,
        function: Callable[..., Result],
        arguments: Sequence[tuple[Any, ...]],
        *,
        kept: Sequence[str] = (),
    ) -> Iterator[Result]:
        """Call ``function(*each)`` for each of ``arguments``; results come in order, while workers go on.

        The attributes ``kept`` of a result stay with the worker of a cluster that computed it. Arguments of later calls
        may be such attributes, and run near them.
        """
        pending: deque[Any] = deque()
        submitted = 0
        try:
            for done, each in enumerate(arguments, start=1):
                # Counted again: workers of a cluster come and go.
                if done % CALLS_PER_WORKER == 1:
                    ahead = CALLS_PER_WORKER * max(self._pool.threads, 1)
                for later in arguments[submitted : done - 1 + ahead]:
                    pending.append(self._pool.submit(function, later, kept))
                submitted = max(submitted, min(done - 1 + ahead, len(arguments)))
                names = [str(argument.name) for argument in each if hasattr(argument, "name")]
                yield self._pool.result(pending.popleft(), f"{stage} of {', '.join(names)}" if names else stage)
                self.progress(stage, done, len(arguments))
        finally:
            for future in pending:
                future.cancel()


def _cores() -> int:
    """Processors that this process may use; in a container, no more than its share of them."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = CPU_SHARE.read_text(encoding="ascii").split()
        return cores if quota == "max" else min(cores, math.ceil(int(quota) / int(period)))
    except (OSError, ValueError):
        return cores
