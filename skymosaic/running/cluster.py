"""Runs calls on a Dask cluster: checks its workers first, and says what is wrong with those that are lost."""

import asyncio
import contextlib
import importlib
import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from golden_model.code_digest import digest_code
from golden_model.small_files import read_small_file
from golden_model.text import how_to_install, one_line
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.features.backends import BACKENDS
from skymosaic.imagery.decoding import read_header
from skymosaic.imagery.photographs import Source
from skymosaic.running.cache import versions

LIMIT = "distributed.comm.timeouts.connect"
"""Dask's own setting for how long to wait, also for a first worker and for the return of lost ones."""
CONNECT_TIMEOUT_S = 10
POLL_SECONDS = 1.0
PROCESS_BYTES = 150 << 20
"""A worker with all its libraries, measured."""
CALL_BYTES, COPIES = 100 << 20, 2
"""A call works on the reduced photograph; decoding it, at 16 bits, takes twice its size (docs/measured/photographs)."""


class Cluster:
    """A connection to a Dask scheduler, by its address (``tcp://host:8786``) or a scheduler file.

    Every worker must be able to read the sources, and have memory for them; it keeps decoded photographs of at most
    ``memory_bytes``. ``tell`` receives a line when workers have to be waited for, and the address of the dashboard.

    Raises
    ------
    InputError
        If no scheduler answers, no worker comes, or a worker does not fit, with its address and the cause.
    """

    def __init__(
        self, address: str, tell: Callable[[str], None], sources: Sequence[Source] = (), memory_bytes: int = 0
    ) -> None:
        self._name, self._tell = address, tell
        self._client = _connect(address)
        self._future = importlib.import_module("distributed").Future
        try:
            self._await_workers(InputError, "start a worker")
            self._check_workers(sources)
            self._check_memory(sources, memory_bytes)
            # A scheduler may run without one.
            with contextlib.suppress(KeyError):
                tell(f"{address}: dashboard {self._client.dashboard_link}")
        except BaseException:
            self.close()
            raise

    @property
    def _limit_s(self) -> float:
        """Seconds by Dask's setting, `LIMIT`."""
        dask = importlib.import_module("dask")
        return float(importlib.import_module("dask.utils").parse_timedelta(dask.config.get(LIMIT)))

    @property
    def threads(self) -> int:
        """Threads of all workers now; 0 if there is none, or no scheduler."""
        if self._client.status != "running":
            return 0
        try:
            return sum(self._within_limit(self._client.nthreads).values())
        # The scheduler may vanish or hang meanwhile.
        except Exception:
            return 0

    def submit(self, function: Callable[..., Any], arguments: tuple[Any, ...], kept: Sequence[str] = ()) -> Any:
        """Start a call; returns what `result` waits for.

        The attributes ``kept`` of its result stay with the worker. Dask's futures take their places, which may be
        arguments of later calls.
        """
        if not any(isinstance(each, self._future) for each in arguments):
            # Bound beforehand: Dask searches the arguments of a call for its own objects, which takes long.
            function, arguments = partial(function, *arguments), ()
        whole = self._client.submit(function, *arguments, pure=False)
        if not kept:
            return whole
        parts = {name: self._client.submit(getattr, whole, name, None, pure=False) for name in kept}
        return _Split(self._client.submit(_with, whole, dict.fromkeys(kept), pure=False), parts)

    def result(self, future: Any, what: str) -> Any:
        """Wait for the result of a call, as long as there are workers.

        Raises
        ------
        RegistrationError
            If scheduler or workers are gone for too long, or if the call ends its workers; ``what`` names the call.
        """
        if isinstance(future, _Split):
            rest = self.result(future.rest, what)
            return _with(rest, future.kept)
        while True:
            try:
                return future.result(timeout=POLL_SECONDS)
            except TimeoutError:
                if not self.threads:
                    self._await_workers(RegistrationError, "restart it; what was computed is in the cache")
            except asyncio.CancelledError:
                raise self._gone() from None
            # The package that defines them is an extra.
            except Exception as error:
                if _kind(error) == "KilledWorker":
                    killed: Any = error
                    last = killed.last_worker
                    raise RegistrationError(
                        f"{what}: ended {killed.allowed_failures + 1} workers, the last one {last.address} with "
                        f"{last.memory_limit >> 20} MB of memory; give the workers more, or reduce the photographs"
                    ) from None
                if _kind(error) in ("FutureCancelledError", "CancelledError", "CommClosedError"):
                    raise self._gone() from None
                raise

    def close(self) -> None:
        """Cancel what runs, and disconnect."""
        with contextlib.suppress(Exception):
            self._client.close(timeout=2)

    def _gone(self) -> RegistrationError:
        return RegistrationError(
            f"{self._name}: the scheduler is gone; start it and run again: what was computed is in the cache"
        )

    def _await_workers(self, kind: type[Exception], advice: str) -> None:
        """Wait for a worker as long as Dask's setting allows, and say so."""
        deadline = time.monotonic() + self._limit_s
        if not self.threads:
            self._tell(f"{self._name} has no worker; waiting {self._limit_s:g} s for one")
        while not self.threads:
            if time.monotonic() > deadline:
                raise kind(f"{self._name}: no worker within {self._limit_s:g} s; {advice}")
            time.sleep(POLL_SECONDS / 5)

    def _check_workers(self, sources: Sequence[Source]) -> None:
        """Check that every worker has the packages of this process, and can read a photograph of each folder."""
        contents = [each.content for each in _files(sources) if isinstance(each.content, Path)]
        # What this process cannot read either is left out later.
        paths = {content.parent: str(content) for content in contents if os.access(content, os.R_OK)}
        mine = describe_environment()
        try:
            # An exception for each that cannot answer.
            answers = self._within_limit(self._client.run, inspect_worker, list(paths.values()), on_error="return")
        except TimeoutError:
            raise InputError(f"{self._name}: a worker does not answer within {self._limit_s:g} s; end it") from None
        for worker, found in answers.items():
            if _kind(found) == "CommClosedError":
                # Lost before it answered, perhaps still starting, as it may be at any time later.
                continue
            if isinstance(found, BaseException):
                raise InputError(f"{worker}: skymosaic cannot be imported ({one_line(repr(found))}); install it there")
            theirs, unreadable = found
            other = next((name for name in mine if theirs.get(name) != mine[name]), None)
            if other:
                raise InputError(
                    f"{worker}: has {other} {theirs.get(other)} and this process {mine[other]}; install the same there"
                )
            if unreadable:
                raise InputError(f"{worker}: cannot read {unreadable[0]}; mount the folder there under the same path")

    def _check_memory(self, sources: Sequence[Source], memory_bytes: int) -> None:
        """Check that every worker has memory for the largest step: photographs that it keeps, and those in work."""
        sizes = [_decoded_bytes(each) for each in _files(sources)] or [0]
        kept_bytes, in_work_bytes = min(memory_bytes, sum(sizes)), CALL_BYTES + COPIES * max(sizes)
        for worker, facts in self._client.scheduler_info(n_workers=-1)["workers"].items():
            limit = facts.get("memory_limit") or 0
            needed = PROCESS_BYTES + kept_bytes + facts["nthreads"] * in_work_bytes
            if 0 < limit < needed:
                raise InputError(
                    f"{worker}: has {limit >> 20} MB of memory for {facts['nthreads']} threads, and the largest step "
                    f"needs {needed >> 20}; give it more, or lower `memory_bytes`"
                )

    def _within_limit(self, method: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """Call a method of the client, most of which would wait for a process that hangs for ever."""

        async def call() -> Any:
            return await method(*arguments, **options)

        return self._client.sync(call, callback_timeout=self._limit_s)


@dataclass(frozen=True)
class _Split:
    """Futures of a result without some attributes, and of these."""

    rest: Any
    kept: Mapping[str, Any]

    def cancel(self) -> None:
        self.rest.cancel()


def _with(result: Any, attributes: Mapping[str, Any]) -> Any:
    """Replace attributes of a result; one that has none, as the reason for a failure, stays as it is."""
    return replace(result, **attributes) if is_dataclass(result) and not isinstance(result, type) else result


def _files(sources: Sequence[Source]) -> list[Source]:
    return [each for source in sources for each in (source.bands.values() or (source,))]


def _decoded_bytes(source: Source) -> int:
    """Size of a photograph's pixels; 0 for one that cannot be read, which is left out later."""
    if not isinstance(source.content, Path):
        return source.content.nbytes
    with contextlib.suppress(InputError):
        return read_header(source.content).decoded_bytes
    return 0


def describe_environment() -> dict[str, str]:
    """What must be the same in every process for the same result."""
    code = digest_code("skymosaic", *BACKENDS.values())
    return {"Python": platform.python_version(), **versions(), "code": code[:12]}


def inspect_worker(paths: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """The environment of this process, and which of the files it cannot read; called on the workers."""
    return describe_environment(), [path for path in paths if not os.access(path, os.R_OK)]


def _kind(error: object) -> str:
    """Name of an error's class; the package that defines it is an extra."""
    return type(error).__name__


def _connect(address: str) -> Any:
    try:
        # An extra, and slow to import.
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise InputError(f"a cluster needs the package distributed; {how_to_install('cluster')}") from None
    try:
        if Path(address).is_file():
            address = _read_address(address)
        # Beforehand: a client that finds no scheduler waits for 20 s when it is removed, and prints a traceback.
        asyncio.run(_reach(distributed, address))
        return distributed.Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    # What is wrong with an address or a protocol decides the kind of error: TypeError, RuntimeError and others.
    except Exception as error:
        reason = one_line(str(error)) or f"nothing that speaks its protocol within {CONNECT_TIMEOUT_S} s"
        raise InputError(f"{address}: no Dask scheduler answers ({reason}); check the address") from None


def _read_address(path: str) -> str:
    """Address in a scheduler's file, which is empty for a moment after the scheduler made it."""
    deadline = time.monotonic() + CONNECT_TIMEOUT_S
    while not (text := read_small_file(path)) and time.monotonic() < deadline:
        time.sleep(POLL_SECONDS / 5)
    return str(json.loads(text)["address"])


async def _reach(distributed: Any, address: str) -> None:
    """Connect as a client does; an error of any kind if nothing there speaks Dask's protocol."""
    options = distributed.Security().get_connection_args("client")
    # The limit of `connect` does not cover what follows the connection: a web server waits for a request.
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        comm = await distributed.comm.connect(address, timeout=CONNECT_TIMEOUT_S, **options)
    comm.abort()
