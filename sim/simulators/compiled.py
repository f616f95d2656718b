"""Designs compiled to shared libraries: the part that Verilator and CXXRTL have in common.

Each simulator turns a design into C++ in its own way. ``harness/harness.cpp`` streams whole frames through it in one
loop, and `Bench` calls that loop through ctypes.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import itertools
import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.backends.interface import BackendError, Progress, silent
from sim.simulators.build_cache import digest, digest_files
from sim.simulators.design import Design, Ports
from sim.simulators.recording import NO_PAUSES, Output, Pauses, Recording, Segment, check_access

HARNESS = Path(__file__).parents[1] / "harness"
LIBRARY_NAME = "simulator.so"
CXX_FLAGS = (
    "-std=c++17", "-march=native", "-fPIC", "-fvisibility=hidden", "-fno-gnu-unique", "-DCXXRTL_NDEBUG", "-w",
)  # fmt: skip

QUICK_COMPILE = "SKYMOSAIC_QUICK_COMPILE"
"""Environment variable: if it is set, compiling is quick and simulating slow, for tests of a few frames."""


def identity() -> str:
    """The part of a library's cache key that does not depend on its design: tools, optimisation and harness."""
    return digest(toolchain(), _optimisation(), digest_files(HARNESS.iterdir()))


def toolchain() -> str:
    """The part of a cache key that every compiled file needs: compiler, machine and flags."""
    # -### prints the compiler's version and what -march=native means on this machine.
    command = [_compiler(), "-###", "-march=native", "-E", "-x", "c++", os.devnull]
    compiler = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    return digest(compiler, " ".join(CXX_FLAGS))


@dataclass(frozen=True)
class Sources:
    """The sources of a library besides the harness.

    Parameters
    ----------
    model : str
        Name of the harness's header for the simulator.
    includes : tuple of Path
        Folders of headers.
    each_cycle : tuple of Path
        C++ files that run in each cycle; compiled with full optimisation, or with less if `QUICK_COMPILE` is set.
    others : tuple of Path
        Other C++ files.
    rare : tuple of Path
        C++ files that run when a simulation opens, or never; compiled without optimisation.
    objects : tuple of Path
        Object files of `compile_objects`.
    harness : str
        The file of `HARNESS` that runs the model.
    """

    model: str
    includes: tuple[Path, ...]
    each_cycle: tuple[Path, ...] = ()
    others: tuple[Path, ...] = ()
    rare: tuple[Path, ...] = ()
    objects: tuple[Path, ...] = ()
    harness: str = "harness.cpp"


def compile_library(folder: Path, sources: Sources, *, waves: bool, progress: Progress) -> None:
    """Compile ``sources`` and the harness on all cores; link them to ``folder / LIBRARY_NAME``.

    Raises
    ------
    BackendError
        If the compiler fails, with its first error.
    """
    flags = [f'-DMODEL="{sources.model}"', *(f"-I{path}" for path in (HARNESS, *sources.includes))]
    if waves:
        flags += ["-DWAVES", "-DVM_TRACE=1", "-DVM_TRACE_VCD=1"]
    jobs = [(path, _optimisation()) for path in (HARNESS / sources.harness, *sources.each_cycle)]
    jobs += [(path, "-O1") for path in sources.others]
    jobs += [(path, "-O0") for path in sources.rare]
    made = compile_objects(folder, jobs, flags, progress)
    linked = map(str, (*made, *sources.objects))
    run_tool([_compiler(), "-shared", "-o", str(folder / LIBRARY_NAME), *linked])
    for path in made:
        path.unlink()


def compile_objects(
    folder: Path, jobs: Sequence[tuple[Path, str]], flags: Sequence[str], progress: Progress
) -> list[Path]:
    """Compile files, each at its own level of optimisation, on all cores; return the object files in ``folder``.

    Raises
    ------
    BackendError
        If the compiler fails, with its first error.
    """
    # The largest first: the cores end together.
    by_size = sorted(jobs, key=lambda job: job[0].stat().st_size, reverse=True)
    done = itertools.count(1)

    def compile_one(job: tuple[Path, str]) -> Path:
        source, optimisation = job
        target = folder / f"{source.stem}.o"
        run_tool([_compiler(), *CXX_FLAGS, *flags, optimisation, "-c", str(source), "-o", str(target)])
        progress(f"compiled {next(done)} of {len(jobs)} files ({source.name})")
        return target

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(compile_one, by_size))


def _optimisation() -> str:
    return "-O1" if os.environ.get(QUICK_COMPILE) else "-O3"


def _compiler() -> str:
    path = shutil.which("g++")
    if path is None:
        raise BackendError("g++ is not installed; compiled simulators need it. On Debian and Ubuntu: apt install g++")
    return path


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


def ports_header(ports: Ports, mangle: Callable[[str], str]) -> str:
    """``ports.hpp`` for the harness; ``mangle`` maps the name of a port, or a prefix of names, to its C++ name."""

    def prefix_macros(kind: str, prefixes: Sequence[str]) -> list[str]:
        macros = [f"#define {kind}_{i}(member) {mangle(prefix + '_')}##member" for i, prefix in enumerate(prefixes)]
        return [*macros, f"#define {kind}S(X) " + " ".join(f"X({i}, {kind}_{i})" for i in range(len(prefixes)))]

    settings = " ".join(f"X({i}, {mangle(name)})" for i, name in enumerate(ports.settings))
    control = [f"#define CONTROL(member) {mangle(ports.control + '_')}##member"] if ports.control else []
    return "\n".join(
        [
            f"#define VIDEO(member) {mangle(ports.video + '_')}##member",
            *prefix_macros("OUTPUT", ports.outputs),
            *prefix_macros("TAP", ports.taps),
            *control,
            f"#define SETTINGS(X) {settings}\n",
        ]
    )


class _Request(ctypes.Structure):
    """``struct Request`` of harness.cpp."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("flags", ctypes.c_void_p),
        ("beats", ctypes.c_uint64),
        ("packets", ctypes.c_uint64),
        ("cycle_limit", ctypes.c_uint64),
        ("gaps", ctypes.c_uint32),
        ("stalls", ctypes.c_uint32),
        ("seed", ctypes.c_uint32),
    )


class Bench:
    """A running model of a compiled design; it starts just after a reset.

    Parameters
    ----------
    library : Path
        The shared library.
    ports : Ports
        The ports that it was compiled for.
    waves : Path or None
        VCD file to write; the library must have been compiled for waves.
    """

    def __init__(self, library: Path, ports: Ports, waves: Path | None = None):
        self.ports = ports
        self._library = _load(library)
        self._bench = self._library.bench_open(os.fsencode(waves or ""))

    def close(self) -> None:
        """End the simulation and close the wave file."""
        self._library.bench_close(self._bench)

    def reset(self) -> None:
        """Reset the design, in whatever state it is."""
        self._library.bench_reset(self._bench)

    def write(self, address: int, value: int) -> None:
        """Write a register.

        Raises
        ------
        BackendError
            If the design refuses the access or does not answer.
        """
        check_access("write", address, self._library.bench_write(self._bench, address, value))

    def read(self, address: int) -> int:
        """Read a register; raises the same errors as `write`."""
        value = ctypes.c_uint32()
        check_access("read", address, self._library.bench_read(self._bench, address, ctypes.byref(value)))
        return value.value

    def run(self, segment: Segment, pauses: Pauses = NO_PAUSES) -> Recording:
        """Stream a segment through the design.

        Raises
        ------
        ValueError
            For a setting that does not exist or whose value has too many bits.
        BackendError
            If the design does not finish within the segment's cycle limit.
        """
        is_done, recording = self.stream(segment, pauses)
        if not is_done:
            raise segment.overdue(self.cycle)
        return recording

    @property
    def cycle(self) -> int:
        """Clocks since the last reset."""
        return int(self._library.bench_cycle(self._bench))

    def stream(self, segment: Segment, pauses: Pauses) -> tuple[bool, Recording]:
        """As `run`, but at the cycle limit it returns what has come so far, and whether that was all."""
        self.ports.check(segment.settings)
        if segment.reset:
            self.reset()
        for index, name in enumerate(self.ports.settings):
            if name in segment.settings:
                self._library.bench_set(self._bench, index, segment.settings[name])
        for address, value in segment.writes:
            self.write(address, value)
        data, flags = np.ascontiguousarray(segment.data, np.uint64), np.ascontiguousarray(segment.flags, np.uint8)
        request = _Request(
            data.ctypes.data, flags.ctypes.data, data.size, segment.packets, segment.cycle_limit,
            pauses.gaps, pauses.stalls, pauses.seed,
        )  # fmt: skip
        is_done = bool(self._library.bench_run(self._bench, ctypes.byref(request)))
        return is_done, self._recording()

    def _recording(self) -> Recording:
        names = (*self.ports.outputs, *self.ports.taps)
        words = {name: self._copy("bench_words", index) for index, name in enumerate(names)}
        return Recording(
            self._copy("bench_starts"),
            {
                name: Output(words[name], self._copy("bench_ends", index).reshape(-1, 2))
                for index, name in enumerate(self.ports.outputs)
            },
            {name: words[name] for name in self.ports.taps},
        )

    def _copy(self, function: str, *stream: int) -> NDArray[np.uint64]:
        values = ctypes.POINTER(ctypes.c_uint64)()
        count = getattr(self._library, function)(self._bench, *stream, ctypes.byref(values))
        size = count * (2 if function == "bench_ends" else 1)
        return np.ctypeslib.as_array(values, (size,)).copy() if size else np.empty(0, np.uint64)


@functools.cache
def _load(library: Path) -> ctypes.CDLL:
    loaded = ctypes.CDLL(str(library))
    pointer, values = ctypes.c_void_p, ctypes.POINTER(ctypes.POINTER(ctypes.c_uint64))
    signatures: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "bench_open": (pointer, (ctypes.c_char_p,)),
        "bench_close": (None, (pointer,)),
        "bench_reset": (None, (pointer,)),
        "bench_set": (None, (pointer, ctypes.c_int, ctypes.c_uint64)),
        "bench_run": (ctypes.c_bool, (pointer, ctypes.POINTER(_Request))),
        "bench_cycle": (ctypes.c_uint64, (pointer,)),
        "bench_starts": (ctypes.c_uint64, (pointer, values)),
        "bench_words": (ctypes.c_uint64, (pointer, ctypes.c_int, values)),
        "bench_ends": (ctypes.c_uint64, (pointer, ctypes.c_int, values)),
    }
    if hasattr(loaded, "bench_write"):
        signatures["bench_write"] = (ctypes.c_int, (pointer, ctypes.c_uint32, ctypes.c_uint32))
        signatures["bench_read"] = (ctypes.c_int, (pointer, ctypes.c_uint32, ctypes.POINTER(ctypes.c_uint32)))
    for name, (result, arguments) in signatures.items():
        function = getattr(loaded, name)
        function.restype, function.argtypes = result, arguments
    return loaded


def simulate(
    library: Callable[..., Path],
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
    library : callable
        Builds the shared library of ``design``, as `sim.simulators.verilator.shared_library`.
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
    built = library(design, waves=waves is not None, progress=progress)
    with contextlib.closing(Bench(built, design.ports, waves)) as bench:
        return [bench.run(segment, pauses) for segment in segments]
