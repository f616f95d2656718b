"""The command line, as a user meets it."""

import contextlib
import io
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from skymosaic.cli import main


@contextlib.contextmanager
def closed_pipe() -> Iterator[int]:
    """The end to write to of a pipe whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)


def captured(command: Sequence[object], **options: Any) -> subprocess.CompletedProcess[str]:
    """Run another program, whatever becomes of it, and keep what it prints."""
    return subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, **options)


def skymosaic(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run ``skymosaic`` in ``cwd``, in this process, which has imported it."""
    words = ["skymosaic", *map(str, arguments)]
    stdout, stderr = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with (
        contextlib.chdir(cwd),
        contextlib.redirect_stdout(stdout),
        contextlib.redirect_stderr(stderr),
        pytest.MonkeyPatch.context() as patch,
        # As the program does wherever standard error has not been replaced.
        warnings.catch_warnings(action="ignore"),
    ):
        patch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as end:
            main()
    outputs = []
    for stream in (stdout, stderr):
        stream.seek(0)
        outputs.append(stream.read())
    return subprocess.CompletedProcess(words, int(end.value.code or 0), *outputs)


def skymosaic_process(
    *arguments: object, cwd: Path, stdout: int = subprocess.PIPE, stderr: int = subprocess.PIPE
) -> subprocess.CompletedProcess[str]:
    """The same in a process of its own. Without a time limit: a busy machine must not fail a test."""
    command = [sys.executable, "-m", "skymosaic", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, text=True, check=False, stdout=stdout, stderr=stderr)


def only_error(stderr: str) -> str:
    """The line that says why a command failed: the last one, and no traceback before it."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    assert "Traceback" not in stderr
    assert [line for line in lines if line.startswith("error: ")] == lines[-1:], stderr
    return lines[-1]
