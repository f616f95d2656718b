"""Jobs in worker processes: results, progress, failures, and cancelling without leaving a process behind."""

import asyncio
import importlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from multiprocessing import forkserver
from pathlib import Path
from types import ModuleType

import pytest

from golden_model.temporary import temporary_folder
from skymosaic.panel.tasks.jobs import Job, JobCancelledError, JobFailedError, Limits
from tools.panel import LONG_MS

pytestmark = pytest.mark.usefixtures("workers")
TASKS = """
import os, subprocess, sys, time
from skymosaic.common.errors import InputError

def add(folder, one, other, *, progress):
    progress("adding", 1, 2)
    return one + other, folder

def refuse(folder, *, progress):
    raise InputError(f"{folder / 'left.png'}: too small")

def raise_key_error(folder, *, progress):
    raise KeyError("x")

def die(folder, *, progress):
    os.abort()

def compute(folder, *, progress):
    while True:
        pass

def fill_memory(folder, *, progress):
    return len(bytearray(3 << 30))

def last_long(folder, *, progress):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    (folder / "processes").write_text(f"{os.getpid()} {child.pid}")
    progress("under way")
    time.sleep(600)
"""


@pytest.fixture(scope="module")
def tasks(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """A module that workers can import as this process does."""
    folder = tmp_path_factory.mktemp("tasks")
    (folder / "tasks_for_the_jobs_test.py").write_text(TASKS)
    sys.path.insert(0, str(folder))
    yield importlib.import_module("tasks_for_the_jobs_test")
    sys.path.remove(str(folder))


def run(job: Job) -> object:
    return asyncio.run(job.run(asyncio.Semaphore(1)))


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


def eventually(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + LONG_MS / 1000
    while time.monotonic() < deadline and not condition():
        time.sleep(0.02)
    return condition()


def test_a_task_gets_folder_and_arguments_and_returns_its_result(tasks: ModuleType, tmp_path: Path) -> None:
    job = Job("adding", tasks.add, tmp_path, 2, 3)
    assert run(job) == (5, tmp_path)
    assert job.line == "adding: 1 of 2"
    assert job.steps.share == 0.5


@pytest.mark.parametrize(
    ("name", "message"),
    [("refuse", "^left.png: too small"), ("raise_key_error", "unexpected KeyError"), ("die", "the worker died")],
)
def test_a_failure_is_one_line_that_names_files_relative_to_the_folder(
    tasks: ModuleType, tmp_path: Path, name: str, message: str
) -> None:
    with pytest.raises(JobFailedError, match=message):
        run(Job(name, getattr(tasks, name), tmp_path))


def test_cancelling_ends_the_task_and_every_process_it_started(tasks: ModuleType, tmp_path: Path) -> None:
    job = Job("long", tasks.last_long, tmp_path)

    async def cancel_under_way() -> None:
        running = asyncio.create_task(job.run(asyncio.Semaphore(1)))
        while job.line != "under way":
            await asyncio.sleep(0.02)
        job.cancel()
        with pytest.raises(JobCancelledError):
            await running

    asyncio.run(cancel_under_way())
    processes = [int(word) for word in (tmp_path / "processes").read_text().split()]
    assert os.getpid() not in processes
    assert eventually(lambda: not any(map(alive, processes)))


@pytest.mark.parametrize(
    ("name", "limits", "message"),
    [
        ("compute", Limits(1, 60, 1 << 30), "more than 1 s"),
        ("last_long", Limits(0.5, 60, 1 << 30), "more than 0.5 s"),
        ("compute", Limits(600, 1, 1 << 30), "more than 1 s of processor time"),
        ("fill_memory", Limits(600, 60, 1 << 30), "more memory"),
        ("die", Limits(600, 60, 1 << 30), "the worker died"),
    ],
)
def test_a_worker_beyond_its_limits_is_ended(
    tasks: ModuleType, tmp_path: Path, name: str, limits: Limits, message: str
) -> None:
    with pytest.raises(JobFailedError, match=message):
        run(Job(name, getattr(tasks, name), tmp_path, limits=limits))


KILLED_SERVER = """
import asyncio, os, signal, sys
from pathlib import Path
from golden_model.temporary import temporary_folder
from skymosaic.panel.tasks.jobs import Job, prepare_workers
import tasks_for_the_jobs_test

async def scenario():
    job = Job("long", tasks_for_the_jobs_test.last_long, Path(sys.argv[1]))
    running = asyncio.create_task(job.run(asyncio.Semaphore(1)))
    while job.line != "under way":
        await asyncio.sleep(0.02)
    os.kill(os.getpid(), signal.SIGKILL)

with temporary_folder() as folder:
    prepare_workers(folder)
    asyncio.run(scenario())
"""


def test_a_killed_server_leaves_no_process_and_no_file_after_the_next_start(
    tasks: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # With a short path, which has room for that of a socket.
    temporary = Path(tempfile.mkdtemp())
    path = os.pathsep.join([str(Path(tasks.__file__ or "").parent), str(Path.cwd())])
    environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": path}
    subprocess.run([sys.executable, "-c", KILLED_SERVER, str(tmp_path)], env=environment, check=False)
    processes = [int(word) for word in (tmp_path / "processes").read_text().split()]
    assert eventually(lambda: not any(map(alive, processes)))
    assert list(temporary.iterdir())
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    with temporary_folder():
        pass
    # Only an empty folder can be removed.
    temporary.rmdir()


def test_a_cancelled_job_never_starts_and_a_killed_helper_is_replaced(tasks: ModuleType, tmp_path: Path) -> None:
    job = Job("adding", tasks.add, tmp_path, 2, 3)
    job.cancel()
    with pytest.raises(JobCancelledError):
        run(job)
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)  # type: ignore[attr-defined]

    def works() -> bool:
        try:
            return run(Job("adding", tasks.add, tmp_path, 2, 3)) == (5, tmp_path)
        except JobFailedError:
            return False

    assert eventually(works)
