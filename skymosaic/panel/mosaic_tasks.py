"""What workers do for a mosaic: functions of plain arguments that write into the current folder."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from golden_model.config import to_toml
from golden_model.formats import POSITION, decode_response
from sim.backend import Progress
from skymosaic.errors import RegistrationError
from skymosaic.evaluation.hardware import compare
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.check import check_flight
from skymosaic.flight.composition import MEMORY_BYTES, compose
from skymosaic.flight.output import deliver
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.view import Settings
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import apply
from skymosaic.imagery.images import save, save_bytes
from skymosaic.imagery.photographs import sources
from skymosaic.mosaicing import FLIGHT_BLENDING, PAIR_BLENDING, check_linked, mosaic_of_pair
from skymosaic.panel.explain import verdicts
from skymosaic.panel.options import AUTOMATIC, Choices
from skymosaic.panel.results import HardwareOutcome, LinkView, MosaicOutcome, PairView, ShownMosaic, Size
from skymosaic.registration import WORKING_WIDTH_PX, Pair, register
from skymosaic.reports import pair as pair_report
from skymosaic.reports.flight import write_flight_report

SEED = 0
"""The command line's own, so that it repeats what the panel did."""
SHOWN_SIDE_PX = 3000
"""Longer mosaics are reduced for the page; the archive has them whole."""


def make_mosaic(names: list[str], choices: Choices, views: Path, *, progress: Progress) -> MosaicOutcome:
    """Register and blend two photographs, or a whole flight."""
    outcome = _of_pair if len(names) == 2 else _of_flight
    return outcome(names, choices, views, progress)


def look_at_pair(outcome: MosaicOutcome, names: tuple[str, str], *, progress: Progress) -> MosaicOutcome:
    """The outcome of a flight with another of its pairs to look at."""
    view = PairView.of(*_registered(names, outcome.choices, progress))
    return dataclasses.replace(outcome, pair=view)


def _of_pair(names: list[str], choices: Choices, views: Path, progress: Progress) -> MosaicOutcome:
    """The outcome of a pair; one that cannot be registered has an outcome too, which shows why."""
    pair, numbers = _registered((names[0], names[1]), choices, progress)
    shown, reason, image = None, "", None
    try:
        progress("warping and blending")
        mosaic = mosaic_of_pair(pair, blending=choices.blending_or(PAIR_BLENDING))
        image = mosaic.image
        save(Path("mosaic.png"), image)
        photographs = (pair.left, pair.right)
        outlines = {names[i]: _outline(photographs[i].size, mosaic.transforms[i]) for i in mosaic.placed}
        shown = _shown(image, (image.shape[1], image.shape[0]), outlines, views)
    except RegistrationError as error:
        reason = str(error)
    progress("writing")
    pair_report.write_pair_report(Path("report"), pair, image)
    view = PairView.of(pair, numbers)
    words = command(names, choices)
    _write({"corners.csv": _corners_table(view), "matches.csv": _matches_table(view)})
    _write({"config.toml": to_toml(pair.config), "command.txt": words + "\n"})
    return MosaicOutcome(
        folder=Path.cwd(),
        choices=choices,
        workings=tuple(views / f"{name}.png" for name in names),
        pair=view,
        mosaic=shown,
        left_out=(),
        reason=reason,
        command=words,
        seconds=pair.seconds,
    )


def _of_flight(names: list[str], choices: Choices, views: Path, progress: Progress) -> MosaicOutcome:
    _, config = choices.settled(len(names))

    def tell(stage: str, done: int, total: int) -> None:
        progress(f"{stage}: {done} of {total}")

    progress("features")
    settings = Settings(config, choices.backend)
    with Workers(progress=tell) as workers:
        flight = survey(sources([Path(name) for name in names]), settings, SEED, workers, ResultCache(None))
        check_linked(flight)
        layout = flight.layouts[0]
        composition = compose(flight, layout, blending=choices.blending_or(FLIGHT_BLENDING))
        delivery = deliver(Path("mosaic.png"), flight, layout, composition, workers=workers, memory_bytes=MEMORY_BYTES)
    progress("writing")
    write_flight_report(Path("report"), [delivery], check_flight(flight))
    words = command(names, choices)
    _write({"config.toml": to_toml(config), "command.txt": words + "\n"})
    links = _links(flight)
    view = PairView.of(*_registered(links[0].names, choices, progress))
    outlines = {p.source.name: _outline(p.size, p.transform) for p in composition.placements}
    return MosaicOutcome(
        folder=Path.cwd(),
        choices=choices,
        workings=tuple(views / f"{name}.png" for name in names),
        pair=view,
        mosaic=_shown(delivery.preview, composition.size, outlines, views),
        left_out=tuple(flight.absent_from(layout).values()),
        reason="",
        command=words,
        seconds=flight.seconds | {"blending and writing": delivery.seconds},
        links=links,
        facts={
            "photographs placed": f"{len(layout.members)} of {len(names)}",
            "pairs linked": f"{len(links)} of {len(flight.links)} tried",
            "median error of the ties": f"{layout.median_error_px:.2f} px",
            "model": f"{layout.model}: {layout.reason}",
        },
    )


def _registered(names: tuple[str, str], choices: Choices, progress: Progress) -> tuple[Pair, dict[str, Any]]:
    """A pair of files, and its numbers for the report."""
    progress("finding and matching features")
    _, config = choices.settled()
    pair = register(
        *names,
        config=config,
        detector=choices.detector,
        descriptor=choices.descriptor,
        estimator=choices.estimator,
        backend=choices.backend,
        seed=SEED,
        refine=choices.refine,
        progress=progress,
    )
    return pair, pair_report.pair_numbers(pair)


def _links(flight: Flight) -> tuple[LinkView, ...]:
    held = sorted((link for link in flight.links if link.holds), key=lambda link: -link.inliers)
    return tuple(LinkView((flight.views[link.left].name, flight.views[link.right].name), link.inliers) for link in held)


def compare_hardware(names: tuple[str, str], choices: Choices, backend: str, *, progress: Progress) -> HardwareOutcome:
    """Run a pair through the golden model and through hardware."""
    _, config = choices.settled()
    progress("computing by the golden model")
    software = register(*names, config=config)
    progress(f"computing by {backend}")
    comparison = compare(
        *names, config=software.config, backend=backend, working_width_px=WORKING_WIDTH_PX, progress=progress
    )
    save_bytes(Path("hardware.json"), (json.dumps(comparison.summary(), indent=2) + "\n").encode())
    sizes = [(image.shape[1], image.shape[0]) for image in software.working]
    size = max(sizes, key=lambda size: size[0] * size[1])
    words = ["skymosaic", "compare", *names, "--config", "config.toml", "--backend", backend]
    seconds = software.seconds["features and matches"]
    return HardwareOutcome(names, size, backend, comparison, seconds, shlex.join(words))


def command(names: list[str], choices: Choices) -> str:
    """The command line that repeats a run in its folder."""
    words = ["skymosaic", "mosaic", *names, "--config", "config.toml"]
    if len(names) == 2:
        words += ["--detector", choices.detector, "--descriptor", choices.descriptor]
        words += ["--estimator", choices.estimator, *(["--refine"] if choices.refine else [])]
    words += [] if choices.blending == AUTOMATIC else ["--blend", choices.blending]
    return shlex.join([*words, "--backend", choices.backend, "--report", "report", "-o", "mosaic.png"])


def _outline(size: Size, transform: Array) -> Array:
    """The corners of a photograph on the canvas, (4, 2)."""
    width, height = size
    frame = np.array([(0, 0), (width, 0), (width, height), (0, height)]) - 0.5
    return apply(transform, frame)


def _shown(image: Pixels, size: Size, outlines: dict[str, Array], views: Path) -> ShownMosaic:
    """Store a picture of the mosaic for the page; ``image`` is the mosaic of ``size``, or a preview of it."""
    scale = min(1.0, SHOWN_SIDE_PX / max(image.shape))
    shown = max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1)
    picture = views / f"mosaic-{Path.cwd().name}.jpg"
    save(picture, np.asarray(cv2.resize(image, shown, interpolation=cv2.INTER_AREA), dtype=np.uint8))
    return ShownMosaic(picture, size, shown, {name: corners * shown[0] / size[0] for name, corners in outlines.items()})


def _write(texts: dict[str, str]) -> None:
    for name, text in texts.items():
        save_bytes(Path(name), text.encode())


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
