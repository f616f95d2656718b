"""Each exported block is simulated by Icarus from the exported files alone, against vectors of the golden model."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hdl.blocks.catalogue import CATALOGUE
from hdl.blocks.export import find_block, write_block
from skymosaic.cli.export import OWN_NAMES
from tests.conftest import Run
from tests.system.command_line import only_error

pytestmark = pytest.mark.needs("icarus")
QUICK = ("nms", "fuzzy")
"""The others take longer to export, and gray is simulated with its waves."""


def simulate(folder: Path, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    compiled = ["iverilog", "-g2012", "-o", "bench", f"{name}.v", f"{name}_tb.v"]
    subprocess.run(compiled, cwd=folder, check=True)
    return subprocess.run(["vvp", "-n", "bench", *arguments], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in CATALOGUE]
)
def test_the_bench_passes_from_the_exported_files_alone(tmp_path: Path, name: str) -> None:
    write_block(tmp_path, *find_block(name))
    run = simulate(tmp_path, name)
    assert run.returncode == 0, run.stdout
    assert re.match(r"PASS: \d+ answers", run.stdout)
    # A cocotb test of somebody else has a clock of nanoseconds.
    assert "\n`timescale 1ns / 1ps\n" in (tmp_path / f"{name}.v").read_text()
    assert "| `clk` | in | 1 |" in (tmp_path / "README.md").read_text()
    # The others' are run with other settings; this one has the memory.
    assert name != "painter" or run_cocotb(tmp_path, f"test_{name}").returncode == 0


@pytest.fixture(scope="module")
def fuzzy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fuzzy")
    write_block(folder, *find_block("fuzzy"))
    return folder


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [("fuzzy.v", r"<= folded\[", "<= ~folded["), ("o.hex", r"^(.*)\n", "0\n"), ("i.hex", r"^.*\n", "")],
    ids=["a block that computes something else", "another answer", "an input that is missing"],
)
def test_the_bench_fails_on_anything_else(fuzzy: Path, tmp_path: Path, file: str, old: str, new: str) -> None:
    folder = shutil.copytree(fuzzy, tmp_path / "changed")
    path = folder / file
    changed = re.sub(old, new, path.read_text(), count=1)
    assert changed != path.read_text()
    path.write_text(changed)
    run = simulate(folder, "fuzzy")
    assert run.returncode != 0
    assert "FAIL" in run.stdout


def run_cocotb(folder: Path, test: str, *sources: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, f"{test}.py", *sources], cwd=folder, capture_output=True, text=True, check=False
    )


def test_the_cocotb_test_passes_and_notices_each_wrong_line(fuzzy: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(fuzzy, tmp_path / "copy")
    run = run_cocotb(folder, "test_fuzzy")
    assert run.returncode == 0, run.stdout
    assert "TESTS=1 PASS=1 FAIL=0" in run.stdout
    right = (folder / "fuzzy.v").read_text()
    # A handshake, and the arithmetic.
    for old in ("<= operands_valid", "<= folded["):
        changed = right.replace(old, old.replace("<= ", "<= ~"), 1)
        assert changed != right
        own = tmp_path / "own rtl.v"
        own.write_text(changed)
        run = run_cocotb(folder, "test_fuzzy", own)
        assert run.returncode != 0, (old, run.stdout)
        assert "FAIL=1" in run.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("half", "width_px=4096 pixels_per_clock=2"),
        ("smooth", "width_px=640 window_px=5"),
        ("sobel", "width_px=64"),
        ("fast", "width_px=640"),
        ("nms", "suppression_radius_px=1"),
        ("harris", "width_px=64 tensor_window_px=3"),
        ("harris", "width_px=64 smoothed_gradients=false tensor_window_px=3 harris_k_numerator=5 harris_k_shift=7"),
        ("corners", "width_px=64 smoothed_gradients=false tensor_window_px=3 suppression_radius_px=1"),
        ("corners", "width_px=64 pixels_per_clock=2 detector=fast threshold=12"),
        ("ilbp", "descriptor=thesis-ilbp-4"),
        ("matcher", "lanes=2 descriptor=thesis-ilbp-4 rule_base=ilbp keep_above=127 max_features=512"),
    ],
)
def test_a_block_with_other_settings_equals_the_golden_model(tmp_path: Path, name: str, settings: str) -> None:
    given = dict(each.split("=") for each in settings.split())
    write_block(tmp_path, *find_block(name, given))
    run = simulate(tmp_path, name)
    assert run.returncode == 0, run.stdout
    assert run_cocotb(tmp_path, f"test_{name}").returncode == 0
    readme = (tmp_path / "README.md").read_text().lower()
    assert all(f"`{key}={value}`" in readme for key, value in given.items())


@pytest.mark.usefixtures("unused_blocks")
@pytest.mark.parametrize("name", ["module", "a b", "8bit"])
def test_a_name_that_verilog_has_not_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}' cannot be the name of a Verilog module"):
        write_block(tmp_path / "made", name, find_block("gray")[1])
    assert not (tmp_path / "made").exists()


def test_the_bench_writes_waves_when_asked(tmp_path: Path) -> None:
    write_block(tmp_path, *find_block("gray"))
    assert simulate(tmp_path, "gray").returncode == 0
    assert not list(tmp_path.glob("*.vcd"))
    assert simulate(tmp_path, "gray", "+dump=waves.vcd").returncode == 0
    waves = (tmp_path / "waves.vcd").read_text()
    # The ports of the block inside the bench, with values that change.
    assert re.search(r"\$scope module gray_tb .*\$scope module dut .*\$var wire 1 \S+ o_valid ", waves, re.DOTALL)
    assert waves.count("\n#") > 100


def test_verilator_has_nothing_to_say_about_harris(tmp_path: Path) -> None:
    """Sums and comparisons name the widths of their operands, which Verilog would widen by itself."""
    write_block(tmp_path, *find_block("harris"))
    command = [sys.executable, "-m", "verilator", "--lint-only", "harris.v"]
    lint = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (lint.returncode, lint.stderr) == (0, "")


def test_the_command_writes_a_block_or_says_what_to_choose(tmp_path: Path, run: Run) -> None:
    status, _, error = run("export", "block", "sobel", "-o", "sobel")
    assert status == 0, error
    assert (tmp_path / "sobel" / "sobel_tb.v").exists()
    for wrong, message in (
        (("block", "canny", "-o", "other"), "harris, fast, nms"),
        (("block", "nowhere:Gray", "-o", "other"), "No module named 'nowhere'"),
        (("board", "nexys", "-o", "other"), "unknown board 'nexys'; valid: arty_a7_100"),
        (("block", "sobel", "--lanes", "8", "-o", "other"), "No such option: --lanes"),
        (("--block", "sobel"), "No such option: --block; run skymosaic export --help"),
        ((), "one of board, camera, block, fuzzy"),
    ):
        status, _, error = run("export", *wrong)
        assert status == 2
        # Before it says that it writes.
        assert error.startswith("error: ")
        assert message in only_error(error)
        assert not (tmp_path / "other").exists()


def test_a_block_of_ones_own_is_exported_by_module_and_class(tmp_path: Path) -> None:
    write_block(tmp_path / "component", *find_block("hdl.pixel.gray:Gray"))
    assert "module gray(" in (tmp_path / "component" / "gray.v").read_text()
    write_block(tmp_path / "block", *find_block("tests.hdl.lib.test_lib:wide_product"))
    assert (tmp_path / "block" / "wide_product_tb.v").exists()
    assert all(re.fullmatch(OWN_NAMES, path.name) for path in (tmp_path / "block").iterdir())
    for name, says in {
        "nowhere:Gray": "No module named 'nowhere'",
        "hdl.pixel.gray:Grey": "no attribute 'Grey'",
        "hdl.blocks.export:module_ports": "missing 1 required positional argument: 'top'",
        "pathlib:Path": "no component",
        "asyncio:get_running_loop": "no running event loop",
    }.items():
        with pytest.raises(ValueError, match=says):
            write_block(tmp_path / "none", *find_block(name))
    assert not (tmp_path / "none").exists()
