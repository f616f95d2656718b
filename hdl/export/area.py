"""Area of a design on xc7, by Yosys."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from amaranth.lib import wiring

from hdl.export.tools import run_tool
from hdl.netlist import to_verilog

XC7 = "read_verilog top.v; synth_xilinx -family xc7 -flatten -noiopad -noclkbuf -top top"
LUTRAM_LUTS = {"RAM32M": 4, "RAM64M": 4, "RAM32X1D": 2, "RAM64X1D": 2, "RAM128X1D": 4, "RAM256X1S": 4}
MAPPED = "mapped.json"
"""The netlist that a synthesis leaves, as ``write_json`` gives it."""


def count_cells(verilog: str, folder: Path, yosys: Sequence[str] = ("yosys",)) -> tuple[dict[str, float], str]:
    """The cells of a design whose module is ``top``, and the version of Yosys that has counted them.

    Raises
    ------
    hdl.export.tools.BuildError
        If Yosys is missing or fails.
    """
    (folder / "top.v").write_text(verilog, encoding="utf-8")
    run_tool(folder, *yosys, "-q", "-p", f"{XC7}; tee -q -o area.json stat -json; write_json {MAPPED}")
    counted = json.loads((folder / "area.json").read_text())
    cells = Counter(counted["design"]["num_cells_by_type"])
    srl = cells["SRL16E"] + cells["SRLC32E"]
    lutram = sum(luts * cells[cell] for cell, luts in LUTRAM_LUTS.items())
    return {
        "LUT": sum(cells[f"LUT{inputs}"] for inputs in range(1, 7)) + srl + lutram,
        "SRL": srl,
        "LUTRAM": lutram,
        "FF": sum(cells[cell] for cell in ("FDRE", "FDSE", "FDCE", "FDPE")),
        "DSP": cells["DSP48E1"],
        "BRAM36": cells["RAMB36E1"] + cells["RAMB18E1"] / 2,
    }, counted["creator"].partition(" (")[0]


def describe_area(component: wiring.Component) -> str:
    """What a component takes, and by which Yosys, as a line; by that of the extra ``ulx3s`` or of the system."""
    with TemporaryDirectory() as folder:
        cells, version = count_cells(to_verilog(component), Path(folder))
    return (
        f"area on xc7 by {version}: {cells['LUT']} look-up tables, {cells['FF']} registers, {cells['DSP']} DSP, "
        f"{cells['BRAM36']:g} block RAMs of 36 Kbit"
    )
