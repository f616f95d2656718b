"""Compiles the accelerator's Verilog for cocotb and runs modules of cases, on Verilator or Icarus.

cocotb re-enters Python at every clock, so frames are small here; whole ones belong to `sim.simulators.verilator`.
"""

import subprocess
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from cocotb_tools.config import libs_dir, share_dir
from cocotb_tools.runner import Icarus, Verilator

from golden_model.cache import digest
from golden_model.config import Config, FrontEndConfig
from hdl.build import Build
from sim.backends.interface import Progress, silent
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.build_cache import build_once, keep_only
from sim.simulators.compiler import compile_objects, link_objects, toolchain_key
from sim.simulators.verilator import VERILATOR_FLAGS, runtime_folder, runtime_includes, translate

CONFIG = Config(front_end=FrontEndConfig(descriptor="thesis-ilbp-1", levels=1, border_px=10, max_features=36))
MAX_SIZE_PX = (96, 80)
BUILD = Build(config=CONFIG, lanes=2, max_width_px=MAX_SIZE_PX[0], max_height_px=MAX_SIZE_PX[1])
TOP = "top"
CASES = ("access", "frames", "faults", "settings")
SEED = 1
TIMESCALE = ("1ns", "1ps")

# Only the ports can be reached: were everything public, Verilator could optimise nothing.
PUBLIC_PORTS = "`verilator_config\n" + "".join(
    f'public_flat_rw -module "{TOP}" -var "{name}"\n' for name in ("a*", "s_axi*", "m_axi*", "interrupt")
)
VERILATOR_RUNTIME = ("verilated.cpp", "verilated_dpi.cpp", "verilated_threads.cpp", "verilated_vpi.cpp")


def run(
    cases: str | Sequence[str],
    folder: Path,
    *,
    only: Sequence[str] | None = None,
    simulator: str = "verilator",
    progress: Progress = silent,
) -> Path:
    """Run the cases of modules; the build is kept in the user's cache.

    Parameters
    ----------
    cases : str or sequence of str
        Modules, as they are imported: ``tests.cocotb.`` and each of `CASES`.
    folder : Path
        To run in.
    only : sequence of str, optional
        Names of the cases to run; without it, all.
    simulator : {"verilator", "icarus"}
    progress : callable
        Receives lines of text about a first build.

    Returns
    -------
    Path
        The results, as JUnit XML.

    Raises
    ------
    SystemExit
        Under pytest, if a case fails; the simulator is not installed; the simulation ends early.
    """
    runner = Verilator() if simulator == "verilator" else Icarus()
    verilog = design_accelerator(BUILD).verilog(progress)

    def build(folder: Path) -> None:
        (folder / "top.v").write_text(verilog, encoding="utf-8")
        if simulator == "verilator":
            _build_with_verilator(folder, progress)
        else:
            runner.build(sources=[folder / "top.v"], hdl_toplevel=TOP, build_dir=folder, timescale=TIMESCALE)

    tools = _identify_verilator() if simulator == "verilator" else _identify_icarus()
    key = digest(verilog, Path(__file__).read_text(encoding="utf-8"), version("cocotb"), tools)
    what = f"the accelerator for cocotb on {simulator}"
    return runner.test(
        cases,
        testcase=only,
        hdl_toplevel=TOP,
        hdl_toplevel_lang="verilog",
        build_dir=build_once(f"cocotb-{simulator}-{key}", build, what=what, progress=progress),
        test_dir=folder,
        results_xml=str(folder / "results.xml"),
        seed=SEED,
        # cocotbext-axi uses names that cocotb 2 deprecates.
        extra_env={"PYTHONWARNINGS": "ignore::DeprecationWarning"},
        timescale=TIMESCALE,
    )


def _build_with_verilator(folder: Path, progress: Progress) -> None:
    """Compile ``top.v`` without cocotb's makefile, which splits paths with spaces."""
    (folder / "ports.vlt").write_text(PUBLIC_PORTS, encoding="utf-8")
    flags = [*VERILATOR_FLAGS, "--output-split", "20000", "--vpi", "--top-module", TOP, "-Wno-SYMRSVDWORD"]
    # Together and not optimised: compiling takes half as long, and cocotb most of the time of a simulation.
    jobs = [(path, "-O0") for path, _ in translate(folder, [folder / "ports.vlt", folder / "top.v"], flags)]
    runtime = [*(runtime_folder() / name for name in VERILATOR_RUNTIME), share_dir / "lib/verilator/verilator.cpp"]
    (folder / "runtime.cpp").write_text("".join(f'#include "{path}"\n' for path in runtime), encoding="utf-8")
    jobs.append((folder / "runtime.cpp", "-O0"))
    # cocotb's library calls functions of the runtime.
    cxx_flags = [f"-I{folder}", *runtime_includes(), "-fvisibility=default"]
    objects = compile_objects(folder, jobs, cxx_flags, progress)
    library = [f"-L{libs_dir}", "-lcocotbvpi_verilator", "-Xlinker", "-rpath", "-Xlinker", str(libs_dir)]
    link_objects(folder / TOP, objects, *library, "-lpthread")
    keep_only(folder, TOP)


def _identify_verilator() -> str:
    # The program finds cocotb's library in the environment that built it.
    return f"{version('verilator')} {toolchain_key()} {libs_dir}"


def _identify_icarus() -> str:
    return subprocess.run(["iverilog", "-V"], capture_output=True, text=True, check=True).stdout
