"""Work and faults of a cluster, with a real scheduler and real workers, which are processes on this machine."""

import dataclasses
import itertools
import os
import signal
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

from golden_model.cache import NO_CACHE
from golden_model.config import preset_config
from sim.scene import make_lawnmower
from skymosaic import mosaic
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.flight.linking.view import Settings, View
from skymosaic.imagery.parcel import Parcel
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


def connect_until_refused(cluster: Processes) -> None:
    """A worker that was started may take a while to come."""
    while True:
        connect(cluster).__exit__(None, None, None)


def end_worker(_path: Path) -> None:
    os._exit(1)


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


def test_the_dashboard_is_named() -> None:
    local: Any = distributed.LocalCluster
    lines: list[str] = []
    with (
        local(processes=False, n_workers=1, host="127.0.0.1", protocol="tcp", dashboard_address=":0") as cluster,
        Workers(cluster.scheduler_address, progress=lambda line, *_: lines.append(line)),
    ):
        assert lines == [f"{cluster.scheduler_address}: dashboard {cluster.dashboard_link}"]


@pytest.mark.slow
def test_a_signal_ends_the_wait_for_a_worker(cluster: Processes) -> None:
    for name in ("a.png", "b.png", "c.png"):
        cv2.imwrite(str(cluster.folder / name), np.zeros((100, 100), np.uint8))
    command = [sys.executable, "-m", "skymosaic", "mosaic", "a.png", "b.png", "c.png", "-o", "m.png"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.Popen(
        [*command, "--scheduler", cluster.file], cwd=cluster.folder, stderr=subprocess.PIPE, text=True, env=environment
    )
    assert run.stderr is not None
    while "waiting 30 s" not in run.stderr.readline():
        assert run.poll() is None
    run.terminate()
    assert "Traceback" not in run.communicate(timeout=60)[1]
    assert run.returncode == 128 + signal.SIGTERM
    assert not (cluster.folder / "m.png").exists()


def test_a_worker_with_too_little_memory_is_named(crew: Processes) -> None:
    with pytest.raises(InputError, match=r"^tcp://\S+: has 953 MB of memory for 1 threads, and .* needs 1408"):
        connect(crew, sources=list_sources([np.zeros((9000, 9000, 3), np.uint8)] * 3), memory_bytes=1 << 30)


@pytest.mark.slow
def test_a_worker_that_cannot_import_the_package_is_named(cluster: Processes, tmp_path: Path) -> None:
    (tmp_path / "other" / "skymosaic").mkdir(parents=True)
    (tmp_path / "other" / "skymosaic" / "__init__.py").touch()
    cluster.worker(PYTHONPATH=str(tmp_path / "other"))
    with pytest.raises(InputError, match=r"^tcp://\S+: skymosaic cannot be imported \(.*\); install it there$"):
        connect_until_refused(cluster)


HIDES = ("unshare", "-rm", "sh", "-c", 'mount -t tmpfs none "$0" && exec "$@"')
"""Starts a command that sees another folder in the place of one: the command's name is the folder, then it follows."""


@pytest.mark.slow
def test_a_worker_that_does_not_see_the_photographs_is_named(cluster: Processes, tmp_path: Path) -> None:
    folder = tmp_path / "photographs"
    folder.mkdir()
    if subprocess.run([*HIDES, folder, "true"], capture_output=True, check=False).returncode:
        pytest.skip("no mount name spaces here")
    cv2.imwrite(str(folder / "a.png"), np.random.default_rng(0).integers(0, 256, (100, 100), np.uint8))
    sources = list_sources([folder])
    cluster.worker(before=(*HIDES, folder))
    with pytest.raises(InputError, match=rf"^tcp://\S+: cannot read {folder}/a.png; mount the folder there"):
        connect(cluster, sources=sources)
    # One that joins later is not asked; what it cannot read is tried here.
    with connect(cluster) as workers:
        surveyor = Surveyor(Settings(preset_config("aerial")), 0, workers, NO_CACHE)
        assert [type(view) for view in surveyor.describe(sources)] == [View]


@pytest.mark.slow
def test_a_worker_that_hangs_is_one_line(cluster: Processes) -> None:
    worker = cluster.worker()
    connect(cluster).__exit__(None, None, None)
    worker.send_signal(signal.SIGSTOP)
    with dask.config.set({LIMIT: "1s"}), pytest.raises(InputError, match="a worker does not answer within 1 s"):
        connect(cluster)


@pytest.mark.slow
def test_lost_workers_cost_their_calls_and_all_of_them_end_the_run(cluster: Processes) -> None:
    lines: list[str] = []
    both = [cluster.worker() for _ in range(2)]
    with connect(cluster, lines) as workers:
        while workers._pool.threads < 2:
            time.sleep(0.1)
        results: Any = workers.run("sleeping", time.sleep, [(0.05,) for _ in range(60)])
        next(results)
        both[0].kill()
        assert len(list(results)) == 59
        both.append(cluster.worker())
        while len(set(workers.run("processes", os.getpid, [()] * 20))) < 2:
            pass  # until the one that joins gets work
        for worker in both:
            worker.kill()
        with dask.config.set({LIMIT: "2s"}), pytest.raises(RegistrationError, match=r"no worker within 2 s; .* cache$"):
            list(workers.run("powers", pow, [(2, 3)]))
    assert "has no worker; waiting 2 s" in lines[-1]


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [0], indirect=True)
def test_a_call_that_ends_its_worker_is_named(cluster: Processes) -> None:
    cluster.worker("--memory-limit", "300MB")
    with (
        connect(cluster) as workers,
        pytest.raises(RegistrationError, match=r"^features of a\.jpg: ended 1 workers, .* 286 MB of memory"),
    ):
        list(workers.run("features", end_worker, [(Path("folder/a.jpg"),)]))


@dataclasses.dataclass
class Described:
    number: int
    heavy: Any


def describe(number: int, folder: Path) -> Described | str:
    (folder / f"{number}.{os.getpid()}").touch()
    return Described(number, np.full(1000, number)) if number else "none of these"


def add(left: Any, right: Any) -> int:
    return int((left + right).sum())


@pytest.mark.slow
def test_what_is_kept_stays_with_the_workers_and_outlives_them(cluster: Processes, tmp_path: Path) -> None:
    both = [cluster.worker() for _ in range(2)]
    with connect(cluster) as workers:
        while workers._pool.threads < 2:
            time.sleep(0.1)
        calls = [(number, tmp_path) for number in range(8)]
        none, *described = workers.run("described", describe, calls, kept=("heavy",))
        assert none == "none of these"
        assert [each.number for each in described] == list(range(1, 8))
        assert {type(each.heavy).__name__ for each in described} == {"Future"}
        pairs = [(left.heavy, right.heavy) for left, right in itertools.pairwise(described)]
        sums = [1000 * (2 * number + 1) for number in range(1, 7)]
        assert list(workers.run("added", add, pairs)) == sums
        assert len(list(tmp_path.glob("?.*"))) == 8
        both[0].kill()
        # The other one computes again what was lost.
        assert list(workers.run("added", add, pairs)) == sums
        assert [parcel.pixels.sum() for parcel in workers.run("fetched", Parcel, [(described[2].heavy,)])] == [3000]


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
