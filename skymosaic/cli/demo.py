"""The command that shows the whole chain on rendered photographs."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from sim.backends.interface import BACKENDS, BackendError
from skymosaic.cli.options import OverwriteOption, choice
from skymosaic.cli.session import session
from skymosaic.demo import Demonstration, compare_hardware, make_demo
from skymosaic.imagery.images import check_unused


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for mosaic, pictures and report.")] = Path(
        "demo"
    ),
    overwrite: OverwriteOption = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rendered landscape.")] = 9,
    backend: Annotated[str, choice(BACKENDS, "Hardware to compare with; golden: none.")] = "rtl",
) -> None:
    """Render a synthetic pair, make its mosaic, and compare it with the truth.

    The simulated hardware is compared with the golden model bit for bit.
    """
    check_unused(output, overwrite=overwrite)
    with session.working("demo") as step:
        made = make_demo(output, seed, step)
    _show(made)
    if backend != "golden":
        _show_hardware(made, backend)


def _show(made: Demonstration) -> None:
    pair = made.pair
    session.seconds.update(made.seconds)
    session.numbers = {"error_px": made.error_px, "pair": pair.summary(), "hardware": None}
    session.show(f"features {len(pair.features[0])} and {len(pair.features[1])}, inliers {len(pair.inliers)}")
    session.show(f"mean homography error {made.error_px:.3f} px")
    session.show(f"photographs {made.photographs[0]} {made.photographs[1]}")
    for name, path in (("mosaic", made.mosaic), ("matches", made.matches), ("report", made.page)):
        session.wrote(path)
        session.show(f"{name:11} {path}")


def _show_hardware(made: Demonstration, backend: str) -> None:
    """Compare the hardware with the golden model; without a compiler, only say that it was not simulated."""
    # What was shown so far is worth seeing before a first compile, which takes a while.
    sys.stdout.flush()
    start = time.perf_counter()
    try:
        with session.working("simulating the hardware") as step:
            result = compare_hardware(made.photographs, backend, step)
    except BackendError as error:
        session.warn(f"hardware not simulated: {error}")
        return
    session.seconds["hardware"] = time.perf_counter() - start
    session.numbers["hardware"] = result.summary()
    session.show(f"hardware    equal to the golden model bit for bit: {result.coverage}")
    session.show(
        f"            {result.cycles_per_frame[0]} clocks a frame, {result.cycles_per_second / 1e6:.2f} M a second"
    )
