"""Exports the accelerator for the ULX3S, and builds its bitstream with open tools."""

import dataclasses
import json
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Unpack

from golden_model.config import PRESETS, Config
from golden_model.config_file import to_toml
from golden_model.text import how_to_install
from hdl.accelerator import Accelerator
from hdl.export.accelerator import Build, core_files, fill_readme, write_files, write_host
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
BITS_PER_BYTE = 10
"""On the serial port, with start and stop bit."""
# Yosys 0.70's ABC9 crashes silently on the ring window, hence the older ABC.
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
"""The tools and their arguments, run in the export's folder."""


class BuildError(Exception):
    """A tool is missing or has failed; the message is one line."""


def ulx3s_top(config: Config = DEFAULT_CONFIG, **build: Unpack[Build]) -> Ulx3s:
    """The top for a build; the defaults are those in `DEFAULT_BUILD`."""
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
    verilog = to_verilog(ulx3s_top(config, **build), name=TOP, platform=Ecp5(), aliases=False)
    area_px = build["max_width_px"] * build["max_height_px"]
    readme = fill_readme(
        ["ulx3s/README.md"],
        config,
        build,
        baud=f"{BAUD:,}",
        frame_seconds=f"{BITS_PER_BYTE * area_px / BAUD:.2f}",
        frame_ms=f"{1000 * area_px / CLOCK_HZ:.1f}",
        commands="\n".join(["mkdir -p build", *map(shlex.join, STEPS)]),
    )
    pins = (SOURCES / "ulx3s" / "ulx3s.lpf").read_text()
    files = {"ulx3s.lpf": pins, "config.toml": to_toml(config), "README.md": readme}
    write_files(folder, core_files(TOP, verilog, REGISTERS) | files)
    write_host(folder / "host", "serial", config, **build)


def build_bitstream(folder: Path, tell: Callable[[str], None] = lambda _name: None) -> dict[str, Any]:
    """Make ``build/skymosaic.bit`` in the folder of an export; the whole accelerator takes minutes.

    Parameters
    ----------
    folder : Path
    tell : callable
        Receives the name of each tool when it starts.

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
        done = subprocess.run([_find_tool(tool), *arguments], cwd=folder, capture_output=True, text=True, check=False)
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


def _find_tool(tool: str) -> str:
    """Find the tool in this environment (YoWASP's packages), or else on the system."""
    packaged = Path(sys.executable).with_name(f"yowasp-{tool}")
    path = str(packaged) if packaged.exists() else shutil.which(tool)
    if path is None:
        raise BuildError(f"{tool} is not installed; {how_to_install('ulx3s')}")
    return path
