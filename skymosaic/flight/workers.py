"""Runs independent calls at once: on the threads of this machine, or on a Dask cluster."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import TracebackType
from typing import Any, TypeVar

from dask import threaded
from dask.base import compute
from dask.delayed import delayed
from dask.system import CPU_COUNT

from skymosaic.errors import InputError

CALLS_A_WORKER = 8
"""Calls for each worker in one graph: enough to keep it busy, few enough to bound the memory of pending results."""
CONNECT_TIMEOUT_S = 10

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
        Of a Dask scheduler (``tcp://host:8786``), whose workers see the photographs under the same paths and have
        skymosaic installed; None: threads.
    progress : callable
        Called after each batch of calls.

    Raises
    ------
    InputError
        If the cluster cannot be reached, or the package for it is missing.
    """

    def __init__(self, address: str | None = None, *, progress: Progress = silent) -> None:
        self._client = _connected(address) if address else None
        self.progress = progress

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        if self._client is not None:
            self._client.close()

    def run(
        self, stage: str, function: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Result]:
        """``function(*each)`` for each of ``arguments``, in their order, as batches of them are done."""
        # Named "threads", the scheduler would first import the whole package for clusters.
        scheduler = self._client or threaded.get
        batch = CALLS_A_WORKER * self._count()
        for start in range(0, len(arguments), batch):
            # Bound beforehand: Dask looks for its own objects inside the arguments of a call, which takes long.
            calls = [delayed(partial(function, *each), pure=False)() for each in arguments[start : start + batch]]
            yield from compute(*calls, scheduler=scheduler)
            self.progress(stage, min(start + batch, len(arguments)), len(arguments))

    def _count(self) -> int:
        return sum(self._client.nthreads().values()) if self._client is not None else CPU_COUNT


def _connected(address: str) -> Any:
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise InputError("a cluster needs the package distributed; pip install 'skymosaic[cluster]'") from None
    try:
        return distributed.Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{address}: no Dask scheduler answers ({error}); check the address") from None
