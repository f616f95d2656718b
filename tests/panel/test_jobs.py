"""Work in processes of its own: results, progress, faults, and an end that leaves nothing running."""

import asyncio
import importlib
import os
import signal
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from multiprocessing import forkserver
from pathlib import Path
from types import ModuleType

import pytest

from skymosaic.panel.archive import zipped
from skymosaic.panel.jobs import Job, JobCancelledError, JobFailedError

pytestmark = pytest.mark.usefixtures("workers")

WORK = """
import os, subprocess, sys, time
from pathlib import Path
from skymosaic.errors import InputError

def add(one, other, *, progress):
    progress("adding")
    return one + other, str(Path.cwd())

def refuse(*, progress):
    raise InputError("left.png: too small")

def stumble(*, progress):
    raise KeyError("x")

def die(*, progress):
    os.abort()

def last_long(*, progress):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    Path("processes").write_text(f"{os.getpid()} {child.pid}")
    progress("under way")
    time.sleep(600)
"""


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """A module that workers can import as this process does."""
    folder = tmp_path_factory.mktemp("work")
    (folder / "work_for_the_jobs_test.py").write_text(WORK)
    sys.path.insert(0, str(folder))
    yield importlib.import_module("work_for_the_jobs_test")
    sys.path.remove(str(folder))


def run(job: Job) -> object:
    return asyncio.run(job.run(asyncio.Semaphore(1)))


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


def eventually(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and not condition():
        time.sleep(0.02)
    return condition()


def test_a_result_comes_back_from_the_jobs_folder(work: ModuleType, tmp_path: Path) -> None:
    job = Job("adding", tmp_path, work.add, 2, 3)
    assert run(job) == (5, str(tmp_path))
    assert job.line == "adding"


@pytest.mark.parametrize(
    ("name", "says"),
    [("refuse", "left.png: too small"), ("stumble", "unexpected KeyError"), ("die", "the worker died")],
)
def test_faults_are_one_line(work: ModuleType, tmp_path: Path, name: str, says: str) -> None:
    with pytest.raises(JobFailedError, match=says):
        run(Job(name, tmp_path, getattr(work, name)))


def test_cancelling_ends_the_work_and_all_it_started(work: ModuleType, tmp_path: Path) -> None:
    job = Job("long", tmp_path, work.last_long)

    async def cancel_under_way() -> float:
        running = asyncio.create_task(job.run(asyncio.Semaphore(1)))
        while job.line != "under way":
            await asyncio.sleep(0.02)
        started = time.monotonic()
        job.cancel()
        with pytest.raises(JobCancelledError):
            await running
        return time.monotonic() - started

    assert asyncio.run(cancel_under_way()) < 5
    processes = [int(word) for word in (tmp_path / "processes").read_text().split()]
    assert os.getpid() not in processes
    assert eventually(lambda: not any(map(alive, processes)))


def test_cancelling_before_its_turn_never_starts_it(work: ModuleType, tmp_path: Path) -> None:
    job = Job("adding", tmp_path, work.add, 2, 3)
    job.cancel()
    with pytest.raises(JobCancelledError):
        run(job)


def test_workers_start_again_after_their_helper_was_killed(work: ModuleType, tmp_path: Path) -> None:
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)

    def works() -> bool:
        try:
            return run(Job("adding", tmp_path, work.add, 2, 3)) == (5, str(tmp_path))
        except JobFailedError:
            return False

    assert eventually(works)


def test_jobs_wait_for_their_turn(work: ModuleType, tmp_path: Path) -> None:
    async def three_in_one_turn() -> list[object]:
        turns = asyncio.Semaphore(1)
        return await asyncio.gather(*(Job("adding", tmp_path, work.add, n, n).run(turns) for n in range(3)))

    assert [total for total, _ in asyncio.run(three_in_one_turn())] == [0, 2, 4]


def test_the_archive_holds_every_file_of_its_folders(tmp_path: Path) -> None:
    (tmp_path / "run" / "report").mkdir(parents=True)
    contents = {"run/a.txt": b"words " * 1000, "run/report/b.png": os.urandom(3 << 20), "run/c.csv": b""}
    for name, data in contents.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "whole.zip").write_bytes(b"".join(zipped({"mosaic": tmp_path / "run"})))
    with zipfile.ZipFile(tmp_path / "whole.zip") as archive:
        assert archive.testzip() is None
        unpacked = {name.replace("mosaic/", "run/"): archive.read(name) for name in archive.namelist()}
    assert unpacked == contents
