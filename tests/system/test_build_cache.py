"""The cache of slow builds: once for all processes, never half a build, one clear line when it cannot work."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim.backend import BackendError, silent
from sim.build_cache import cache_folder, cached, digest

SLOW_BUILD = """
import sys, time
from pathlib import Path
from sim.build_cache import cached

def build(folder):
    with Path(sys.argv[1]).open("a") as log:
        log.write("build\\n")
    time.sleep(float(sys.argv[2]))
    (folder / "result").write_text("complete")

folder = cached("slow", build, what="the slow thing", progress=lambda line: print(line, flush=True))
assert (folder / "result").read_text() == "complete"
"""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return cache_folder()


def start_slow_build(log, seconds):
    command = [sys.executable, "-c", SLOW_BUILD, str(log), str(seconds)]
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)


def write_result(folder):
    (folder / "result").write_text("complete")


def refuse(folder):
    raise AssertionError(f"{folder} is built again")


def test_builds_once_and_says_how_long_it_took():
    lines = []
    folder = cached("thing", write_result, what="the thing", progress=lines.append)
    assert (folder / "result").read_text() == "complete"
    assert lines == [f"building the thing (once; later runs find it in {cache_folder()})", "built the thing in 0 s"]
    assert cached("thing", refuse, what="the thing", progress=refuse) == folder


def test_two_processes_build_once(tmp_path):
    log = tmp_path / "log"
    processes = [start_slow_build(log, 1.0) for _ in range(2)]
    outputs = [process.communicate(timeout=30)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert log.read_text() == "build\n"
    assert sorted(output.splitlines()[0].split()[0] for output in outputs) == ["building", "waiting"]


def test_killed_build_leaves_no_trace(tmp_path):
    log = tmp_path / "log"
    process = start_slow_build(log, 60)
    assert process.stdout.readline().startswith("building")
    deadline = time.monotonic() + 20
    while not log.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=30)
    assert list(cache_folder().glob("slow.*.part")), "the killed build was to leave its folder behind"

    folder = cached("slow", write_result, what="the slow thing", progress=silent)
    assert (folder / "result").read_text() == "complete"
    assert not list(cache_folder().glob("*.part"))


def test_failed_build_leaves_nothing():
    def fail(folder):
        write_result(folder)
        raise BackendError("the compiler failed")

    with pytest.raises(BackendError, match="the compiler failed"):
        cached("thing", fail, what="the thing", progress=silent)
    assert [path.name for path in cache_folder().iterdir()] == ["thing.lock"]
    cached("thing", write_result, what="the thing", progress=silent)


def test_unwritable_cache_is_one_clear_line(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(BackendError, match=r"cannot write the cache .*: Not a directory; set XDG_CACHE_HOME"):
        cached("thing", refuse, what="the thing", progress=silent)


def test_default_folder(monkeypatch, tmp_path):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "skymosaic"


def test_digest_tells_parts_apart():
    keys = {digest("ab", "c"), digest("a", "bc"), digest("abc"), digest("ab", "d"), digest()}
    assert len(keys) == 5
