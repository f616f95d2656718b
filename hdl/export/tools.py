"""Runs the open tools of the extra ``ulx3s``."""

import shutil
import subprocess
import sys
from pathlib import Path

from golden_model.text import how_to_install


class BuildError(Exception):
    """A tool is missing or has failed; the message is one line."""


def run_tool(folder: Path, tool: str, *arguments: str) -> None:
    """Run a tool, or a program by its path, in ``folder``.

    Raises
    ------
    BuildError
        If it is missing or fails.
    """
    # In this environment (YoWASP's packages), or else on the system.
    packaged = Path(sys.executable).parent / f"yowasp-{tool}"
    path = packaged if packaged.exists() else shutil.which(tool)
    if path is None:
        raise BuildError(f"{tool} is not installed; {how_to_install('ulx3s')}")
    done = subprocess.run([path, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = (done.stderr + done.stdout).splitlines()
        reason = next((line for line in lines if "ERROR" in line), f"exit status {done.returncode}")
        raise BuildError(f"{tool} failed: {reason}")
