"""What workers do: functions of plain arguments that write files into the current folder and hand back numbers."""

from __future__ import annotations

import csv
import io
import json
import shlex
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from golden_model.config import to_toml
from golden_model.formats import decode_response
from sim.backend import Progress
from sim.scene import pair as rendered_pair
from skymosaic import report
from skymosaic.comparison import compare
from skymosaic.errors import RegistrationError
from skymosaic.homography import apply
from skymosaic.images import load, reduced, save, save_bytes
from skymosaic.mosaicing import Mosaic, mosaic_of_pair
from skymosaic.panel.choices import Choices
from skymosaic.panel.explain import verdicts
from skymosaic.panel.outcomes import HardwareOutcome, MosaicOutcome, PairView, ShownMosaic, Upload
from skymosaic.registration import POSITIONS_PER_PX, WORKING_WIDTH_PX, register

SHOWN_SIDE_PX = 3000
"""Longer mosaics are reduced for the page; the archive has them whole."""
BUILT_IN_SEED = 9


def inspect(name: str, views: Path, *, progress: Progress) -> Upload:
    """Decode a photograph, every check included, and keep its working picture in ``views``."""
    progress(f"reading {name}")
    photograph = load(name)
    working, _ = reduced(photograph.pixels, WORKING_WIDTH_PX)
    save(views / f"{name}.png", working)
    return Upload(name, photograph.size, photograph.notes, views / f"{name}.png", (working.shape[1], working.shape[0]))


def render_pair(names: tuple[str, str], views: Path, *, progress: Progress) -> list[Upload]:
    """Render the built-in pair."""
    progress("rendering the built-in flight")
    for name, image in zip(names, rendered_pair(seed=BUILT_IN_SEED).images, strict=True):
        save(Path(name), image)
    return [inspect(name, views, progress=progress) for name in names]


def make_mosaic(names: list[str], choices: Choices, views: Path, *, progress: Progress) -> MosaicOutcome:
    """Register and blend photographs; a pair that cannot be registered has an outcome too, which shows why."""
    _, config = choices.settled()
    progress("finding and matching features")
    pair = register(
        *names,
        config=config,
        detector=choices.detector,
        descriptor=choices.descriptor,
        estimator=choices.estimator,
        backend=choices.backend,
        refine=choices.refine,
        progress=progress,
    )
    mosaic, reason = None, ""
    try:
        progress("warping and blending")
        mosaic = mosaic_of_pair(pair, blending=choices.blending)
    except RegistrationError as error:
        reason = str(error)
    progress("writing")
    report.write_pair_report(Path("report"), pair, mosaic.image if mosaic else None)
    view = PairView.of(pair, report.pair_numbers(pair))
    for name, text in {
        "config.toml": to_toml(pair.config),
        "command.txt": command(names, choices) + "\n",
        "corners.csv": _corners_table(view),
        "matches.csv": _matches_table(view),
    }.items():
        save_bytes(Path(name), text.encode())
    return MosaicOutcome(
        folder=Path.cwd(),
        choices=choices,
        workings=tuple(views / f"{name}.png" for name in names),
        pairs=(view,),
        mosaic=_shown(mosaic, names, views) if mosaic else None,
        left_out={names[index]: why for index, why in mosaic.left_out.items()} if mosaic else {},
        reason=reason,
        command=command(names, choices),
        seconds=pair.seconds,
    )


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
    words = ["skymosaic", "mosaic", *names, "--config", "config.toml", "--detector", choices.detector]
    words += ["--descriptor", choices.descriptor, "--estimator", choices.estimator]
    words += ["--backend", choices.backend, "--blend", choices.blending]
    words += [*(["--refine"] if choices.refine else []), "--report", "report", "-o", "mosaic.png"]
    return shlex.join(words)


def _shown(mosaic: Mosaic, names: list[str], views: Path) -> ShownMosaic:
    """Store the mosaic, and a picture of it for the page."""
    save(Path("mosaic.png"), mosaic.image)
    height, width = mosaic.image.shape[:2]
    scale = min(1.0, SHOWN_SIDE_PX / max(width, height))
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    picture = views / f"mosaic-{Path.cwd().name}.jpg"
    save(picture, np.asarray(cv2.resize(mosaic.image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8))
    outlines = {}
    for index in mosaic.placed:
        photo_width, photo_height = load(names[index]).size
        frame = np.array([(0, 0), (photo_width, 0), (photo_width, photo_height), (0, photo_height)]) - 0.5
        outlines[names[index]] = apply(mosaic.transforms[index], frame) * scale
    return ShownMosaic(picture, (width, height), size, outlines)


def _corners_table(view: PairView) -> str:
    """The corners of both images as CSV, in working pixels."""
    rows = [
        (name, corner["x"] / POSITIONS_PER_PX, corner["y"] / POSITIONS_PER_PX, corner["level"], corner["sector"],
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
            *(match[name] / POSITIONS_PER_PX for name in names[:4]),
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
