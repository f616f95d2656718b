"""Feeds mutated files to everything that reads files: ``python -m tests.fuzz.fuzz 10000`` prints a report.

Every input must end in a result or in the one-line error of its reader. What a cache returns must be what was saved.
"""

import contextlib
import faulthandler
import itertools
import os
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import typer

from sim.backends.errors import BackendError
from skymosaic.common.errors import InputError
from tests.fuzz.targets import TARGETS

app = typer.Typer(help=__doc__, add_completion=False)

MAX_PROCESSOR_SECONDS = 20
MAX_SECONDS = 120
"""Wall time of an input that hangs, on a busy machine."""
MAX_MEMORY_MB = 2048
EXPECTED = (InputError, BackendError)


@dataclass
class Report:
    """What became of the inputs.

    Attributes
    ----------
    classes : Counter
        Number of inputs by target and outcome.
    failures : list of str
        Tracebacks, wrong values and inputs that took too long.
    slowest_seconds : float
        Processor time of the slowest input.
    peak_memory_mb : int
        Of the process.
    """

    classes: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    slowest_seconds: float = 0.0
    peak_memory_mb: int = 0

    def text(self) -> str:
        lines = [f"inputs {self.classes.total()}, failures {len(self.failures)}, "]
        lines[0] += f"slowest {self.slowest_seconds:.2f} s, peak memory {self.peak_memory_mb} MB"
        return "\n".join([*lines, *(f"  {name}: {count}" for name, count in sorted(self.classes.items()))])


def fuzz(count: int, seed: int = 0) -> Report:
    """Feed ``count`` inputs to the targets in turn; input ``n`` depends on the seed and ``n`` alone."""
    report = Report()
    with tempfile.TemporaryDirectory() as folder, _cache_in(Path(folder)):
        for number, (name, target) in zip(range(count), itertools.cycle(TARGETS.items()), strict=False):
            started = time.process_time()
            # A decoder in C cannot be interrupted: the traceback says where it hangs, and the process ends.
            faulthandler.dump_traceback_later(MAX_SECONDS, exit=True)
            try:
                outcome = target(Path(folder), np.random.default_rng((seed, number)))
            except EXPECTED as error:
                outcome = "refused" if "\n" not in str(error) else "refused in two lines"
            except Exception:
                outcome = "traceback"
                report.failures.append(f"{name}, input {number}: {traceback.format_exc()}")
            seconds = time.process_time() - started
            if seconds > MAX_PROCESSOR_SECONDS or outcome not in ("read", "refused", "traceback"):
                report.failures.append(f"{name}, input {number}: {outcome} after {seconds:.1f} s")
            report.slowest_seconds = max(report.slowest_seconds, seconds)
            report.classes[f"{name}, {outcome}"] += 1
    faulthandler.cancel_dump_traceback_later()
    report.peak_memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    return report


@contextlib.contextmanager
def _cache_in(folder: Path) -> Iterator[None]:
    """The user's cache is elsewhere meanwhile."""
    before = os.environ.get("XDG_CACHE_HOME")
    os.environ["XDG_CACHE_HOME"] = str(folder / "builds")
    try:
        yield
    finally:
        del os.environ["XDG_CACHE_HOME"]
        if before is not None:
            os.environ["XDG_CACHE_HOME"] = before


@contextlib.contextmanager
def _muted_libraries() -> Iterator[None]:
    """Discard what libpng, libjpeg and others print about damaged files: they write to the descriptor itself."""
    with os.fdopen(os.dup(2), "w") as errors, Path(os.devnull).open("w") as nowhere:
        # A library that crashes still leaves a traceback.
        faulthandler.enable(errors)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(errors.fileno(), 2)
            faulthandler.disable()


@app.command()
def main(count: int, seed: int = 0) -> None:
    """Feed COUNT inputs, and print a report; exit status 1 after a failure."""
    with _muted_libraries():
        report = fuzz(count, seed)
    print(report.text())
    for failure in report.failures:
        print(failure)
    sys.exit(bool(report.failures) or report.peak_memory_mb > MAX_MEMORY_MB)


if __name__ == "__main__":
    app()
