"""Compiles the accelerator's Verilog for cocotb and runs modules of cases, on Verilator or Icarus."""

from __future__ import annotations

import subprocess
from importlib.metadata import version
from pathlib import Path

from cocotb_tools.config import libs_dir
from cocotb_tools.runner import Icarus, Runner, Verilator

from golden_model.config import Config, FrontEndConfig
from sim.backends.interface import Progress, silent
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.build_cache import cached, digest
from sim.simulators.verilator import package_folder

CONFIG = Config(front_end=FrontEndConfig(max_features=80))
MAX_SIZE_PX = (160, 128)
LANES = 4
TOP = "top"
CASES = ("access", "frames", "faults", "settings")
SIMULATORS = ("verilator", "icarus")
SEED = 1
TIMESCALE = ("1ns", "1ps")

# Only the ports can be reached: were everything public, Verilator could optimise nothing.
PUBLIC_PORTS = "`verilator_config\n" + "".join(
    f'public_flat_rw -module "{TOP}" -var "{name}"\n' for name in ("a*", "s_axi*", "m_axi*", "interrupt")
)
VERILATOR_FLAGS = (
    "--no-public-flat-rw", "-O3", "--x-assign", "fast", "--x-initial", "fast", "--no-assert", "--output-split", "20000",
    "-Wno-fatal", "-Wno-lint", "-Wno-style", "-Wno-SYMRSVDWORD",
)  # fmt: skip
# GCC finds precompiled headers by -include; without the first word files of larger designs do not compile.
MAKE_VARIABLES = "CFG_CXXFLAGS_PCH_I=-include OPT_FAST=-Og OPT_GLOBAL=-O0"


class _PackagedVerilator(Verilator):
    """Use the Verilator of the Python package, even if another one is on PATH."""

    def _simulator_in_path_build_only(self) -> None:
        self.executable = str(package_folder() / "bin" / "verilator_bin")

    def _set_env_build(self) -> None:
        super()._set_env_build()
        self.env |= {"VERILATOR_ROOT": str(package_folder()), "MAKEFLAGS": MAKE_VARIABLES}

    def _set_env_test(self) -> None:
        super()._set_env_test()
        # A kept build was linked against cocotb in the environment that built it, which may be gone by now.
        self.env["LD_LIBRARY_PATH"] = str(libs_dir)


def run(cases: str, folder: Path, *, simulator: str = "verilator", progress: Progress = silent) -> Path:
    """Run the cases of a module; the build is kept in the user's cache.

    Parameters
    ----------
    cases : str
        The module, as it is imported: ``sim.cocotb.`` and one of `CASES`.
    folder : Path
        To run in.
    simulator : {"verilator", "icarus"}
    progress : callable
        Told of a first build.

    Returns
    -------
    Path
        The results, as JUnit XML.

    Raises
    ------
    SystemExit
        Under pytest, if a case fails; the simulator is not installed; the simulation ends early.
    """
    runner, identity = _TOOLS[simulator]()
    flags = VERILATOR_FLAGS if simulator == "verilator" else ()
    sources = {"ports.vlt": PUBLIC_PORTS} if simulator == "verilator" else {}
    sources["top.v"] = design_accelerator(CONFIG, MAX_SIZE_PX, lanes=LANES).verilog(progress)

    def build(made: Path) -> None:
        for name, text in sources.items():
            (made / name).write_text(text, encoding="utf-8")
        files = [made / name for name in sources]
        runner.build(sources=files, build_args=flags, hdl_toplevel=TOP, build_dir=made, timescale=TIMESCALE)

    key = digest(*sources.values(), *flags, MAKE_VARIABLES, version("cocotb"), identity)
    what = f"the accelerator for cocotb on {simulator}"
    return runner.test(
        cases,
        hdl_toplevel=TOP,
        hdl_toplevel_lang="verilog",
        build_dir=cached(f"cocotb-{simulator}-{key}", build, what=what, progress=progress),
        test_dir=folder,
        results_xml=str(folder / "results.xml"),
        seed=SEED,
        # cocotbext-axi uses names that cocotb 2 deprecates.
        extra_env={"PYTHONWARNINGS": "ignore::DeprecationWarning"},
        timescale=TIMESCALE,
    )


def _verilator() -> tuple[Runner, str]:
    return _PackagedVerilator(), version("verilator")


def _icarus() -> tuple[Runner, str]:
    runner = Icarus()
    return runner, subprocess.run(["iverilog", "-V"], capture_output=True, text=True, check=True).stdout


_TOOLS = {"verilator": _verilator, "icarus": _icarus}
