"""The command that repeats the thesis's experiments."""

import dataclasses
import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import OverwriteOption, output_option
from skymosaic.cli.outputs import Reads, Writes
from skymosaic.cli.progress import progress_bars
from skymosaic.cli.session import session
from skymosaic.evaluation.known_pairs import list_files
from skymosaic.imagery.images import check_output_folder, save_bytes
from skymosaic.running.workers import Progress
from skymosaic.thesis import dataset, tables
from skymosaic.thesis.dataset import Source
from skymosaic.thesis.experiments import find_best_pair, run_experiments

OWN_NAMES = r"index\.html|measurements\.csv"
FolderOption = Annotated[Path, output_option("Folder for the page and the measurements."), Writes(OWN_NAMES)]


def thesis(
    *,
    data: Annotated[
        Path | None,
        typer.Option(help="Folder with pairs.csv; by default a rendered flight.", show_default=False),
        Reads(list_files),
    ] = None,
    output: FolderOption = Path("thesis"),
    overwrite: OverwriteOption = False,
) -> None:
    """Repeat the thesis's experiments, tables IV-1 to IV-7 and figure IV-6, beside the published figures."""
    # Matplotlib is an extra, and takes a second to import.
    page = importlib.import_module("skymosaic.thesis.page")
    sources = dataset.list_sources(data)
    check_output_folder(output, overwrite=overwrite)
    output.mkdir(parents=True, exist_ok=True)
    with progress_bars() as progress:
        measurements = run_experiments(_report_each(sources, progress))
    save_bytes(output / "measurements.csv", measurements.to_csv().encode())
    session.wrote(output / "measurements.csv")
    with session.working("drawing"):
        shown = sources[find_best_pair(measurements)]()
        source = f"those of {data.resolve().name}" if data else "neighbouring pictures of a rendered survey flight"
        save_bytes(output / "index.html", page.compose_page(measurements, source, shown))
    trends = tables.check_trends(tables.scale_thresholds(measurements))
    for trend in trends:
        session.show(f"{'holds' if trend.holds else 'does not hold':13}  {trend.statement}: {trend.numbers}")
    session.numbers["trends"] = [dataclasses.asdict(trend) for trend in trends]
    session.show(f"page {output / 'index.html'}, every value {output / 'measurements.csv'}")
    session.wrote(output / "index.html")


def _report_each(sources: Sequence[Source], progress: Progress) -> Iterator[Source]:
    for number, source in enumerate(sources):
        progress("pairs", number, len(sources))
        yield source
    progress("pairs", len(sources), len(sources))
