"""The area of a block that is exported is the recorded one, by the Yosys of the extra ``ulx3s``."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from bench.synthesis import recorded_rows
from tests.conftest import Run
from tests.system.command_line import only_error


@pytest.mark.slow
def test_the_area_is_the_recorded_one(run: Run) -> None:
    """The tool in WebAssembly compiles itself at its first start, for a minute."""
    recorded = recorded_rows()["half"]
    status, printed, error = run("export", "block", "half", "--area", "-o", "half")
    assert status == 0, error
    *_, line = printed.decode().splitlines()
    version, _, cells = line.removeprefix("area on xc7 by Yosys ").partition(": ")
    assert cells == (
        f"{recorded['LUT']} look-up tables, {recorded['FF']} registers, {recorded['DSP']} DSP, "
        f"{recorded['BRAM36']} block RAMs of 36 Kbit"
    )
    assert version == recorded["yosys"]


def test_without_the_tool_nothing_is_written(tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdl.export.tools.sys", SimpleNamespace(executable=str(tmp_path / "python")))
    monkeypatch.setenv("PATH", "")
    status, _, error = run("export", "block", "half", "--area", "-o", "half")
    assert status == 2
    assert "yosys is not installed" in only_error(error)
    assert not (tmp_path / "half").exists()
