"""The tasks behind the mosaic page, run in a worker.

Every task reads the photographs in ``folder`` by the names it is given and writes its results there; results name files
relative to it, so that the archive works wherever it is unpacked.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from golden_model.config import to_toml
from golden_model.formats import POSITION, decode_response
from sim.backends.interface import Progress
from skymosaic.errors import RegistrationError
from skymosaic.evaluation.hardware import compare
from skymosaic.flight.check import check_flight
from skymosaic.flight.picture.output import Delivery
from skymosaic.flight.survey import Flight
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.images import save_bytes
from skymosaic.imagery.photographs import Source
from skymosaic.maps.georeference import MIN_POSITIONS, has_maps
from skymosaic.mosaicking.api import open_plan_of_sources
from skymosaic.mosaicking.plan import MosaicPlan
from skymosaic.panel.explain import verdicts
from skymosaic.panel.options import Options
from skymosaic.panel.pair_view import PairView
from skymosaic.panel.results import HardwareResult, LinkView, MapView, MosaicResult, picture_name
from skymosaic.panel.steps import step_line
from skymosaic.panel.tasks.map_picture import map_view
from skymosaic.panel.tasks.mosaic_picture import PREVIEW_WIDTH_PX, outlines, page_picture, show_mosaic
from skymosaic.registration.options import FeatureOptions
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register
from skymosaic.reports import pair as pair_report
from skymosaic.reports.flight import describe_bands, write_report

MOSAIC, MAP, REPORT, CONFIG = "mosaic.png", "mosaic.tif", "report", "config.toml"
"""Files and folders of a run."""


def make_mosaic(folder: Path, names: list[str], options: Options, views: Path, *, progress: Progress) -> MosaicResult:
    """Make a mosaic of two photographs, of a whole flight, or of a flight's multi-band sets.

    Parameters
    ----------
    folder : Path
    names : list of str
        Of the photographs, at least two.
    options : Options
    views : Path
        Where the pictures for the page go.
    progress : callable

    Raises
    ------
    RegistrationError
        If no two photographs of a flight can be linked. A pair that cannot be registered has a result that says why.
    """
    # Reports and reasons name photographs as here, without the folder.
    photographs = [Source(index, name, folder / name) for index, name in enumerate(names)]
    unused: list[str] = []
    sources = group_band_sets(photographs, tell=unused.append)
    deliveries, reason, output = [], "", MOSAIC
    with open_plan_of_sources(sources, options, _in_words(progress)) as plan:
        try:
            output = _output_of(plan)
            deliveries = plan.write(folder / output, preview_width_px=PREVIEW_WIDTH_PX)
        except RegistrationError as error:
            if plan.flight.pair is None:
                raise
            reason = str(error)
    progress("writing")
    # The report is read from the unpacked archive, where the mosaic lies beside it.
    write_report(folder / REPORT, plan.flight, [dataclasses.replace(d, path=Path(output)) for d in deliveries])
    words = command(names, options, output)
    _write(folder, {CONFIG: to_toml(plan.flight.settings.config), "command.txt": words + "\n"})
    result = MosaicResult(
        folder=folder,
        options=options,
        working_pictures=tuple(views / picture_name(name) for name in names),
        pair=_pair_to_show(plan.flight, folder, options, progress),
        mosaic=show_mosaic(deliveries[0], views, f"mosaic-{folder.name}") if deliveries else None,
        left_out=_left_out(plan.flight, deliveries[0]) if deliveries else {},
        reason=reason,
        command=words,
        seconds=plan.flight.seconds,
        map=_map(deliveries[0], views) if deliveries else None,
    )
    if plan.flight.pair is not None:
        _write(folder, {"corners.csv": _corners_table(result.pair), "matches.csv": _matches_table(result.pair)})
        return result
    return _with_flight(result, plan.flight, deliveries[0], unused)


def _in_words(progress: Progress) -> Callable[[str, int, int], None]:
    def report_stage(stage: str, done: int, total: int) -> None:
        progress(step_line(stage, done, total) if total else stage)

    return report_stage


def _output_of(plan: MosaicPlan) -> str:
    """A GeoTIFF of multi-band sets, or where the photographs have GPS and it can be written; otherwise a picture."""
    if plan.sources[0].bands:
        return MAP
    views = plan.flight.views
    on_map = sum(view.gps is not None for view in views)
    return MAP if on_map >= min(len(views), MIN_POSITIONS) and has_maps() else MOSAIC


def _map(delivery: Delivery, views: Path) -> MapView | None:
    """What the page's map shows of a mosaic that was written as a GeoTIFF."""
    if delivery.georeference is None or delivery.path.name != MAP:
        return None
    picture = views / f"map-{delivery.path.parent.name}.png"
    composition = delivery.composition
    return map_view(
        page_picture(delivery.preview), composition.size, delivery.georeference, outlines(composition), picture
    )


def _left_out(flight: Flight, delivery: Delivery) -> dict[str, str]:
    return {flight.names[index]: reason for index, reason in flight.absent_from(delivery.layout).items()}


def _pair_to_show(flight: Flight, folder: Path, options: Options, progress: Progress) -> PairView:
    """The pair; of a flight, the pair with the most inliers."""
    if flight.pair is not None:
        return PairView.of(flight.pair, pair_report.pair_numbers(flight.pair))
    # A flight keeps no match records, so the pair that is shown is registered again.
    return PairView.of(*_registered(folder, _links(flight)[0].names, options, progress))


def _with_flight(result: MosaicResult, flight: Flight, delivery: Delivery, unused: list[str]) -> MosaicResult:
    """The result of more than two photographs, with their links and numbers."""
    layout, links = delivery.layout, _links(flight)
    bands = {"bands": describe_bands(delivery.composition)} if delivery.composition.band_names else {}
    return dataclasses.replace(
        result,
        seconds=flight.seconds | {"blending and writing": delivery.seconds},
        links=links,
        problems={photo.name: photo.problems for photo in check_flight(flight).photographs if photo.problems},
        facts={
            "photographs placed": f"{len(layout.members)} of {len(flight.names)}",
            "pairs linked": f"{len(links)} of {len(flight.links)} tried",
            "median error of the ties": f"{layout.median_error_px:.2f} px",
            "model": f"{layout.model}: {layout.reason}",
            **bands,
            **({"not used": "; ".join(unused)} if unused else {}),
        },
    )


def look_at_pair(folder: Path, result: MosaicResult, names: tuple[str, str], *, progress: Progress) -> MosaicResult:
    """The result of a flight, with the matches of another of its pairs."""
    return dataclasses.replace(result, pair=PairView.of(*_registered(folder, names, result.options, progress)))


def _registered(
    folder: Path, names: tuple[str, str], options: Options, progress: Progress
) -> tuple[Pair, dict[str, Any]]:
    """A registered pair of files, and its numbers for the report."""
    progress("finding and matching features")
    left_file, right_file = (folder / name for name in names)
    pair = register(left_file, right_file, options, progress=progress)
    # Report, tables and page name the photographs without the folder.
    left, right = (
        dataclasses.replace(photograph, name=name)
        for photograph, name in zip((pair.left, pair.right), names, strict=True)
    )
    pair = dataclasses.replace(pair, left=left, right=right)
    return pair, pair_report.pair_numbers(pair)


def _links(flight: Flight) -> tuple[LinkView, ...]:
    """The linked pairs, the one with the most inliers first."""
    held = sorted((link for link in flight.links if link.holds), key=lambda link: -link.inliers)
    return tuple(LinkView((flight.views[link.left].name, flight.views[link.right].name), link.inliers) for link in held)


def compare_hardware(
    folder: Path, names: tuple[str, str], options: Options, backend: str, *, progress: Progress
) -> HardwareResult:
    """Run a pair through the golden model and through hardware, and write ``hardware.json``."""
    _, config = options.choose_method()
    left, right = (folder / name for name in names)
    progress("computing with the golden model")
    software = register(left, right, config=config, damaged=options.damaged)
    # Registration may have raised the threshold, so the hardware gets the configuration that it returns.
    progress(f"computing with {backend}")
    as_registered = FeatureOptions(config=software.config, backend=backend, damaged=options.damaged)
    comparison = compare(left, right, as_registered, progress=progress)
    _write(folder, {"hardware.json": json.dumps(comparison.summary(), indent=2) + "\n"})
    sizes = [(image.shape[1], image.shape[0]) for image in software.working]
    size = max(sizes, key=lambda size: size[0] * size[1])
    words = ["skymosaic", "compare", *names, "--config", CONFIG, "--backend", backend, *_if_damaged(options)]
    seconds = software.seconds["features and matches"]
    return HardwareResult(names, size, backend, comparison, seconds, shlex.join(words))


def command(names: list[str], options: Options, output: str = MOSAIC) -> str:
    """The command line that repeats a run in its folder."""
    words = ["skymosaic", "mosaic", *names, "--config", CONFIG]
    if len(names) == 2:
        words += ["--detector", f"{options.detector}", "--descriptor", f"{options.descriptor}"]
        words += ["--estimator", options.estimator, *(["--refine"] if options.refine else [])]
    words += [] if options.blending is None else ["--blend", options.blending]
    words += _if_damaged(options)
    return shlex.join([*words, "--backend", options.backend_name, "--report", REPORT, "-o", output, "--overwrite"])


def _if_damaged(options: Options) -> list[str]:
    return ["--damaged", options.damaged] if options.keeps_damaged else []


def _write(folder: Path, texts: dict[str, str]) -> None:
    for name, text in texts.items():
        save_bytes(folder / name, text.encode())


def _corners_table(view: PairView) -> str:
    """The corners of both images as CSV, in working pixels."""
    rows = [
        (name, corner["x"] / POSITION.one, corner["y"] / POSITION.one, corner["level"], corner["sector"],
         decode_response(corner["response"]))
        for name, features in zip(view.names, view.features, strict=True)
        for corner in features
    ]  # fmt: skip
    return _csv(("image", "x", "y", "level", "sector", "response"), rows)


def _matches_table(view: PairView) -> str:
    """The matches as CSV, in working pixels."""
    residual = np.full(len(view.matches), np.nan) if view.residual_px is None else view.residual_px
    names = ("left_x", "left_y", "right_x", "right_y", "distance", "margin", "weight", "rule")
    rows = [
        (
            *(match[name] / POSITION.one for name in names[:4]),
            *(match[name] for name in names[4:]),
            verdict,
            f"{distance:.3f}",
        )
        for match, verdict, distance in zip(view.matches, verdicts(view), residual, strict=True)
    ]
    return _csv((*names, "verdict", "residual_px"), rows)


def _csv(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
