"""Options and helpers that several commands share."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from golden_model.config import Config, load_config, preset_config
from golden_model.text import one_line
from skymosaic.errors import InputError
from skymosaic.features.descriptors import DESCRIPTORS
from skymosaic.features.detectors import DETECTORS
from skymosaic.geometry.estimators import ESTIMATORS
from skymosaic.imagery import images
from skymosaic.registration import Pair

console = Console(stderr=True)

PresetOption = Annotated[str, typer.Option(help="aerial or thesis.")]
BackendOption = Annotated[
    str, typer.Option(help="What computes features and matches: golden, rtl, verilator, cxxrtl, pysim or board.")
]
AddressOption = Annotated[
    str | None, typer.Option(metavar="HOST[:PORT]", help="Address of the board, for --backend board.")
]
DetectorOption = Annotated[
    str | None,
    typer.Option(help=f"{', '.join(DETECTORS)}; by default as configured, or the one that suits the descriptor."),
]
DescriptorOption = Annotated[
    str | None,
    typer.Option(help=f"{', '.join(DESCRIPTORS)}; by default as configured, or the one that suits the detector."),
]
EstimatorOption = Annotated[str, typer.Option(help=f"{', '.join(ESTIMATORS)}.")]
ConfigOption = Annotated[Path | None, typer.Option("--config", help="TOML file that overrides the preset.")]
WorkingWidthOption = Annotated[
    int, typer.Option("--working-width", min=images.SMALLEST_SIDE_PX, max=4096, help="Pixels wide during registration.")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the robust estimator.")]
RefineOption = Annotated[
    bool, typer.Option("--refine", help="Second, guided pass; its result counts only if it fits unseen matches better.")
]
EffortOption = Annotated[
    str | None,
    typer.Option(
        help="fast: one pass; normal (default): more frames where that is weak; thorough: three scales always."
    ),
]

OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace files that exist; without it they are refused.")
]
DamagedOption = Annotated[
    str,
    typer.Option(
        help="A damaged JPEG: refuse (a flight leaves it out), or keep what can be decoded.", metavar="refuse|keep"
    ),
]


def tell(line: str) -> None:
    """Print a line without Rich's markup and colours, which would change names of files."""
    console.print(one_line(line), markup=False, highlight=False, soft_wrap=True)


def plotting_module(name: str) -> ModuleType:
    """Import a module that needs matplotlib, which is an extra and takes a second to import.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError("pictures need matplotlib; run pip install 'skymosaic[plots]'") from None


def backend_at(backend: str, address: str | None) -> str:
    """The name of the backend; of a board with its address, ``board:HOST[:PORT]``.

    Raises
    ------
    InputError
        For an address without the backend ``board``.
    """
    if address is None:
        return backend
    if backend != "board":
        raise InputError(f"--address {address} is for a board; add --backend board, or leave it out")
    return f"{backend}:{address}"


def print_pair(pair: Pair) -> None:
    """Print the method, the counts and the times of a registration."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    summary = pair.summary()
    table.add_row("method", f"{pair.method.detector} + {pair.method.descriptor}, {pair.estimator}")
    table.add_row("features", "{} and {}".format(*summary["features"]))
    for count in ("matches", "kept", "inliers"):
        table.add_row(count, str(summary[count]))
    table.add_row("passes", f"{pair.passes} ({pair.effort})")
    if pair.confidence is not None:
        table.add_row("confidence", f"{pair.confidence.verdict}: {pair.confidence.reason}")
    table.add_row("seconds", ", ".join(f"{stage} {value:.3f}" for stage, value in summary["seconds"].items()))
    for photograph in (pair.left, pair.right):
        for note in photograph.notes:
            table.add_row("note", Text(one_line(f"{photograph.name}: {note}")))
    console.print(table)


def configuration(preset: str, file: Path | None) -> Config:
    """The configuration of a file, or of a preset.

    Raises
    ------
    InputError
        For an unknown preset, key or value.
    """
    try:
        return load_config(file, preset) if file else preset_config(preset)
    except (OSError, ValueError) as error:
        raise InputError(str(error)) from None
