# amaranth: UnusedElaboratable=no
# Blocks that are refused are never elaborated, of which whoever reads the refusal would be warned, too.
"""Exports one block: Verilog with flat ports, a test bench with vectors, and a README."""

import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from amaranth import Shape
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from golden_model.cache import digest
from golden_model.version import VERSION
from hdl.blocks.catalogue import CATALOGUE, make_block
from hdl.blocks.flat import CLOCK, RESET, FlatBlock
from hdl.blocks.own import make_own
from hdl.blocks.testbench import Port, VerilogBench
from hdl.blocks.vectors import LICENCE, Block, Row
from hdl.netlist import to_verilog
from hdl.templates import render

CORE_VENDOR, CORE_LIBRARY = "skymosaic", "vision"
"""How FuseSoC, IP-XACT and Vivado name the cores, before their name and version."""

IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)


def find_block(name: str, settings: Mapping[str, Any] | None = None, model: str | None = None) -> tuple[str, Block]:
    """Make a block, and its name as a Verilog module.

    Parameters
    ----------
    name : str
        A name in `hdl.blocks.catalogue.CATALOGUE`, or ``MODULE:CLASS`` (`hdl.blocks.own.make_own`).
    settings : mapping, optional
        Values of `hdl.blocks.catalogue.BlockConfig` on which a block of the catalogue depends.
    model : str, optional
        ``MODULE:FUNCTION``, the golden model of a class of one's own.

    Raises
    ------
    ValueError
        For an unknown block or setting, naming the valid ones; for a module, class or function that cannot be used.
    """
    if ":" not in name:
        if model and name in CATALOGUE:
            raise ValueError(f"{name} has a golden model; `model` is for a MODULE:CLASS of your own")
        return name, make_block(name, settings or {})
    if settings:
        raise ValueError(f"{name}: takes no settings; make a function without arguments that returns what you want")
    return name.partition(":")[2].lower(), make_own(name, model)


def write_block(folder: Path, name: str, block: Block, configuration: object = None) -> None:
    """Write a block, made from a ``configuration``, with its test benches; the Verilog module is called ``name``."""
    top = FlatBlock(block.component, block.names)
    # Of names that are words, Yosys escapes those that Verilog keeps for itself.
    verilog = to_verilog(top, name=name, aliases=False) if IDENTIFIER.fullmatch(name) else ""
    if f"module {name}(" not in verilog:
        raise ValueError(f"{name!r} cannot be the name of a Verilog module; give another by `name`")
    ports = module_ports(top)
    # Those of a channel of AXI have its name without an underscore: bus_rvalid.
    prefixes = {each: f"{each}_" if f"{each}_valid" in ports else each for each in (*block.inputs, *block.outputs)}
    bench = VerilogBench(
        module=name,
        ports=ports,
        inputs={prefixes[each]: _name_rows(rows, block.names) for each, rows in block.inputs.items()},
        outputs={prefixes[each]: _name_rows(rows, block.names) for each, rows in block.outputs.items()},
        settings=block.settings,
        spacing_cycles=block.spacing_cycles,
        conditions={prefixes[each]: f"cycle >= {block.start_cycles}" for each in block.inputs},
        memory=block.memory,
    )
    # Without answers there is nothing to check.
    benches = bench.files() if block.outputs else {}
    if benches:
        benches[f"test_{name}.py"] = bench.cocotb_test(block.start_cycles)
    texts = {
        f"{name}.v": verilog,
        f"{name}.core": core_file(name, [f"{name}.v"], list(benches)),
        "README.md": _readme(name, block, top),
    }
    write_files(folder, texts | benches, (configuration, block.parameters), block.licence)


def _name_rows(rows: Sequence[Row], names: Mapping[str, str]) -> list[Row]:
    """The rows of a stream with the names that its ports have in Verilog."""
    return [{names.get(port, port): value for port, value in row.items()} for row in rows]


def write_files(folder: Path, texts: Mapping[str, str], configuration: object, licence: str = LICENCE) -> None:
    """Write an export: files by their paths in ``folder``, licence and notice, and what made the Verilog on top of it.

    Parameters
    ----------
    configuration : object
        What is built; of its ``repr``, the Verilog carries a digest.
    licence : str
        SPDX identifier of the Verilog; empty for what is not of this project.
    """
    # A line break in a name would end the comment.
    command = shlex.join([Path(sys.argv[0]).name.replace("__main__.py", CORE_VENDOR), *sys.argv[1:]])
    head = render(
        "head.v",
        licence=licence,
        version=VERSION,
        command="".join(each if each.isprintable() else ascii(each)[1:-1] for each in command),
        digest=digest(repr(configuration)),
    )
    licences = {name: distribution(CORE_VENDOR).read_text(f"licenses/{name}") or "" for name in ("LICENSE", "NOTICE")}
    for name, text in {**texts, **licences}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(head + text if path.suffix == ".v" else text, encoding="utf-8")


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
