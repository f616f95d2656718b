"""The recorded areas of the blocks are those of the sources."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from bench import synthesis

SCRIPT = Path(synthesis.__file__)
RECORDED = json.loads(synthesis.RECORDED.read_text())
QUICK = ("gray", "sobel")


def check(*names: str) -> subprocess.CompletedProcess[str]:
    """Synthesise designs and compare them with the figures beside the script."""
    command = [sys.executable, str(SCRIPT), *names, "--check"]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=SCRIPT.parents[1])


def test_quick_blocks_have_the_recorded_area() -> None:
    done = check(*QUICK)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDED)
def test_every_recorded_design_has_its_area(name: str) -> None:
    done = check(name)
    assert done.returncode == 0, done.stderr


def test_a_changed_and_an_unrecorded_figure_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gray = RECORDED["gray"]
    recorded = tmp_path / "synthesis.json"
    recorded.write_text(json.dumps({"gray": {**gray, "FF": gray["FF"] + 1}}))
    monkeypatch.setattr(synthesis, "RECORDED", recorded)
    changed, unknown = synthesis.differences({"gray": gray, "sobel": RECORDED["sobel"]})
    assert changed == f"gray: FF {gray['FF'] + 1} -> {gray['FF']}"
    assert unknown.startswith("sobel: LUT not recorded -> ")
    synthesis.record({"gray": gray})
    assert synthesis.differences({"gray": gray}) == []
