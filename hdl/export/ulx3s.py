"""Exports the accelerator for the ULX3S, and builds its bitstream with open tools."""

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from golden_model.config_file import to_toml
from hdl.blocks.export import write_files
from hdl.build import Build
from hdl.export.accelerator import core_files, fill_readme
from hdl.export.boards import SOURCES
from hdl.export.host import write_host
from hdl.export.tools import BuildError, run_tool
from hdl.lib.ecp5 import Ecp5, synthesis_commands
from hdl.netlist import to_verilog
from hdl.serial.ulx3s import BAUD, CLOCK_HZ, Ulx3s

TOP = "skymosaic_ulx3s"
DEVICE = ("--85k", "--package", "CABGA381", "--speed", "6")
BITS_PER_BYTE = 10
"""On the serial port, with start and stop bit."""
STEPS = (
    ("yosys", "-q", "-p", f"read_verilog rtl/{TOP}.v; {synthesis_commands(TOP)} -json build/{TOP}.json"),
    (
        "nextpnr-ecp5",
        "-q",
        *DEVICE,
        *("--lpf", "ulx3s.lpf", "--json", f"build/{TOP}.json"),
        *("--textcfg", f"build/{TOP}.config", "--report", "build/report.json"),
    ),
    ("ecppack", "--compress", f"build/{TOP}.config", "build/skymosaic.bit"),
)
"""The tools and their arguments, run in the export's folder."""


def export_ulx3s(folder: Path, build: Build) -> None:
    """Write Verilog, pins, registers, host's programs and README of a build with the shell ``serial``."""
    verilog = to_verilog(Ulx3s(build), name=TOP, platform=Ecp5(), aliases=False)
    area_px = build.max_width_px * build.max_height_px
    readme = fill_readme(
        ["ulx3s/README.md"],
        build,
        outputs=", ".join(build.outputs),
        baud=f"{BAUD:,}",
        frame_seconds=f"{BITS_PER_BYTE * area_px / BAUD:.2f}",
        frame_ms=f"{1000 * area_px / CLOCK_HZ:.1f}",
        commands="\n".join(["mkdir -p build", *map(shlex.join, STEPS)]),
    )
    pins = (SOURCES / "ulx3s" / "ulx3s.lpf").read_text()
    files = {"ulx3s.lpf": pins, "config.toml": to_toml(build.config), "README.md": readme}
    write_files(folder, core_files(TOP, verilog, build) | files, build)
    write_host(folder / "host", build)


def build_bitstream(folder: Path, tell: Callable[[str], None] = lambda _name: None) -> dict[str, Any]:
    """Make ``build/skymosaic.bit`` in the folder of an export; the whole accelerator takes minutes.

    Returns
    -------
    dict
        ``bytes`` of the bitstream, the ``clock_mhz`` reached, and the used and available cells of each kind.

    Raises
    ------
    BuildError
        If a tool is missing or fails, or the board's clock is not reached.
    """
    (folder / "build").mkdir(exist_ok=True)
    for tool, *arguments in STEPS:
        tell(tool)
        run_tool(folder, tool, *arguments)
    report = json.loads((folder / "build" / "report.json").read_text())
    (clock,) = report["fmax"].values()
    if clock["achieved"] * 1e6 < CLOCK_HZ:
        raise BuildError(f"the design reaches {clock['achieved']:.2f} MHz, less than the board's 25; make it smaller")
    return {
        "bytes": (folder / "build" / "skymosaic.bit").stat().st_size,
        "clock_mhz": round(clock["achieved"], 1),
        **{name: (cells["used"], cells["available"]) for name, cells in report["utilization"].items() if cells["used"]},
    }
