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
from hdl.blocks.vectors import Block, Row
from hdl.netlist import to_verilog
from hdl.templates import render

CORE_VENDOR, CORE_LIBRARY = "skymosaic", "vision"
"""How FuseSoC, IP-XACT and Vivado name the cores, before their name and version."""


def find_block(name: str) -> tuple[str, Block | wiring.Component]:
    """Make a block, and its name as a Verilog module.

    Parameters
    ----------
    name : str
        A name in `hdl.blocks.catalogue.CATALOGUE`; or ``MODULE:CLASS``, a component of one's own, or a function that
        returns a `hdl.blocks.vectors.Block`, both without arguments.

    Raises
    ------
    ValueError
        For an unknown block, naming the valid ones; for a module or class that cannot be used.
    """
    if ":" in name:
        return name.partition(":")[2].lower(), _make_own(name)
    if name not in CATALOGUE:
        raise ValueError(f"unknown block {name!r}; valid: {', '.join(CATALOGUE)}, or MODULE:CLASS of your own")
    return name, CATALOGUE[name]()


def _make_own(path: str) -> Block | wiring.Component:
    module, _, maker = path.partition(":")
    try:
        made = getattr(importlib.import_module(module), maker)()
    # Whatever the user's module raises.
    except Exception as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}; give MODULE:CLASS that takes no arguments") from None
    if isinstance(made, Block | wiring.Component):
        return made
    raise ValueError(f"{path}: makes a {type(made).__name__}, no component and no block with vectors")


def write_block(folder: Path, name: str, block: Block | wiring.Component) -> None:
    """Write a block and its test bench into ``folder``; the Verilog module is called ``name``."""
    if not isinstance(block, Block):
        write_files(folder, {f"{name}.v": to_verilog(FlatBlock(block), name=name, aliases=False)})
        return
    top = FlatBlock(block.component, block.names)
    bench = VerilogBench(
        module=name,
        ports=module_ports(top),
        inputs=_name_rows(block.inputs, block.names),
        outputs=_name_rows(block.outputs, block.names),
        settings=block.settings,
        spacing_cycles=block.spacing_cycles,
    )
    bench_files = bench.files()
    files = {f"{name}.v": to_verilog(top, name=name, aliases=False), **bench_files}
    files[f"{name}.core"] = core_file(name, [f"{name}.v"], list(bench_files))
    files["README.md"] = _readme(name, block, top)
    write_files(folder, files)


def _name_rows(streams: Mapping[str, Sequence[Row]], names: Mapping[str, str]) -> dict[str, list[Row]]:
    """The rows of each stream, by its prefix, with the names that its ports have in Verilog."""
    return {
        f"{stream}_": [{names.get(port, port): value for port, value in row.items()} for row in rows]
        for stream, rows in streams.items()
    }


def write_files(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files by their paths in ``folder``."""
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def core_file(name: str, sources: Sequence[str], bench: Sequence[str]) -> str:
    """Describe a module for FuseSoC (CAPI2): ``sim`` runs its test bench in Icarus, ``lint`` checks it in Verilator."""
    names = {"vendor": CORE_VENDOR, "library": CORE_LIBRARY, "name": name, "version": VERSION}
    return render("fusesoc.core", sources=sources, bench=bench, **names)


def module_ports(top: wiring.Component) -> dict[str, Port]:
    """List the ports of a component whose members are plain signals."""
    members = top.signature.members
    return {name: Port(Shape.cast(member.shape).width, member.flow == In) for name, member in members.items()}


def _readme(name: str, block: Block, top: FlatBlock) -> str:
    return render(
        "block_readme.md",
        name=name,
        block=block,
        clock=CLOCK,
        reset=RESET,
        ports=module_ports(top),
        signed=[port for port in top.signature.members if getattr(top, port).shape().signed],
        # Streams have no fixed latency, and blocks without a window no lag.
        lag_px=getattr(block.component, "lag_px", None),
        latency_cycles=getattr(block.component, "latency_cycles", None),
    )
