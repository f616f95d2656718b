"""The command that compares the hardware with the golden model."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import OverwriteOption
from skymosaic.cli.outputs import Writes
from skymosaic.cli.session import session
from skymosaic.common.options import HARDWARE, OUTPUT
from skymosaic.common.temporary import write_atomically
from skymosaic.evaluation.hardware import compare as compare_pair
from skymosaic.imagery.images import check_output
from skymosaic.registration.options import PhotographOptions


def compare(
    *,
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    waves: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=OUTPUT, help="VCD file of the simulated run: tens of kilobytes per clock, for small frames."
        ),
        Writes(),
    ] = None,
    homography: Annotated[
        bool,
        typer.Option(
            "--homography",
            rich_help_panel=HARDWARE,
            help="Take the build that estimates homographies, and compare them, too.",
        ),
    ] = False,
    overwrite: OverwriteOption = False,
    options: PhotographOptions = PhotographOptions(backend="rtl"),
) -> None:
    """Run a pair through the golden model and the hardware; every field of every record has to be equal."""
    if waves:
        check_output(waves, suffixes=(".vcd",), overwrite=overwrite)
    with session.working("comparing") as step, write_atomically(waves) if waves else nullcontext() as path:
        result = compare_pair(left, right, options, homography=homography, waves=path, progress=step)
    session.numbers = result.summary()
    session.seconds = result.stages
    session.show(f"NOT EQUAL: {result.mismatch}" if result.mismatch else "equal")
    session.show(f"compared {result.coverage}")
    session.show(f"cycles per frame {', '.join(map(str, result.cycles_per_frame))}")
    session.show(f"{result.cycles_per_second / 1e6:.2f} M cycles/s simulated")
    if result.timelines:
        session.show("clocks, as predicted")
    for number, timeline in enumerate(result.timelines):
        steps = ", ".join(f"{step.replace('_', ' ')} {clock:,}" for step, clock in timeline.steps())
        session.show(f"  frame {number}: {steps}")
    for note in result.notes:
        session.warn(f"proves little: {note}")
    if waves:
        session.wrote(waves)
    session.status = 1 if result.mismatch else 0
