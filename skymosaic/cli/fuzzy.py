"""The command that shows the fuzzy systems: rules as text, curves and surfaces as pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from skymosaic.cli.options import OverwriteOption, plotting_module
from skymosaic.cli.session import session
from skymosaic.errors import InputError
from skymosaic.imagery.images import check_unused, save_bytes
from skymosaic.reports import pair as pair_report
from skymosaic.reports.fuzzy_systems import PLOTTED_SYSTEMS, PlottedSystem


def fuzzy(
    *,
    systems: Annotated[
        list[str] | None, typer.Argument(help=f"{', '.join(PLOTTED_SYSTEMS)}; by default all.", metavar="[SYSTEM]...")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Draw membership curves and rule surfaces.")] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the pictures.")] = Path("fuzzy"),
    overwrite: OverwriteOption = False,
) -> None:
    """Print the rules of the fuzzy systems; with --plot, draw their membership curves and rule surfaces."""
    names = systems or list(PLOTTED_SYSTEMS)
    unknown = [name for name in names if name not in PLOTTED_SYSTEMS]
    if unknown:
        raise InputError(f"no fuzzy system {', '.join(unknown)}; valid: {', '.join(PLOTTED_SYSTEMS)}")
    if plot:
        check_unused(output, overwrite=overwrite)
    for name in names:
        session.show(_rules(name, PLOTTED_SYSTEMS[name]))
    session.numbers["systems"] = names
    if plot:
        _draw(names, output)


def _rules(name: str, plotted: PlottedSystem) -> Table:
    system = plotted.system()
    table = Table(title=f"{name}: {plotted.title}, AND is the {system.conjunction}", title_justify="left")
    for heading in ("rule", *(axis.label for axis in plotted.axes), "weight"):
        table.add_column(heading, justify="right" if heading in ("rule", "weight") else "left")
    for index, rule in enumerate(system.rules):
        table.add_row(str(index), *(chosen or "any" for chosen in rule.sets), f"{rule.output:g}")
    return table


def _draw(names: list[str], folder: Path) -> None:
    picture = plotting_module("skymosaic.reports.fuzzy_plots").picture
    pair_report.prepare(folder)
    for name in names:
        path = folder / f"{name}.png"
        save_bytes(path, picture(name))
        session.wrote(path)
        session.show(f"picture {path}")
