"""Area on xc7 by the open Yosys, and the clock that the open nextpnr reaches on an ECP5-85, speed grade 8.

    python -m bench.synthesis area [NAME ...]
    python -m bench.synthesis clock NAME ...

NAMEs choose among the designs; a part of the name is enough.
"""

import json
import re
import statistics
import tempfile
from collections import defaultdict
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from graphlib import TopologicalSorter
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from amaranth import Value
from rich.console import Console

from bench.designs import Design, FewPins, designs, placed_designs
from bench.report import MEASURED, JsonFile, Row, program, report, write
from golden_model.cache import digest
from hdl.export.area import LUTRAM_LUTS, MAPPED, XC7, count_cells
from hdl.export.tools import run_tool
from hdl.lib.ecp5 import Ecp5, synthesis_commands
from hdl.netlist import to_verilog
from tools.yosys import YOSYS

app = program(__doc__)

BRAM36_BITS = 36 * 1024
LOGIC = ("LUT", "CARRY", "MUXF", "INV")
LUTRAM_ADDRESSES = ("A", "DPRA")
"""How cells of logic begin, and the pins of a LUT RAM's addresses; its data and write enable end a path."""
SEEDS = (1, 2, 3)
ECP5 = ("--85k", "--speed", "8", "--package", "CABGA756", "--lpf-allow-unconstrained", "--timing-allow-fail")
PINS = 363
"""Of that package, without clock and reset."""
TARGET_MHZ = 150
ECP5_CELLS = {"LUT": "TRELLIS_COMB", "FF": "TRELLIS_FF", "block RAM": "DP16KD", "multiplier": "MULT18X18D"}
ORIGIN = ("digest", "yosys")
"""Columns that say what was synthesised, and by which version; the documentation leaves them out."""
UNREAD = re.compile(r'\A/\*.*\*/\n|\(\* src = "[^"]*" \*\)\s*')
"""What no figure depends on: the version of the program that wrote the Verilog, and lines of the Python source."""
PORTS = re.compile(r"^(module \S+) ?\(.*\);$", re.MULTILINE)
"""The ports are declared below. Amaranth lists clocks that no component defines in a different order each time."""
RECORDED = MEASURED / "synthesis.json"
COMMAND = "python -m bench.synthesis area"


def measure(design: Design, folder: Path, *, known: Collection[Row] = ()) -> Row:
    """Figures of a design, and their origin: those of a ``known`` row that has the same, or else of a synthesis."""
    verilog = to_verilog(design.build())
    origin = identify(verilog)
    for row in known:
        if origin.items() <= row.items():
            return {key: value for key, value in row.items() if key != "design"}
    return {**synthesise(verilog, folder, design.memory_bits), **origin}


def identify(verilog: str) -> dict[str, str]:
    """What the figures of a design depend on, in the columns of `ORIGIN`.

    The digest is of the Verilog and of the commands that synthesise it.
    """
    read = PORTS.sub(r"\1", UNREAD.sub("", verilog))
    return {"digest": digest(XC7, read), "yosys": version("pyosys")}


def synthesise(verilog: str, folder: Path, memory_bits: int) -> dict[str, float]:
    """Cells and logic levels on xc7.

    The run ends where less memory is left than ``memory_bits``, which the design needs: something was then pruned.
    """
    cells, _ = count_cells(verilog, folder, YOSYS)
    if cells["BRAM36"] * BRAM36_BITS < memory_bits:
        raise SystemExit(f"{cells['BRAM36']} BRAM36 hold less than the {memory_bits} bits of the lines")
    return cells | {"levels": logic_levels(json.loads((folder / MAPPED).read_text())["modules"]["top"])}


def logic_levels(module: dict[str, Any]) -> int:
    """Cells on the longest path between registers, inputs and outputs of a flat module, as ``write_json`` gives it.

    Look-up tables, multiplexers and each carry cell count as one; LUT RAM counts from its address on, since it is read
    without a clock. Flip-flops, shift registers, block RAMs and multipliers begin and end paths.

    Raises
    ------
    graphlib.CycleError
        For a combinational loop.
    """
    drivers, sources = dict[int, str](), defaultdict[str, set[int]](set)
    for name, cell in module["cells"].items():
        is_ram = cell["type"] in LUTRAM_LUTS
        if not is_ram and not cell["type"].startswith(LOGIC):
            continue
        for pin, direction in cell["port_directions"].items():
            # Without constants.
            nets = [net for net in cell["connections"][pin] if isinstance(net, int)]
            if direction == "output":
                drivers |= dict.fromkeys(nets, name)
            elif nets and (not is_ram or pin.startswith(LUTRAM_ADDRESSES)):
                sources[name].update(nets)
    graph = {name: {drivers[net] for net in nets if drivers.get(net) in sources} for name, nets in sources.items()}
    levels: dict[str, int] = {}
    for name in TopologicalSorter(graph).static_order():
        levels[name] = 1 + max((levels[source] for source in graph[name]), default=0)
    return max(levels.values(), default=0)


def place(design: Design, folder: Path) -> Row:
    """Clocks in MHz of the placements on the ECP5, and what is used of its cells."""
    component = design.build()
    if sum(len(Value.cast(port)) for *_, port in component.signature.flatten(component)) > PINS:
        component = FewPins(component)
    (folder / "ecp5.v").write_text(to_verilog(component, platform=Ecp5()), encoding="utf-8")
    run_tool(folder, *YOSYS, "-q", "-p", f"read_verilog ecp5.v; {synthesis_commands('top')} -json ecp5.json")

    def placed(seed: int) -> dict[str, Any]:
        report = f"report{seed}.json"
        options = ("--json", "ecp5.json", "--seed", str(seed), "--freq", str(TARGET_MHZ), "--report", report)
        run_tool(folder, "nextpnr-ecp5", "-q", *ECP5, *options)
        return dict(json.loads((folder / report).read_text()))

    with ThreadPoolExecutor(2) as pool:
        return placement_row(list(pool.map(placed, SEEDS)))


def placement_row(placements: list[dict[str, Any]]) -> Row:
    """Figures of nextpnr's reports; the main clock first, each other one behind its domain's name."""
    used = placements[0]["utilization"]
    clocks = {net.split("$")[2].removesuffix("clk").replace("_", " "): net for net in placements[0]["fmax"]}
    mhz = {domain: [each["fmax"][clocks[domain]]["achieved"] for each in placements] for domain in sorted(clocks)}
    return {
        "MHz by seed": "; ".join(domain + ", ".join(f"{clock:.1f}" for clock in mhz[domain]) for domain in mhz),
        "median": "; ".join(f"{domain}{statistics.median(mhz[domain]):.1f}" for domain in mhz),
        **{heading: used[cell]["used"] for heading, cell in ECP5_CELLS.items()},
    }


def differences(rows: list[Row]) -> list[str]:
    """What differs from the recorded figures, a line for each design."""
    recorded = recorded_rows()
    lines = []
    for row in rows:
        name = str(row["design"])
        known = recorded.get(name, {})
        changed = [
            f"{key} {known.get(key, 'not recorded')} -> {value}"
            for key, value in row.items()
            if key not in ("design", *ORIGIN) and known.get(key) != value
        ]
        if changed:
            lines.append(f"{name}: {', '.join(changed)}")
    return lines


def outdated(rows: list[Row]) -> list[str]:
    """Designs that are recorded with another origin."""
    recorded, measured = recorded_rows(), {str(row["design"]): row for row in rows}
    return [
        name for name, row in measured.items() if any(recorded.get(name, {}).get(key) != row[key] for key in ORIGIN)
    ]


def recorded_rows() -> dict[str, Row]:
    """The recorded figures, by the name of the design."""
    rows = json.loads(RECORDED.read_text(encoding="utf-8"))["rows"] if RECORDED.exists() else []
    return {row["design"]: row for row in rows}


def record(rows: list[Row]) -> None:
    """Replace the figures of these designs, and forget designs that no longer exist."""
    recorded = recorded_rows() | {str(row["design"]): row for row in rows}
    write(RECORDED, COMMAND, [recorded[name] for name in designs() if name in recorded])


def run_designs(
    known: dict[str, Design], names: list[str] | None, figures: Callable[[Design, Path], dict[str, Any]]
) -> list[Row]:
    """A row for each design with one of ``names``, or with such a part of its name (None: all), printed when ready."""
    console = Console()
    rows: list[Row] = []
    for name, design in known.items():
        if not names or any(part == name if part in known else part in name for part in names):
            with tempfile.TemporaryDirectory() as folder, console.status(name):
                rows.append({"design": name, **figures(design, Path(folder))})
            console.print(rows[-1])
    return rows


Names = Annotated[
    list[str] | None, typer.Argument(help="Designs, by name or a part of it; all by default.", metavar="NAME")
]


@app.command()
def area(
    names: Names = None,
    check: Annotated[bool, typer.Option("--check", help="Fail where a figure differs from the recorded one.")] = False,
    update: Annotated[
        bool, typer.Option("--update", help="Record the figures, for the commit that changes them.")
    ] = False,
) -> None:
    """Cells on xc7, and the longest path between registers in cells.

    LUTs hold memory and shift registers too; the columns SRL and LUTRAM say how many. With --check alone, a design is
    not synthesised while its Verilog and Yosys are those of the recorded figures.
    """
    known = recorded_rows().values() if check and not update else ()
    rows = run_designs(designs(), names, partial(measure, known=known))
    report("xc7", rows)
    if update:
        record(rows)
    if check and (changed := differences(rows)):
        raise SystemExit("\n".join([*changed, f"if this is meant, record it: {COMMAND} --update"]))
    if check and (old := outdated(rows)):
        print(f"recorded with other Verilog or another Yosys, with the same figures: {', '.join(old)}")
        print(f"so that the next check need not synthesise them: {COMMAND} --update")


@app.command()
def clock(names: Names = None, json_file: JsonFile = None) -> None:
    """Clocks and cells on the ECP5, of three placements; takes the extra ``ulx3s``."""
    rows = run_designs(designs() | placed_designs(), names, place)
    report("ECP5-85, speed grade 8", rows, json_file, keep_others=bool(names))


if __name__ == "__main__":
    app()
