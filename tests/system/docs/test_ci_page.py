"""The workflow of the page on CI passes on the block's own Verilog, and is red on another."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "ci.md"


@pytest.mark.needs("icarus")
def test_the_workflow_compares_ones_own_rtl(tmp_path: Path) -> None:
    workflow = PAGE.read_text().split("```")[1].partition("\n")[2]
    assert len(workflow.splitlines()) <= 20
    export, compare = re.findall(r"^ +run: ([^|].*)$", workflow, re.MULTILINE)
    env = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}

    def status(run: str) -> int:
        return subprocess.run(run, shell=True, cwd=tmp_path, env=env, capture_output=True, check=False).returncode

    assert status(export) == 0
    own, right = tmp_path / "rtl" / "sobel.v", (tmp_path / "golden" / "sobel.v").read_text()
    own.parent.mkdir()
    own.write_text(right)
    assert status(compare) == 0
    own.write_text(right.replace(" - ", " + ", 1))
    assert own.read_text() != right
    assert status(compare) == 1
