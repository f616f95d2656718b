"""The command that compares the hardware with the golden model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import (
    AddressOption,
    ConfigOption,
    OverwriteOption,
    PresetOption,
    WorkingWidthOption,
    backend_at,
    configuration,
    console,
)
from skymosaic.evaluation.hardware import compare as compare_pair
from skymosaic.imagery.images import check_unused
from skymosaic.registration import WORKING_WIDTH_PX


def compare(
    *,
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")] = False,
    backend: Annotated[str, typer.Option(help="rtl, verilator, cxxrtl, pysim or board.")] = "rtl",
    address: AddressOption = None,
    preset: PresetOption = "aerial",
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    waves: Annotated[
        Path | None, typer.Option(help="VCD file of the simulated run: tens of kilobytes a clock, for small frames.")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Run a pair through the golden model and the hardware; every field of every record has to be equal."""
    if waves:
        check_unused(waves, overwrite=overwrite)
    with console.status("comparing") as status:
        result = compare_pair(
            left,
            right,
            config=configuration(preset, config),
            backend=backend_at(backend, address),
            working_width_px=working_width_px,
            waves=waves,
            progress=status.update,
        )
    if as_json:
        typer.echo(json.dumps(result.summary()))
    else:
        console.print(f"{'NOT EQUAL: ' + str(result.mismatch) if result.mismatch else 'equal'}")
        console.print(f"compared {result.coverage}")
        console.print(f"cycles a frame {', '.join(map(str, result.cycles_per_frame))}")
        console.print(f"{result.cycles_per_second / 1e6:.2f} M cycles/s simulated")
        for note in result.notes:
            console.print(f"proves little: {note}")
    if result.mismatch:
        raise typer.Exit(1)
