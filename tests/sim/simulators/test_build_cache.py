"""The cache of slow builds: once for all processes, never half a build, one clear line when it cannot work."""

import os
import re
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest

from golden_model.cache import cache_folder
from sim.backends.errors import BackendError
from sim.backends.interface import silent
from sim.simulators import build_cache
from sim.simulators.build_cache import build_once
from tests.made import leave_free

SLOW_BUILD = """
import sys, time
from pathlib import Path
from sim.simulators.build_cache import build_once

def build(folder):
    with Path(sys.argv[1]).open("a") as log:
        log.write("build\\n")
    while not Path(sys.argv[1] + ".end").exists():
        time.sleep(0.01)
    (folder / "result").write_text("complete")

folder = build_once("slow", build, what="the slow thing", progress=lambda line: print(line, flush=True))
assert (folder / "result").read_text() == "complete"
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return cache_folder()


def start_slow_build(log: Path) -> Popen[str]:
    """A process that builds until there is a file beside ``log`` that ends in ``.end``."""
    command = [sys.executable, "-c", SLOW_BUILD, str(log)]
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)


def first_line(process: Popen[str]) -> str:
    assert process.stdout
    return process.stdout.readline()


def write_result(folder: Path) -> None:
    (folder / "result").write_text("complete")


def build_as_a_new_process(name: str, build: Callable[[Path], None], progress: Callable[[str], None]) -> Path:
    """Build without what this process has made before."""
    build_cache._made.clear()
    return build_once(name, build, what=f"the {name}", progress=progress)


def kept() -> set[str]:
    """Names in the cache, without this process's own folder and its lock."""
    return {path.name for path in cache_folder().iterdir() if not path.name.startswith(".")}


def refuse(folder: Any) -> None:
    raise AssertionError(f"{folder} is built again")


def test_builds_once_and_says_how_long_it_took() -> None:
    lines: list[str] = []
    cache_folder().mkdir(parents=True)
    folder = build_once("thing", write_result, what="the thing", progress=lines.append)
    assert (folder / "result").read_text() == "complete"
    assert stat.S_IMODE(cache_folder().stat().st_mode) == 0o700, "who can write to it can run code as its owner"
    assert lines[0] == f"building the thing (once; later runs find it in {cache_folder()})"
    assert re.fullmatch(r"built the thing in \d+ s", lines[1])
    assert build_once("thing", refuse, what="the thing", progress=refuse) == folder
    again = build_as_a_new_process("thing", refuse, refuse)
    assert again != folder
    assert (again / "result").read_text() == "complete"


def test_files_come_back_in_their_folders_and_run() -> None:
    def build(folder: Path) -> None:
        (folder / "in" / "it").mkdir(parents=True)
        (folder / "in" / "it" / "program").write_text("#!/bin/sh\necho runs\n")
        (folder / "empty").touch()

    for _ in range(2):
        folder = build_as_a_new_process("thing", build, silent)
    assert (folder / "empty").read_bytes() == b""
    assert subprocess.run([folder / "in" / "it" / "program"], capture_output=True, check=True).stdout == b"runs\n"


def test_two_processes_build_once(tmp_path: Path) -> None:
    log = tmp_path / "log"
    first = start_slow_build(log)
    assert first_line(first).startswith("building")
    second = start_slow_build(log)
    assert first_line(second).startswith("waiting")
    log.with_name("log.end").touch()
    for process in (first, second):
        process.communicate()
        assert process.returncode == 0
    assert log.read_text() == "build\n"


def test_killed_build_leaves_no_trace(tmp_path: Path) -> None:
    log = tmp_path / "log"
    process = start_slow_build(log)
    assert first_line(process).startswith("building")
    while not log.exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    (left,) = (path for path in cache_folder().glob(".skymosaic-*") if path.is_dir())

    folder = build_once("slow", write_result, what="the slow thing", progress=silent)
    assert (folder / "result").read_text() == "complete"
    assert not left.exists()
    assert kept() == {"slow.entry"}


def test_failed_build_leaves_nothing() -> None:
    def fail(folder: Any) -> None:
        write_result(folder)
        raise BackendError("the compiler failed")

    with pytest.raises(BackendError, match="the compiler failed"):
        build_once("thing", fail, what="the thing", progress=silent)
    assert kept() == set()
    assert not list(build_cache._own_folder(cache_folder()).iterdir())
    build_once("thing", write_result, what="the thing", progress=silent)


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: b"C" + data[1:], lambda _data: b""])
def test_a_damaged_build_is_built_again(damage: Callable[..., Any]) -> None:
    build_once("thing", write_result, what="the thing", progress=silent)
    entry = cache_folder() / "thing.entry"
    entry.write_bytes(damage(entry.read_bytes()))
    lines: list[str] = []
    assert (build_as_a_new_process("thing", write_result, lines.append) / "result").read_text() == "complete"
    assert len(lines) == 2
    build_as_a_new_process("thing", refuse, refuse)
    assert kept() == {"thing.entry"}


def test_a_build_that_cannot_be_kept_serves_this_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    lines: list[str] = []

    def build(folder: Path) -> None:
        write_result(folder)
        monkeypatch.setattr(Path, "replace", full)

    folder = build_once("thing", build, what="the thing", progress=lines.append)
    assert (folder / "result").read_text() == "complete"
    entry = cache_folder() / "thing.entry"
    reason = f"{entry}: cannot be written (No space left on device); choose another folder"
    assert lines[-1] == f"the thing is not kept for the next run: {reason}"


def test_threads_build_once() -> None:
    calls: list[Path] = []

    def build(folder: Path) -> None:
        calls.append(folder)
        time.sleep(0.1)
        write_result(folder)

    with ThreadPoolExecutor(4) as threads:
        folders = threads.map(lambda _: build_once("thing", build, what="the thing", progress=silent), range(4))
    assert {*folders} == {*calls}
    assert len(calls) == 1


@pytest.mark.parametrize("reason", ["no folder", "full"])
def test_unwritable_cache_costs_the_cache_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reason: str) -> None:
    if reason == "no folder":
        (tmp_path / "file").touch()
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))

    def build(folder: Any) -> None:
        if folder.is_relative_to(cache_folder()):
            raise OSError(28, "No space left on device")
        write_result(folder)

    lines: list[str] = []
    folder = build_once(f"thing-{reason}", build, what="the thing", progress=lines.append)
    assert (folder / "result").read_text() == "complete"
    why = "Not a directory" if reason == "no folder" else "No space left on device"
    assert f"cannot write the cache {cache_folder()} ({why}); the thing is built for this run only" in lines
    assert build_once(f"thing-{reason}", build, what="the thing", progress=silent) == folder


@pytest.mark.parametrize("missing_bytes", [0, 1])
def test_a_build_that_fails_on_a_full_disk_is_tried_elsewhere(
    monkeypatch: pytest.MonkeyPatch, missing_bytes: int
) -> None:
    """Full is one with less than 64 MiB."""
    leave_free(monkeypatch, (64 << 20) - missing_bytes)
    name, lines = f"thing-{missing_bytes}", list[str]()

    def build(folder: Path) -> None:
        if folder.is_relative_to(cache_folder()):
            raise BackendError("the compiler failed")
        write_result(folder)

    if missing_bytes:
        assert (build_once(name, build, what="the thing", progress=lines.append) / "result").exists()
        why = f"cannot write the cache {cache_folder()} (its disk is full); the thing is built for this run only"
        assert lines[1] == why
        assert lines[2].startswith("building the thing (for this run only, in ")
    else:
        with pytest.raises(BackendError, match="the compiler failed"):
            build_once(name, build, what="the thing", progress=lines.append)


def test_imports_without_fcntl() -> None:
    modules = "skymosaic.cli.mosaic, sim.simulators.verilator, skymosaic.features.board_client"
    code = f"import sys; sys.modules['fcntl'] = None; import {modules}"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
