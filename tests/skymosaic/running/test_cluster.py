"""Work and faults of a cluster, with a real scheduler and real workers, which are processes on this machine."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower
from skymosaic import mosaic
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.imagery.photographs import list_sources
from skymosaic.running.cluster import LIMIT, inspect_worker
from skymosaic.running.workers import Workers

dask = pytest.importorskip("dask")
psutil = pytest.importorskip("psutil")
distributed = pytest.importorskip("distributed")
ROOT = Path(__file__).parents[3]


class Processes:
    """A scheduler and its workers."""

    def __init__(self, folder: Path, allowed_failures: int) -> None:
        self.folder = folder
        self.started: list[subprocess.Popen[bytes]] = []
        self.file = folder / "scheduler.json"
        settings = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(allowed_failures)}
        self.scheduler = self.start("scheduler", "--port", "0", "--scheduler-file", self.file, **settings)
        while not self.file.exists():
            assert self.scheduler.poll() is None, (folder / "log").read_text()
            time.sleep(0.05)

    def start(
        self, kind: str, *options: object, before: Sequence[object] = (), **environment: str
    ) -> subprocess.Popen[bytes]:
        command = [*before, sys.executable, "-m", f"distributed.cli.dask_{kind}", *options, "--host", "127.0.0.1"]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
        with (self.folder / "log").open("ab") as log:
            self.started.append(
                subprocess.Popen(
                    [*map(str, command), "--no-dashboard"], cwd=self.folder, stdout=log, stderr=log, env=environment
                )
            )
        return self.started[-1]

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.started:
            process.kill()
            process.wait()

    def worker(self, *options: object, before: Sequence[object] = (), **environment: str) -> subprocess.Popen[bytes]:
        usual = ("--scheduler-file", self.file, "--nthreads", 1, "--no-nanny")
        return self.start("worker", *usual, *options, before=before, **environment)


@pytest.fixture
def cluster(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Processes]:
    # Also for the start of a worker on a busy machine.
    with Processes(tmp_path, getattr(request, "param", 3)) as processes, dask.config.set({LIMIT: "120s"}):
        yield processes


@pytest.fixture(scope="module")
def crew(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Processes]:
    """Two workers for tests that lose none."""
    with Processes(tmp_path_factory.mktemp("crew"), 3) as processes:
        for _ in range(2):
            processes.worker("--memory-limit", "1GB")
        yield processes


def connect(cluster: Processes, lines: list[str] | None = None, **options: Any) -> Workers:
    def progress(line: str, _done: int, total: int) -> None:
        if lines is not None and not total:
            lines.append(line)

    return Workers(str(cluster.file), progress=progress, **options)


def when(condition: Callable[[], bool], then: Callable[[], object]) -> threading.Thread:
    def wait() -> None:
        while not condition():
            time.sleep(0.05)
        then()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


def listeners() -> set[tuple[str, int]]:
    """Addresses at which this process listens; tests before this one may have left some."""
    return {each.laddr for each in psutil.Process().net_connections() if each.status == psutil.CONN_LISTEN}


def test_a_scheduler_without_workers_is_waited_for_and_one_that_dies_is_one_line(cluster: Processes) -> None:
    lines: list[str] = []
    with dask.config.set({LIMIT: "1s"}), pytest.raises(InputError, match="no worker within 1 s; start a worker"):
        connect(cluster, lines)
    assert "has no worker; waiting 1 s" in lines[0]
    # One that comes while it is waited for is used, and this process listens on nothing for it.
    before = listeners()
    late = when(lambda: len(lines) > 1, cluster.worker)
    with connect(cluster, lines) as workers:
        assert list(workers.run("powers", pow, [(2, n) for n in range(30)])) == [2**n for n in range(30)]
        assert listeners() <= before
        cluster.started[-1].kill()
        with dask.config.set({LIMIT: "1s"}), pytest.raises(RegistrationError, match="no worker within 1 s; restart it"):
            list(workers.run("powers", pow, [(2, 3)]))
        cluster.worker()
        results: Any = workers.run("sleeping", time.sleep, [(0.05,) for _ in range(100)])
        next(results)
        cluster.scheduler.kill()
        with dask.config.set({LIMIT: "2s"}), pytest.raises(RegistrationError, match=r"scheduler.json: .* the cache$"):
            list(results)
    late.join()


def test_a_scheduler_that_is_about_to_write_its_file_is_waited_for(crew: Processes, tmp_path: Path) -> None:
    path = tmp_path / "scheduler.json"
    path.touch()
    writing = threading.Timer(1, lambda: path.write_text(crew.file.read_text()))
    writing.start()
    with Workers(str(path)) as workers:
        assert list(workers.run("powers", pow, [(2, 3)])) == [8]
    writing.join()


def test_a_worker_with_too_little_memory_is_named(crew: Processes) -> None:
    with pytest.raises(InputError, match=r"^tcp://\S+: has 953 MB of memory for 1 threads, and .* needs 1408"):
        connect(crew, sources=list_sources([np.zeros((9000, 9000, 3), np.uint8)] * 3), memory_bytes=1 << 30)


def mosaic_of(folder: Path, cluster: Processes | None) -> Any:
    # A cache of its own for each: nothing is taken over from another run.
    scheduler, cache = (None, "own") if cluster is None else (str(cluster.file), "shared")
    return mosaic([folder / "photographs"], scheduler=scheduler, cache=folder / cache).image


def write_flight(folder: Path, count: int, size: tuple[int, int]) -> None:
    (folder / "photographs").mkdir()
    for index, image in enumerate(make_lawnmower(3, count, size, k1=-0.1).images):
        cv2.imwrite(str(folder / "photographs" / f"{index:02}.jpg"), image)


def test_workers_make_the_same_mosaic_as_threads(crew: Processes, tmp_path: Path) -> None:
    write_flight(tmp_path, 3, (320, 240))
    np.testing.assert_array_equal(mosaic_of(tmp_path, crew), mosaic_of(tmp_path, None))


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [10], indirect=True)
def test_workers_that_are_killed_every_five_seconds_make_the_same_mosaic(cluster: Processes, tmp_path: Path) -> None:
    write_flight(tmp_path, 24, (640, 480))
    workers = [cluster.worker(), cluster.worker()]
    ended = threading.Event()

    def replace_workers() -> None:
        client: Any = distributed.Client(scheduler_file=str(cluster.file), set_as_default=False)
        while not ended.wait(5):
            workers.pop(0).kill()
            workers.append(cluster.worker())
            # On a busy machine it takes longer than that to start one and to import the package there.
            client.wait_for_workers(2, timeout=60)
            client.run(inspect_worker, [], on_error="ignore")
        client.close()

    thread = threading.Thread(target=replace_workers)
    thread.start()
    try:
        made = mosaic_of(tmp_path, cluster)
    finally:
        ended.set()
        thread.join()
    np.testing.assert_array_equal(made, mosaic_of(tmp_path, None))
