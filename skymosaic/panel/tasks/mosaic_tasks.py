"""The tasks behind the mosaic page, run in a worker.

Every task reads photographs by paths, relative to ``folder`` or absolute, and writes its results into ``folder``.
Results name files relative to it, so that the archive works wherever it is unpacked.
"""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from golden_model.config_file import to_toml
from golden_model.formats import POSITION, decode_response
from skymosaic.common.errors import RegistrationError
from skymosaic.common.options import command_words
from skymosaic.common.provenance import to_json
from skymosaic.common.tables import to_csv
from skymosaic.evaluation.hardware import compare
from skymosaic.flight.checking.check import check_flight, layout_errors
from skymosaic.flight.flight import Flight
from skymosaic.flight.picture.formats import OutputForm
from skymosaic.flight.picture.output import Delivery
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.images import save, save_bytes
from skymosaic.imagery.photographs import Source, list_sources
from skymosaic.maps.georeference import MIN_POSITIONS
from skymosaic.mosaicking.api import open_run_of_sources
from skymosaic.mosaicking.run import MosaicRun
from skymosaic.panel.explain import classify_matches
from skymosaic.panel.options import Options, backend_options
from skymosaic.panel.results import (
    RULES,
    HardwareResult,
    Link,
    MosaicResult,
    Picture,
    new_picture,
    shown_name,
    side_by_side,
)
from skymosaic.panel.tasks.jobs import Progress
from skymosaic.panel.tasks.mosaic_picture import PREVIEW_WIDTH_PX, show_mosaic
from skymosaic.registration.options import PhotographOptions
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register
from skymosaic.reports.flight import write_report
from skymosaic.reports.summary import describe_mosaic

MOSAIC, MAP, TILES, REPORT, CONFIG = "mosaic.png", "mosaic.tif", "tiles", "report", "config.toml"
"""Files and folders of a run."""


def make_mosaic(
    folder: Path, paths: list[str], options: Options, pictures: Path, *, progress: Progress
) -> MosaicResult:
    """Make a mosaic of two photographs, of a whole flight, or of a flight's multi-band sets.

    There are at least two paths, with different names. ``pictures`` is the folder for what the page shows.

    Raises
    ------
    RegistrationError
        If no two photographs of a flight can be linked. A pair that cannot be registered has a result that says why.
    """
    # Reports and reasons name photographs as here, without the folder.
    by_name = {shown_name(path): path for path in paths}
    photographs = [Source(index, shown_name(path), folder / path) for index, path in enumerate(paths)]
    words = _shorten(paths)
    notes: list[str] = []
    sources = group_band_sets(photographs, tell=notes.append)
    deliveries, reason, output = [], "", [MOSAIC]
    with open_run_of_sources(sources, options, progress) as run:
        try:
            output = _choose_output(run)
            form = OutputForm(tiles=folder / TILES if TILES in output else None)
            deliveries = run.write(folder / output[0], form, preview_width_px=PREVIEW_WIDTH_PX)
        except RegistrationError as error:
            # The matches of a pair show why it could not be registered.
            if run.flight.pair is None:
                raise
            reason = str(error)
    flight, pair = run.flight, run.flight.pair
    if pair is None:
        # A flight keeps no match records, so its pair with the most inliers is registered again.
        left, right, _ = _links(flight)[0]
        pair = _register((folder / by_name[left], folder / by_name[right]), options, progress)
    progress("writing")
    write_report(folder / REPORT, flight, deliveries)
    command = write_command(words, options, output)
    for name, text in {"command.txt": command + "\n", **_describe_run(flight)}.items():
        # Of the paths in a command, the bytes that the file system has.
        save_bytes(folder / name, text.encode(errors="surrogateescape"))
    result = MosaicResult(
        folder=folder,
        pictures=pictures,
        command=command,
        options=options,
        paths=by_name,
        pair=pair,
        working=_save_working(pair, pictures),
        seconds=flight.seconds,
        reason=reason,
    )
    return _add_mosaic(result, flight, deliveries[0], notes) if deliveries else result


def _describe_run(flight: Flight) -> dict[str, str]:
    """Configuration and rules, and of two photographs corners and matches, by the names of their files."""
    config, pair = flight.settings.config, flight.pair
    rules = {RULES: config.matcher.rules.text} if config.matcher.rules else {}
    tables = {"corners.csv": _list_corners(pair), "matches.csv": _list_matches(pair)} if pair else {}
    return {CONFIG: to_toml(config), **rules, **tables}


def _choose_output(run: MosaicRun) -> list[str]:
    """A GeoTIFF for multi-band sets, with a page of tiles for photographs with GPS; otherwise a picture.

    As words of a command line, behind ``-o``.
    """
    if run.sources[0].bands:
        return [MAP]
    views = run.flight.views
    on_map = sum(view.gps is not None for view in views)
    return [MAP, "--tiles", TILES] if on_map >= min(len(views), MIN_POSITIONS) else [MOSAIC]


def _add_mosaic(result: MosaicResult, flight: Flight, delivery: Delivery, notes: list[str]) -> MosaicResult:
    """Add the mosaic, what is to be said of it and what is not in it; of a flight, links, problems and numbers."""
    layout = delivery.layout
    result = replace(
        result,
        mosaic=show_mosaic(delivery, result.pictures),
        left_out={flight.names[index]: reason for index, reason in flight.absent_from(layout).items()},
        facts=describe_mosaic(delivery),
    )
    if flight.pair:
        return result
    links, errors = _links(flight), layout_errors(flight, layout)
    facts = {
        "photographs placed": f"{len(layout.members)} of {len(flight.names)}",
        "pairs linked": f"{len(links)} of {len(flight.links)} tried",
        "overlaps": layout.agreement.description,
        "linked pairs": "unknown" if errors is None else errors.description,
        "model": f"{layout.model}: {layout.reason}",
    }
    facts |= {"notes": "; ".join(notes)} if notes else {}
    return replace(
        result,
        seconds=flight.seconds | {"blending and writing": delivery.seconds},
        links=links,
        problems={photo.name: photo.problems for photo in check_flight(flight).photographs if photo.problems},
        facts=result.facts | facts,
    )


def _shorten(paths: list[str]) -> list[str]:
    """What the command line is given: a folder stands for all its photographs."""
    folder = Path(paths[0]).parent
    return [str(folder)] if folder.is_absolute() and [x.name for x in list_sources([folder])] == paths else paths


def look_at_pair(folder: Path, result: MosaicResult, names: tuple[str, str], *, progress: Progress) -> MosaicResult:
    """Show the matches of another pair of a flight."""
    left, right = (folder / result.paths[name] for name in names)
    pair = _register((left, right), result.options, progress)
    return replace(result, pair=pair, working=_save_working(pair, result.pictures))


def _register(files: tuple[Path, Path], options: Options, progress: Progress) -> Pair:
    progress("finding and matching features")
    pair = register(*files, options, progress=progress)
    # Report, tables and page name the photographs without the folder.
    left, right = (replace(each, name=shown_name(each.name)) for each in (pair.left, pair.right))
    return replace(pair, left=left, right=right)


def _save_working(pair: Pair, pictures: Path) -> tuple[Picture, ...]:
    """Save what the front end saw of a pair, below the lines of its matches."""
    shown = []
    for pixels in pair.working:
        path = new_picture(pictures)
        save(path, pixels)
        shown.append((path, (pixels.shape[1], pixels.shape[0])))
    return side_by_side(shown)


def _links(flight: Flight) -> tuple[Link, ...]:
    """The linked pairs, the one with the most inliers first."""
    names = [view.name for view in flight.views]
    links = [Link(names[link.left], names[link.right], link.inliers) for link in flight.links if link.holds]
    return tuple(sorted(links, key=lambda link: -link.inliers))


def compare_hardware(
    folder: Path, paths: tuple[str, str], options: Options, backend: str, *, progress: Progress
) -> HardwareResult:
    """Run a pair through the golden model and through hardware, and write ``hardware.json``."""
    _, config = options.choose_method()
    left, right = (folder / path for path in paths)
    progress(f"computing with the golden model and with {backend}")
    chosen = replace(PhotographOptions(config=config, damaged=options.damaged), **backend_options(backend))
    comparison = compare(left, right, chosen, progress=progress)
    save_bytes(folder / "hardware.json", to_json(comparison.summary()))
    words = ["skymosaic", "compare", *paths, *command_words(chosen, {"config": CONFIG})]
    return HardwareResult(backend, comparison, shlex.join(words))


def write_command(inputs: list[str], options: Options, output: Sequence[str] = (MOSAIC,)) -> str:
    """Write the command line that repeats a run in its folder; ``inputs`` may be a folder of the photographs."""
    # The file of the configuration holds the rules, too.
    words = ["skymosaic", "mosaic", *inputs, "--config", CONFIG, *command_words(replace(options, rules=None))]
    return shlex.join([*words, "--report", REPORT, "-o", *output, "--overwrite"])


def _list_corners(pair: Pair) -> str:
    """List the corners of both images as CSV, in working pixels."""
    rows = [
        (name, corner["x"] / POSITION.one, corner["y"] / POSITION.one, corner["level"], corner["sector"],
         decode_response(corner["response"]))
        for name, features in zip((pair.left.name, pair.right.name), pair.features, strict=True)
        for corner in features
    ]  # fmt: skip
    return to_csv(("image", "x", "y", "level", "sector", "response"), rows)


def _list_matches(pair: Pair) -> str:
    """List the matches as CSV, as `Pair.table` has them, each with its verdict."""
    table = pair.table("matches") | {"verdict": np.array(classify_matches(pair))}
    return to_csv(table, zip(*(column.tolist() for column in table.values()), strict=True))
