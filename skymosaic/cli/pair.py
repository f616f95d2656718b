"""The commands for a pair of photographs: demo, register, and the mosaic of two."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from golden_model.arrays import Pixels
from skymosaic.cli.options import (
    AddressOption,
    BackendOption,
    ConfigOption,
    DescriptorOption,
    DetectorOption,
    EstimatorOption,
    PresetOption,
    RefineOption,
    SeedOption,
    WorkingWidthOption,
    backend_at,
    configuration,
    console,
)
from skymosaic.demo import run_demo
from skymosaic.errors import RegistrationError
from skymosaic.imagery import images
from skymosaic.mosaicing import mosaic_of_pair
from skymosaic.registration import WORKING_WIDTH_PX, Pair
from skymosaic.registration import register as register_pair
from skymosaic.reports import pair as pair_report


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for mosaic, pictures and report.")] = Path(
        "demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the rendered landscape.")] = 9,
    backend: Annotated[str, typer.Option(help="Hardware to compare with: rtl, cxxrtl ...; golden: none.")] = "rtl",
) -> None:
    """Render a synthetic flight, make its mosaic, hold it against the truth and the hardware against its model."""
    run_demo(output, seed, backend, console)


def mosaic_pair(
    photographs: Sequence[Path | Pixels],
    output: Path,
    report_folder: Path | None,
    *,
    blending: str,
    scale: float,
    **registration: Any,
) -> None:
    """Make the mosaic of two photographs; ``registration`` are options of `skymosaic.registration.register`."""
    if report_folder:
        pair_report.prepare(report_folder)
    with console.status("registering") as status:
        pair = register_pair(*photographs, **registration)
        result = None
        try:
            status.update("warping and blending")
            result = mosaic_of_pair(pair, blending=blending, scale=scale)
            status.update("writing")
            images.save(output, result.image)
        finally:
            # The report matters most where registration failed: it shows why.
            if report_folder:
                pair_report.write_pair_report(report_folder, pair, result.image if result else None)
    _print_pair(pair)
    height_px, width_px = result.image.shape[:2]
    console.print(f"mosaic {output} ({width_px}x{height_px})" + (f", report {report_folder}" if report_folder else ""))


def register(
    *,
    left: Annotated[Path, typer.Argument(help="Left photograph.")],
    right: Annotated[Path, typer.Argument(help="Right photograph.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")] = False,
    preset: PresetOption = "aerial",
    detector: DetectorOption = None,
    descriptor: DescriptorOption = None,
    estimator: EstimatorOption = "prosac",
    backend: BackendOption = "golden",
    address: AddressOption = None,
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    seed: SeedOption = 0,
    refine: RefineOption = False,
) -> None:
    """Print the homography that maps LEFT pixels to RIGHT pixels, and how it was found."""
    with console.status("registering"):
        pair = register_pair(
            left,
            right,
            config=configuration(preset, config),
            detector=detector,
            descriptor=descriptor,
            estimator=estimator,
            backend=backend_at(backend, address),
            seed=seed,
            working_width_px=working_width_px,
            refine=refine,
        )
    if as_json:
        typer.echo(json.dumps(pair.summary()))
    elif pair.homography is not None:
        _print_pair(pair)
        for row in pair.homography:
            typer.echo("  ".join(f"{value: .9e}" for value in row))
    if not pair.accepted:
        raise RegistrationError(f"{left} and {right} cannot be registered: {pair.reason}")


def _print_pair(pair: Pair) -> None:
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    summary: dict[str, Any] = pair.summary()
    table.add_row("method", f"{pair.method.detector} + {pair.method.descriptor}, {pair.estimator}")
    table.add_row("features", "{} and {}".format(*summary["features"]))
    for count in ("matches", "kept", "inliers"):
        table.add_row(count, str(summary[count]))
    table.add_row("seconds", ", ".join(f"{stage} {value:.3f}" for stage, value in summary["seconds"].items()))
    for photograph in (pair.left, pair.right):
        for note in photograph.notes:
            table.add_row("note", f"{photograph.name}: {note}")
    console.print(table)
