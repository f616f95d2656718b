"""The command line in a process of its own."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def closed_pipe() -> Iterator[int]:
    """The end to write to of a pipe whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)


def skymosaic(
    *arguments: object, cwd: Path, stdout: int = subprocess.PIPE, stderr: int = subprocess.PIPE
) -> subprocess.CompletedProcess[str]:
    """Run ``skymosaic`` in ``cwd``. Without a time limit: a busy machine must not fail a test."""
    command = [sys.executable, "-m", "skymosaic", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, text=True, check=False, stdout=stdout, stderr=stderr)


def only_error(stderr: str) -> str:
    """The line that says why a command failed: the last one, and no traceback before it."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    assert "Traceback" not in stderr
    assert [line for line in lines if line.startswith("error: ")] == lines[-1:], stderr
    return lines[-1]
