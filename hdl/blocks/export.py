"""Exports one block: Verilog with flat ports, a test bench with vectors, and a README."""

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from amaranth import Shape
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from golden_model.version import VERSION
from hdl.blocks.catalogue import CATALOGUE
from hdl.blocks.flat import CLOCK, RESET, FlatBlock
from hdl.blocks.testbench import Port, VerilogBench
from hdl.blocks.vectors import Block
from hdl.netlist import to_verilog

CORE_VENDOR, CORE_LIBRARY = "skymosaic", "vision"
"""How FuseSoC, IP-XACT and Vivado name the cores, before their name and version."""


def export_block(folder: Path, name: str) -> None:
    """Write a block into ``folder``, with a test bench where it has vectors.

    Parameters
    ----------
    folder : Path
    name : str
        A name in `hdl.blocks.catalogue.CATALOGUE`; or ``MODULE:CLASS``, a component of one's own, or a function that
        returns a `hdl.blocks.vectors.Block`, both without arguments.

    Raises
    ------
    ValueError
        For an unknown block, naming the valid ones; for a module or class that cannot be used.
    """
    if ":" not in name:
        if name not in CATALOGUE:
            raise ValueError(f"unknown block {name!r}; valid: {', '.join(CATALOGUE)}, or MODULE:CLASS of your own")
        write_block(folder, name, CATALOGUE[name]())
        return
    own, name = _make_own(name), name.partition(":")[2].lower()
    if isinstance(own, Block):
        write_block(folder, name, own)
        return
    write_files(folder, {f"{name}.v": to_verilog(FlatBlock(own), name=name, aliases=False)})


def _make_own(path: str) -> Block | wiring.Component:
    """Make a block of one's own from its module and its class or function."""
    module, _, maker = path.partition(":")
    try:
        made = getattr(importlib.import_module(module), maker)()
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}; give MODULE:CLASS that takes no arguments") from None
    if isinstance(made, Block | wiring.Component):
        return made
    raise ValueError(f"{path}: makes a {type(made).__name__}, no component and no block with vectors")


def write_block(folder: Path, name: str, block: Block) -> None:
    """Write a block and its test bench into ``folder``; the Verilog module is called ``name``."""
    top = FlatBlock(block.component)
    bench = VerilogBench(
        module=name,
        ports=module_ports(top),
        inputs={f"{each}_": rows for each, rows in block.inputs.items()},
        outputs={f"{each}_": rows for each, rows in block.outputs.items()},
        settings=block.settings,
        spacing_cycles=block.spacing_cycles,
    )
    bench_files = bench.files()
    files = {f"{name}.v": to_verilog(top, name=name, aliases=False), **bench_files}
    files[f"{name}.core"] = core_file(name, [f"{name}.v"], list(bench_files))
    files["README.md"] = _readme(name, block, top)
    write_files(folder, files)


def write_files(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files by their paths in ``folder``."""
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def core_file(name: str, sources: Sequence[str], bench: Sequence[str]) -> str:
    """Describe a module for FuseSoC (CAPI2): ``sim`` runs its test bench in Icarus, ``lint`` checks it in Verilator."""
    files = [f"      - {file}: {{file_type: systemVerilogSource}}" for file in bench if file.endswith(".v")]
    # FuseSoC runs the simulator in another folder, where $readmemh then looks for the vectors.
    files += [
        f"      - {file}: {{file_type: user, copyto: {Path(file).name}}}" for file in bench if file.endswith(".hex")
    ]
    lines = [
        "CAPI=2:",
        f"name: {CORE_VENDOR}:{CORE_LIBRARY}:{name}:{VERSION}",
        f"description: {name} of the vision front end skymosaic",
        "filesets:",
        "  rtl:",
        f"    files: [{', '.join(sources)}]",
        "    file_type: verilogSource",
        "  bench:",
        "    files:",
        *files,
        "targets:",
        f"  default: {{filesets: [rtl], toplevel: {name}}}",
        "  sim:",
        "    default_tool: icarus",
        "    filesets: [rtl, bench]",
        f"    toplevel: {name}_tb",
        "    tools: {icarus: {iverilog_options: [-g2012]}}",
        "  lint:",
        "    default_tool: verilator",
        "    filesets: [rtl]",
        f"    toplevel: {name}",
        # Yosys writes Verilog that warns of widths and names.
        "    tools: {verilator: {mode: lint-only, verilator_options: [-Wno-fatal]}}",
    ]
    return "\n".join(lines) + "\n"


def module_ports(top: wiring.Component) -> dict[str, Port]:
    """List the ports of a component whose members are plain signals."""
    members = top.signature.members
    return {name: Port(Shape.cast(member.shape).width, member.flow == In) for name, member in members.items()}


def _readme(name: str, block: Block, top: FlatBlock) -> str:
    lines = [
        f"# {name}",
        "",
        f"{block.description} Verilog of one block of skymosaic, made from its Python source, with a test bench whose "
        "vectors come from the golden model.",
        "",
        "```",
        f"iverilog -g2012 -o {name}_tb {name}.v {name}_tb.v && vvp -n {name}_tb",
        "```",
        "",
        "prints `PASS`. The bench sends unknowns (X) where nothing is valid. Its vectors are `*.hex`; "
        "`*_specified.hex` have a 1 for each bit of the answers that is compared. "
        f"`{name}.core` describes module and bench for FuseSoC.",
        "",
        f"Clock `{CLOCK}`, synchronous reset `{RESET}`, active high. Data of a stream are taken in a clock in which "
        "`valid` and `ready` are high; without a `ready`, in every clock with `valid`.",
    ]
    if "i_x" in top.signature.members:
        lines += [
            "",
            "`x`, `y` are the position of the pixel that entered last. Answers are not specified where a window leaves "
            "the frame.",
        ]
    # Streams have no fixed latency, and blocks without a window no lag.
    lag_px, latency_cycles = (getattr(block.component, each, None) for each in ("lag_px", "latency_cycles"))
    if lag_px:
        lines += ["", f"An answer at (x, y) is that of the pixel (x - {lag_px}, y - {lag_px})."]
    if latency_cycles:
        lines += ["", f"Latency: {latency_cycles} clocks."]
    if block.spacing_cycles > 1:
        lines += ["", f"Inputs come at least {block.spacing_cycles} clocks apart."]
    lines += ["", "| port | direction | bits |", "|---|---|---|"]
    for port, member in top.signature.members.items():
        signed = " (signed)" if getattr(top, port).shape().signed else ""
        lines.append(f"| `{port}` | {member.flow.name.lower()} | {getattr(top, port).shape().width}{signed} |")
    return "\n".join(lines) + "\n"
