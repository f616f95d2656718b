"""The command that shows the whole chain on rendered photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import OverwriteOption, console
from skymosaic.demo import run_demo
from skymosaic.imagery.images import check_unused


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for mosaic, pictures and report.")] = Path(
        "demo"
    ),
    overwrite: OverwriteOption = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rendered landscape.")] = 9,
    backend: Annotated[str, typer.Option(help="Hardware to compare with: rtl, cxxrtl ...; golden: none.")] = "rtl",
) -> None:
    """Render a synthetic pair, make its mosaic, and compare it with the truth.

    The simulated hardware is compared with the golden model bit for bit.
    """
    check_unused(output, overwrite=overwrite)
    run_demo(output, seed, backend, console)
