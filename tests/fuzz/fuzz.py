"""Feeds mutated files to everything that reads files: ``python -m tests.fuzz.fuzz 10000`` prints a report.

Every input must end in a result or in the one-line error of its reader.
"""

import faulthandler
import itertools
import os
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
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


def fuzz(count: int, seed: int = 0) -> tuple[Counter[str], list[str], float]:
    """Feed ``count`` inputs to the targets in turn; input ``n`` depends on the seed and ``n`` alone.

    Returns the number of inputs by target and outcome, what failed, and the longest processor time of an input.
    """
    outcomes, failures, slowest = Counter[str](), list[str](), 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, target) in zip(range(count), itertools.cycle(TARGETS.items()), strict=False):
            started = time.process_time()
            # A decoder in C cannot be interrupted: the traceback says where it hangs, and the process ends.
            faulthandler.dump_traceback_later(MAX_SECONDS, exit=True)
            try:
                outcome = target(Path(folder), np.random.default_rng((seed, number)))
            except EXPECTED as error:
                outcome = "refused" if "\n" not in str(error) else "refused in two lines"
            except Exception:
                outcome = traceback.format_exc()
            seconds = time.process_time() - started
            if seconds > MAX_PROCESSOR_SECONDS or outcome not in ("read", "refused"):
                failures.append(f"{name}, input {number}: {outcome} after {seconds:.1f} s")
            slowest = max(slowest, seconds)
            outcomes[f"{name}, {outcome.partition(' ')[0]}"] += 1
    faulthandler.cancel_dump_traceback_later()
    return outcomes, failures, slowest


@app.command()
def main(count: int, seed: int = 0) -> None:
    """Feed COUNT inputs, and print a report; exit status 1 after a failure."""
    # What libpng, libjpeg and others print about damaged files goes to the descriptor itself. A library that crashes
    # still leaves a traceback.
    faulthandler.enable(os.fdopen(os.dup(2), "w"))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    outcomes, failures, slowest = fuzz(count, seed)
    peak_memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    print(f"inputs {outcomes.total()}, failures {len(failures)}, slowest {slowest:.2f} s, memory {peak_memory_mb} MB")
    print(*(f"  {name}: {times}" for name, times in sorted(outcomes.items())), *failures, sep="\n")
    sys.exit(bool(failures) or peak_memory_mb > MAX_MEMORY_MB)


if __name__ == "__main__":
    app()
