"""Exports the accelerator for the ULX3S, and builds its bitstream with open tools."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Unpack

from golden_model.config import PRESETS, Config, to_toml
from golden_model.text import how_to_install
from hdl.accelerator import Accelerator
from hdl.export.accelerator import Build, write_host, write_registers
from hdl.export.boards import SOURCES
from hdl.lib.ecp5 import Ecp5
from hdl.netlist import to_verilog
from hdl.registers.register_map import REGISTERS
from hdl.serial.ulx3s import BAUD, CLOCK_HZ, Ulx3s

TOP = "skymosaic_ulx3s"
DEFAULT_BUILD = Build(lanes=4, max_width_px=320, max_height_px=240, video_bits=8)
DEFAULT_CONFIG = dataclasses.replace(
    PRESETS["aerial"], front_end=dataclasses.replace(PRESETS["aerial"].front_end, levels=1, max_features=1024)
)
"""The preset aerial with one level and banks of 1024 features, to need less logic."""
DEVICE = ("--85k", "--package", "CABGA381", "--speed", "6")
BITS_OF_A_BYTE = 10
# Yosys 0.70's ABC9 ends without a word on the ring window; the older ABC takes its place.
SYNTHESIS = (
    f"read_verilog rtl/{TOP}.v; synth_ecp5 -top {TOP} -run begin:map_luts; abc -lut 4:7; clean; "
    f"synth_ecp5 -top {TOP} -run map_cells: -json build/{TOP}.json"
)
STEPS = (
    ("yosys", "-q", "-p", SYNTHESIS),
    (
        "nextpnr-ecp5",
        "-q",
        *DEVICE,
        *("--lpf", "ulx3s.lpf", "--json", f"build/{TOP}.json"),
        *("--textcfg", f"build/{TOP}.config", "--report", "build/report.json"),
    ),
    ("ecppack", "--compress", f"build/{TOP}.config", "build/skymosaic.bit"),
)
"""The tools and their arguments, in the export's folder."""


class BuildError(Exception):
    """A tool is missing or has failed; the message is one line."""


def ulx3s_top(config: Config = DEFAULT_CONFIG, **build: Unpack[Build]) -> Ulx3s:
    """The top for a build; what is left out is as in `DEFAULT_BUILD`."""
    return Ulx3s(Accelerator(config=config, **(DEFAULT_BUILD | build)))


def export_ulx3s(folder: Path, *, config: Config = DEFAULT_CONFIG, **build: Unpack[Build]) -> None:
    """Write Verilog, pins, registers, the host's programs and a README into ``folder``.

    Parameters
    ----------
    folder, config, **build
        As for `hdl.export.accelerator.export`; ``video_bits`` has to be 8.

    Raises
    ------
    ValueError
        For an impossible build.
    OSError
        If the folder cannot be written.
    """
    build = DEFAULT_BUILD | build
    text = to_verilog(ulx3s_top(config, **build), name=TOP, platform=Ecp5(), aliases=False)
    for name in ("rtl", "registers"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "rtl" / f"{TOP}.v").write_text(text)
    shutil.copy(SOURCES / "ulx3s" / "ulx3s.lpf", folder)
    write_registers(folder / "registers", REGISTERS)
    write_host(folder / "host", "serial", config, **build)
    (folder / "config.toml").write_text(to_toml(config))
    area_px = build["max_width_px"] * build["max_height_px"]
    quoted = (f"{tool} {' '.join(repr(each) if ' ' in each else each for each in rest)}" for tool, *rest in STEPS)
    facts = {
        **{name: str(value) for name, value in build.items()},
        "features": str(config.front_end.max_features),
        "baud": f"{BAUD:,}",
        "frame_seconds": f"{BITS_OF_A_BYTE * area_px / BAUD:.2f}",
        "frame_ms": f"{1000 * area_px / CLOCK_HZ:.1f}",
        "commands": "\n".join(["mkdir -p build", *quoted]),
    }
    (folder / "README.md").write_text((SOURCES / "ulx3s" / "README.md").read_text().format(**facts))


def build_bitstream(folder: Path, tell: Callable[[str], None] = lambda _line: None) -> dict[str, Any]:
    """Make ``build/skymosaic.bit`` in the folder of an export; for the whole accelerator a matter of minutes.

    Parameters
    ----------
    folder : Path
    tell : callable
        Receives the name of each tool when it starts.

    Returns
    -------
    dict
        ``bytes`` of the bitstream, ``clock_mhz`` that was reached, and for each kind of cell used and available.

    Raises
    ------
    BuildError
        If a tool is missing or fails, or the board's clock is not reached.
    """
    (folder / "build").mkdir(exist_ok=True)
    for tool, *arguments in STEPS:
        tell(tool)
        done = subprocess.run([_found(tool), *arguments], cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            lines = (done.stderr + done.stdout).splitlines()
            reason = next((line for line in lines if "ERROR" in line), f"exit status {done.returncode}")
            raise BuildError(f"{tool} failed: {reason}")
    report = json.loads((folder / "build" / "report.json").read_text())
    (clock,) = report["fmax"].values()
    if clock["achieved"] * 1e6 < CLOCK_HZ:
        raise BuildError(f"the design reaches {clock['achieved']:.1f} MHz, less than the board's 25; make it smaller")
    return {
        "bytes": (folder / "build" / "skymosaic.bit").stat().st_size,
        "clock_mhz": round(clock["achieved"], 1),
        **{name: (cells["used"], cells["available"]) for name, cells in report["utilization"].items() if cells["used"]},
    }


def _found(tool: str) -> str:
    """The tool of the package in this environment, or of the system."""
    beside = Path(sys.executable).with_name(f"yowasp-{tool}")
    found = str(beside) if beside.exists() else shutil.which(tool)
    if found is None:
        raise BuildError(f"{tool} is not installed; {how_to_install('ulx3s')}")
    return found
