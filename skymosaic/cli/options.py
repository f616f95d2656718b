"""Options and helpers that several commands share."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from golden_model.config import PRESETS, Config, load_config, preset_config
from golden_model.text import how_to_install, one_line
from sim.backends.interface import BACKENDS
from skymosaic.cli.session import session
from skymosaic.errors import InputError
from skymosaic.features.descriptors import DESCRIPTORS
from skymosaic.features.detectors import DETECTORS
from skymosaic.geometry.estimators import ESTIMATORS
from skymosaic.imagery import images
from skymosaic.imagery.images import DAMAGED
from skymosaic.registration.pair import Pair
from skymosaic.registration.passes import EFFORTS

HARDWARE = tuple(name for name in BACKENDS if name != "golden")
"""Backends that can differ from the golden model."""


def choice(names: Iterable[str], help_text: str, *declarations: str, panel: str | None = None) -> Any:
    """An option that takes one of ``names``: the help lists them, and the shell completes them.

    The names are checked where they are used, so that Python, the command line and the panel give one message.
    """
    listed = tuple(names)
    return typer.Option(
        *declarations,
        help=help_text,
        metavar="|".join(listed),
        autocompletion=lambda: list(listed),
        rich_help_panel=panel,
    )


PresetOption = Annotated[str, choice(PRESETS, "The project's own algorithm, or what the thesis describes.")]
BackendOption = Annotated[str, choice(BACKENDS, "What computes features and matches; rtl is verilator.")]
AddressOption = Annotated[
    str | None, typer.Option(metavar="HOST[:PORT]", help="Address of the board, for --backend board.")
]
DetectorOption = Annotated[
    str | None, choice(DETECTORS, "Corners; by default as configured, or what suits the descriptor.")
]
DescriptorOption = Annotated[
    str | None, choice(DESCRIPTORS, "Descriptor; by default as configured, or what suits the detector.")
]
EstimatorOption = Annotated[str, choice(ESTIMATORS, "Robust estimator of the homography.")]
ConfigOption = Annotated[Path | None, typer.Option("--config", help="TOML file that overrides the preset.")]
WorkingWidthOption = Annotated[
    int, typer.Option("--working-width", min=images.MIN_SIDE_PX, max=4096, help="Pixels wide during registration.")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the robust estimator.")]
RefineOption = Annotated[
    bool, typer.Option("--refine", help="Second, guided pass; its result counts only if it fits unseen matches better.")
]
EffortOption = Annotated[
    str | None,
    choice(EFFORTS, "One pass; more frames where that is weak (normal, the default); always three scales (thorough)."),
]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace files that exist; without it they are refused.")
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="Exit status 3, and no mosaic, if a photograph is left out; else a warning.")
]
DamagedOption = Annotated[
    str, choice(DAMAGED, "A damaged JPEG: refuse it (a flight leaves it out), or keep what can be decoded.")
]


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
        raise InputError(f"pictures need matplotlib; {how_to_install('plots')}") from None


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
    """Print the method and the counts of a registration."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    summary = pair.summary()
    table.add_row("method", f"{pair.method.detector} + {pair.method.descriptor}, {pair.estimator}")
    table.add_row("features", "{} and {}".format(*summary["features"]))
    for count in ("matches", "kept", "inliers"):
        table.add_row(count, str(summary[count]))
    table.add_row("passes", f"{pair.passes} ({pair.effort})")
    if pair.confidence is not None:
        table.add_row("confidence", f"{pair.confidence.verdict}: {pair.confidence.reason}")
    for photograph in (pair.left, pair.right):
        for note in photograph.notes:
            table.add_row("note", Text(one_line(f"{photograph.name}: {note}")))
    session.show(table)


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
