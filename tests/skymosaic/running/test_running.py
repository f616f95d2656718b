"""Keys of the cache, and calls in threads."""

import ast
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from golden_model.code_digest import digest_each
from skymosaic.common.errors import InputError
from skymosaic.flight.linking.links import link_views
from skymosaic.flight.linking.view import describe, describe_thumbnail
from skymosaic.running import workers as flight_workers
from skymosaic.running.cache import key_of, open_cache
from skymosaic.running.workers import Workers


def test_keys_change_with_every_part_and_with_the_code(monkeypatch: pytest.MonkeyPatch) -> None:
    assert key_of(describe, 1, "a") == key_of(describe, 1, "a")
    keys = [key_of(describe, 1, "a"), key_of(describe, 1, "b"), key_of(describe, "1", "a"), key_of(link_views, 1, "a")]
    assert len({*keys, key_of(describe_thumbnail, 1, "a")}) == 5
    monkeypatch.setattr("skymosaic.running.cache.digest_code", lambda module: f"changed {module}")
    assert key_of(describe, 1, "a") not in keys
    assert key_of(describe, 1, "a") != key_of(link_views, 1, "a")


LOADED = """
import sys
import numpy as np
from golden_model.config import Config
from skymosaic.flight.linking.view import Settings, describe
from skymosaic.imagery.photographs import Source

describe(Source(0, "image", np.zeros((64, 64), np.uint8)), Settings(Config()))
print(*(name for name in sys.modules if name.partition(".")[0] in ("golden_model", "hdl", "sim", "skymosaic")))
"""


def test_all_that_a_stage_loads_is_in_its_key() -> None:
    """The backend among it, which is imported by its name; without the hardware, which it does not load."""
    printed = subprocess.run([sys.executable, "-c", LOADED], check=True, capture_output=True, text=True).stdout
    in_key = digest_each(describe.__module__, "sim.backends.golden")
    assert {"sim.backends.golden", "golden_model.pixel.harris"} <= in_key.keys()
    assert not [name for name in in_key if name.startswith(("hdl", "skymosaic.maps", "skymosaic.compositing"))]
    for name in {*printed.split()} - in_key.keys() - {"skymosaic"}:
        (docstring,) = ast.parse(Path(*name.split("."), "__init__.py").read_text()).body
        assert isinstance(docstring, ast.Expr)


def test_a_folder_that_the_user_named_must_be_usable(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"cache: cannot be made \(Not a directory\); choose another cache"):
        open_cache(tmp_path / "file" / "cache", print)


def test_the_users_own_folder_that_cannot_be_used_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("skymosaic.running.cache.cache_folder", lambda: tmp_path / "file")
    lines: list[str] = []
    assert open_cache(None, lines.append).load("key") is None
    (line,) = lines
    assert line.startswith("note: features and links are not kept for the next run: ")
    assert line.endswith("flights: cannot be made (Not a directory)")


def test_results_come_in_order_while_further_calls_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_workers, "_cores", lambda: 2)
    started, fourth = [], threading.Event()

    def call(number: Any) -> Any:
        started.append(number)
        if number == 3:
            fourth.set()
        return number

    steps = []
    with Workers(progress=lambda *step: steps.append(step)) as workers:
        results = workers.run("stage", call, [(number,) for number in range(100)])
        assert next(results) == 0
        assert fourth.wait(timeout=60)  # while the first result is still in use
        assert [0, *results] == list(range(100))
    assert sorted(started) == list(range(100))
    assert steps[-1] == ("stage", 100, 100)


def test_calls_run_only_so_far_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_workers, "_cores", lambda: 1)
    started: list[int] = []
    with Workers() as workers:
        results: Any = workers.run("stage", started.append, [(number,) for number in range(100)])
        next(results)
        results.close()
    assert len(started) <= flight_workers.CALLS_PER_WORKER


def test_an_error_of_a_call_is_raised_where_its_result_is_due() -> None:
    def divided(number: Any) -> Any:
        return 1 // number

    with Workers() as workers, pytest.raises(ZeroDivisionError):
        list(workers.run("stage", divided, [(1,), (0,), (1,)]))


@pytest.mark.parametrize("address", ["ucx://127.0.0.1:1", "nonsense", "tls://127.0.0.1:1", "foo://127.0.0.1:1"])
def test_an_address_that_dask_cannot_use_is_one_line(address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match=rf"^{address}: no Dask scheduler answers \(.+\); check the address$"):
        Workers(address)


def test_what_does_not_speak_its_protocol_is_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("skymosaic.running.cluster.CONNECT_TIMEOUT_S", 1)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(InputError, match="nothing that speaks its protocol within 1 s"):
            Workers(address)


def test_blas_has_one_thread_while_workers_are_in_use() -> None:
    def blas_threads() -> list[int]:
        return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        with Workers() as workers:
            (inside,) = workers.run("stage", blas_threads, [()])
        assert before == blas_threads() == [2] * len(inside)
        assert set(inside) == {1}
        first, second = Workers(), Workers()
        first.__exit__(None, None, None)
        assert set(blas_threads()) == {1}
        second.__exit__(None, None, None)
        assert blas_threads() == before


@pytest.mark.parametrize(
    ("share", "cores"),
    [("max 100000", 6), ("150000 100000", 2), ("400000 100000", 4), ("900000 100000", 6), ("unknown", 6), (None, 6)],
)
def test_a_container_has_no_more_processors_than_its_share(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: str | None, cores: int
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(6), raising=False)
    monkeypatch.setattr(flight_workers, "CPU_SHARE", tmp_path / "cpu.max")
    if share is not None:
        (tmp_path / "cpu.max").write_text(share)
    assert flight_workers._cores() == cores
