"""The command line in a process of its own."""

import subprocess
import sys
from pathlib import Path


def skymosaic(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run ``skymosaic`` in ``cwd``. Without a time limit: a busy machine must not fail a test."""
    command = [sys.executable, "-m", "skymosaic", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


def only_error(stderr: str) -> str:
    """The line that says why a command failed: the last one, and no traceback before it."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    assert "Traceback" not in stderr
    assert [line for line in lines if line.startswith("error: ")] == lines[-1:], stderr
    return lines[-1]
