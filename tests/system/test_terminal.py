"""The command line as a process: full devices, signals and noisy libraries."""

import importlib
import io
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from golden_model.fuzzy.rules import read_shipped
from sim.scene import make_pair
from skymosaic.cli import main
from skymosaic.cli.terminal import ended_by_signals
from tests.made import write_pictures
from tests.system.command_line import captured, closed_pipe, only_error, skymosaic_process

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "skymosaic", *map(str, words)]


@pytest.fixture
def noisy(tmp_path: Path) -> Path:
    """A PNG for which libpng prints a warning, and so flat that no mosaic comes of it."""
    file = io.BytesIO()
    PillowImage.fromarray(np.full((100, 100, 3), 90, np.uint8)).save(file, "PNG", icc_profile=b"none" * 20)
    (tmp_path / "noisy.png").write_bytes(file.getvalue())
    return tmp_path / "noisy.png"


def test_messages_of_libraries_stay_off_the_terminal(noisy: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cv2.imread(str(noisy)) is not None
    assert "libpng" in capfd.readouterr().err
    done = captured(command("register", noisy, noisy), env=ENVIRONMENT)
    assert done.returncode == 3
    assert "libpng" not in done.stderr
    assert "too few features" in only_error(done.stderr)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_a_full_standard_output_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            command("--help"), check=False, stdout=full, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
        )
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["error: No space left on device; check the disk and its permissions"]


@pytest.mark.parametrize("outputs", [pytest.param("2>/dev/full", marks=pytest.mark.slow), ">&- 2>&-"])
def test_a_result_does_not_depend_on_standard_error(tmp_path: Path, outputs: str) -> None:
    write_pictures(tmp_path, make_pair(seed=9, size=(200, 160)).images, ("a.png", "b.png"))
    words = shlex.join(command("mosaic", tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "m.png"))
    done = subprocess.run(f"{words} {outputs}", shell=True, check=False, env=ENVIRONMENT)
    assert done.returncode == 0
    assert cv2.imread(str(tmp_path / "m.png")) is not None


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("fuzzy ransac", 141),
        pytest.param("fuzzy ransac --json", 141, marks=pytest.mark.slow),
        ("register a b --json", 2),
    ],
)
def test_a_closed_pipe_is_not_taken_for_a_difference(tmp_path: Path, words: str, status: int) -> None:
    with closed_pipe() as pipe:
        done = skymosaic_process(*words.split(), cwd=tmp_path, stdout=pipe)
    assert done.returncode == status
    assert ("error: a: no such file" in only_error(done.stderr)) if status == 2 else not done.stderr


class Stream(io.TextIOWrapper):
    """An output that a test reads, perhaps a terminal."""

    is_terminal = False

    def isatty(self) -> bool:
        return self.is_terminal


@pytest.mark.parametrize("is_terminal", [False, True])
@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "koi8-r"])
def test_every_character_is_printed_in_any_encoding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, encoding: str, is_terminal: bool
) -> None:
    monkeypatch.setattr(Stream, "is_terminal", is_terminal)
    monkeypatch.chdir(tmp_path)
    Path("±日.fll").write_text(read_shipped("aerial").replace("sure", "sûre"), encoding="utf-8")
    for words, status, where in (
        (["fuzzy", "±日.fll", "--entries", "9"], 0, "stdout"),
        (["check", "±日"], 2, "stderr"),
        (["--日"], 2, "stderr"),
    ):
        streams = {name: Stream(io.BytesIO(), encoding, "strict") for name in ("stdout", "stderr")}
        for name, stream in streams.items():
            monkeypatch.setattr(sys, name, stream)
        monkeypatch.setattr(sys, "argv", ["skymosaic", *words])
        with pytest.raises(SystemExit) as end:
            main()
        assert (end.value.code or 0) == status
        streams[where].seek(0)
        assert "\\u65e5" in streams[where].read()


def test_ctrl_c_while_modules_are_imported_is_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys, "argv", ["skymosaic", "fuzzy"])
    monkeypatch.setattr(importlib, "import_module", interrupt)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130


def test_what_nohup_started_outlives_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            signal.raise_signal(signal.SIGHUP)
            with pytest.raises(SystemExit):
                signal.raise_signal(signal.SIGTERM)
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    "end", [*(pytest.param(each, marks=pytest.mark.slow) for each in (signal.SIGTERM, signal.SIGHUP)), signal.SIGINT]
)
def test_a_signal_leaves_no_temporary_files(tmp_path: Path, noisy: Path, end: signal.Signals) -> None:
    for name in ("photographs", "out", "temp"):
        (tmp_path / name).mkdir()
    noisy.rename(tmp_path / "photographs" / "flat.png")
    environment = {**ENVIRONMENT, "TMPDIR": str(tmp_path / "temp")}
    words = command("live", tmp_path / "photographs", "-o", tmp_path / "out" / "mosaic.png")
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, env=environment)
    assert "too few features" in process.stderr.readline()
    process.send_signal(end)
    _, errors = process.communicate()
    assert process.returncode != 0
    assert "Traceback" not in errors
    assert not list((tmp_path / "temp").iterdir())
    assert not list((tmp_path / "out").iterdir())
