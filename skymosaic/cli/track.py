"""The command that follows an object through a video."""

import dataclasses
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import OverwriteOption, output_option
from skymosaic.cli.outputs import Writes
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError, noting
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.imagery import images
from skymosaic.imagery.key_frames import name_frame
from skymosaic.imagery.video import OUTPUT_SUFFIXES, VideoReader
from skymosaic.tracking.output import TABLE_SUFFIXES, TrackedCorners, follow_video, save_corners
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import TrackedFrame, Tracker, TrackerOptions

# Frames between two lines of progress where it is not drawn in place.
LINE_EVERY_FRAMES = 100


def track(
    *,
    inputs: Annotated[
        list[Path], typer.Argument(help="A picture of the object, and the video.", metavar="[TEMPLATE] VIDEO")
    ],
    output: Annotated[Path, output_option("The video with the outline: .mp4, .mov or .mkv."), Writes()],
    roi: Annotated[
        str | None, typer.Option(metavar="X,Y,W,H", help="Object's rectangle in the first frame, instead of TEMPLATE.")
    ] = None,
    corners: Annotated[Path | None, typer.Option(help="The corners in every frame: .csv or .json."), Writes()] = None,
    overwrite: OverwriteOption = False,
    options: TrackerOptions,
) -> None:
    """Follow an object: its outline in every frame of a video, and its corners as numbers."""
    template, video = _template_and_video(inputs, roi)
    images.check_output(output, suffixes=OUTPUT_SUFFIXES, overwrite=overwrite)
    if corners:
        images.check_output(corners, suffixes=TABLE_SUFFIXES, overwrite=overwrite)
    reader = VideoReader(video)
    tracker = Tracker(template, options)
    clock = Stopwatch()
    failures: list[str] = []
    with session.working("tracking") as step:

        def report(frame: TrackedFrame, row: TrackedCorners) -> None:
            facts = {"name": name_frame(video, frame.number), "placed": not frame.reason}
            pose = None if frame.pose is None else frame.pose.homography.tolist()
            session.stream({**dataclasses.asdict(row), **facts, "pose": pose})
            if session.animated or frame.number % LINE_EVERY_FRAMES == 0:
                step(f"frame {frame.number}")

        rows = follow_video(tracker, reader, output, report, failures if corners else None)
    written = [] if failures else [f"video {output}"]
    if written:
        session.wrote(output)
    session.numbers = {"frames": len(rows), "corners": [dataclasses.asdict(each) for each in rows]}
    if corners:
        with noting(failures):
            save_corners(corners, rows)
            session.wrote(corners)
            written.append(f"corners {corners}")
    session.seconds["tracking"] = clock.lap("tracking")
    _show_summary(rows, session.seconds["tracking"] / len(rows))
    for note in reader.notes:
        session.warn(f"{video}: {note}")
    if written:
        session.show(", ".join(written))
    if failures:
        raise InputError("; ".join(failures))


def _template_and_video(inputs: list[Path], roi: str | None) -> tuple[Path | Roi, Path]:
    if roi is None:
        if len(inputs) != 2:
            raise InputError("track takes TEMPLATE and VIDEO, or VIDEO and --roi")
        return inputs[0], inputs[1]
    if len(inputs) != 1:
        raise InputError("with --roi, track takes the VIDEO alone")
    try:
        x, y, width, height = map(int, roi.split(","))
    except ValueError:
        raise InputError(f"--roi is {roi!r}; give four whole numbers, x,y,width,height") from None
    return Roi(x, y, width, height), inputs[0]


def _show_summary(rows: list[TrackedCorners], seconds: float) -> None:
    seen = [each for each in rows if each.corners]
    session.show(f"found in {len(seen)} of {len(rows)} frames, {1000 * seconds:.0f} ms per frame")
    for group in [list(group) for missing, group in groupby(rows, key=lambda each: each.corners is None) if missing]:
        session.show(f"frames {group[0].frame} to {group[-1].frame}: {group[-1].reason}")
