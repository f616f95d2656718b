"""The C++ compiler that turns simulations into programs and shared libraries."""

import itertools
import os
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from golden_model.cache import digest
from sim.backends.errors import BackendError
from sim.backends.interface import Progress

CXX_FLAGS = ("-std=c++17", "-march=native", "-fPIC", "-fvisibility=hidden", "-fno-gnu-unique", "-w")
QUICK_COMPILE = "SKYMOSAIC_QUICK_COMPILE"
"""Environment variable: if it is set, compiling is quick and simulating slow, for tests of a few frames."""


def toolchain_key() -> str:
    """The part of a cache key that every compiled file needs: compiler, machine and flags.

    Raises
    ------
    BackendError
        If no compiler is installed.
    """
    # -### prints the compiler's version and what -march=native means on this machine.
    command = [_compiler(), "-###", "-march=native", "-E", "-x", "c++", os.devnull]
    compiler = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    return digest(compiler, " ".join(CXX_FLAGS))


def optimisation() -> str:
    """The optimisation of what runs in every clock."""
    return "-O1" if os.environ.get(QUICK_COMPILE) else "-O3"


def compile_objects(
    folder: Path, jobs: Sequence[tuple[Path, str]], flags: Sequence[str], progress: Progress
) -> list[Path]:
    """Compile files, each at its own level of optimisation, on all cores; return the object files in ``folder``.

    Raises
    ------
    BackendError
        If the compiler fails, with its first error.
    """
    # The largest first, so that all cores finish at about the same time.
    by_size = sorted(jobs, key=lambda job: job[0].stat().st_size, reverse=True)
    done = itertools.count(1)

    def compile_one(job: tuple[Path, str]) -> Path:
        source, level = job
        target = folder / f"{source.stem}.o"
        run_tool([_compiler(), *CXX_FLAGS, *flags, level, "-c", str(source), "-o", str(target)])
        progress(f"compiled {next(done)} of {len(jobs)} files ({source.name})")
        return target

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(compile_one, by_size))


def link_objects(target: Path, objects: Iterable[Path], *options: str) -> None:
    """Link object files to a program or library; raises the same error as `compile_objects`."""
    run_tool([_compiler(), "-o", str(target), *map(str, objects), *options])


def run_tool(command: Sequence[str], **options: Any) -> None:
    """Run a compiler.

    Raises
    ------
    BackendError
        If it fails, with the first line of its output that contains ``error``.
    """
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    if done.returncode:
        lines = (done.stderr + done.stdout).splitlines()
        reason = next((line for line in lines if "error" in line.lower()), f"exit status {done.returncode}")
        raise BackendError(f"{Path(command[0]).name} failed: {reason}")


def _compiler() -> str:
    path = shutil.which("g++")
    if path is None:
        raise BackendError("g++ is not installed; compiled simulators need it. On Debian and Ubuntu: apt install g++")
    return path
