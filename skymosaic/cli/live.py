"""The command for a mosaic that grows while the camera is still in the air."""

import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import OverwriteOption, StrictOption, output_option, with_options
from skymosaic.cli.session import session
from skymosaic.errors import InputError, RegistrationError
from skymosaic.imagery import images
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.photographs import is_folder
from skymosaic.live.mosaic import LiveMosaic, LiveUpdate
from skymosaic.live.pace import Pace
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.options import INPUT, options_of

PREVIEW_WIDTH_PX = 1280
PREVIEW_SECONDS = 1.0
LIVE_OPTIONS = ("preset", "config", "backend", "working_width_px", "seed", "band", "scale", "canvas_limit_px")
"""The options that a live mosaic has."""

IdleOption = Annotated[
    float | None,
    typer.Option(min=0, rich_help_panel=INPUT, help="End a live mosaic when the folder got no new file for so long."),
]


@with_options
def live(
    *,
    source: Annotated[str, typer.Argument(help="A folder that fills, a video or its address, a camera's number.")],
    idle_seconds: IdleOption = None,
    output: Annotated[Path, output_option("The mosaic, written at the end: .png, .tif ...")],
    overwrite: OverwriteOption = False,
    strict: StrictOption = False,
    options: Annotated[MosaicOptions, LIVE_OPTIONS],
) -> None:
    """Grow a mosaic frame by frame, with a preview beside it; Ctrl-C or SIGTERM stops and writes it."""
    write_live_mosaic(source, output, options, idle_seconds, overwrite=overwrite, strict=strict)


def check_live(photographs: Sequence[str], options: MosaicOptions, others: Mapping[str, bool]) -> None:
    """Refuse what has no effect on a live mosaic.

    Parameters
    ----------
    photographs : sequence of str
        What the user names to make a mosaic of.
    options : MosaicOptions
    others : mapping of str to bool
        Flags that a live mosaic does not have, and whether they are given.

    Raises
    ------
    InputError
        For more than one source, or an option that has no effect on a live mosaic.
    """
    if len(photographs) != 1:
        raise InputError(f"--live takes one folder, video or camera, not {len(photographs)}")
    changed = [each for each in options_of(MosaicOptions) if getattr(options, each.name) != each.default]
    useless = [each.flag for each in changed if each.name not in LIVE_OPTIONS]
    useless += [flag for flag, given in others.items() if given]
    if useless:
        raise InputError(
            f"{', '.join(useless)}: no effect with --live, which adds one frame at a time; leave out either"
        )


def write_live_mosaic(
    source: str,
    output: Path,
    options: MosaicOptions,
    idle_seconds: float | None,
    *,
    overwrite: bool,
    strict: bool,
) -> None:
    """Grow a mosaic until its source ends or the user stops it, and write it.

    Raises
    ------
    InputError
        For an unusable source or output.
    RegistrationError
        If no frame could be used, or with ``strict`` if one was left out.
    """
    images.check_output(output, (source,), overwrite=overwrite)
    preview = output.with_suffix(".preview.jpg")
    images.check_unused(preview, overwrite=overwrite)
    mosaic = LiveMosaic(
        options.base_config,
        options.backend_name,
        seed=options.seed,
        working_width_px=options.working_width_px,
        scale=options.scale,
        canvas_limit_px=options.canvas_limit_px,
    )
    written = output, preview
    frames = read_live_frames(source, idle_seconds=idle_seconds, tell=session.tell, made=written, band=options.band)
    pace = Pace(options.base_config, options.backend_name)
    try:
        grow(mosaic, frames, preview, pace)
    # Ctrl-C is how a live mosaic usually ends, `ended_by_signals` turns SIGTERM and a closed terminal into SystemExit:
    # what has been seen until then is written.
    except (KeyboardInterrupt, SystemExit):
        session.tell("stopped; writing the mosaic")
    mosaic.finish()
    if not mosaic.transforms:
        raise RegistrationError(f"{source}: no frame could be used")
    absent = {number: f"frame {number}: {reason}" for number, reason in mosaic.left_out.items()}
    report_absent(absent, strict=strict)
    # Without a moving display, which a closed terminal would not take.
    session.tell("writing")
    images.save(output, mosaic.image)
    if is_folder(Path(source)):
        for path in written:
            record_output(path, [Path(source) / path.name])
    height_px, width_px = mosaic.image.shape[:2]
    session.numbers = {"size": [width_px, height_px], "frames": len(mosaic.transforms), "left_out": absent}
    session.numbers["pace"] = pace.numbers
    session.tell(str(pace))
    for path in written:
        session.wrote(path)
    session.show(f"mosaic {output} ({width_px}x{height_px}): {len(mosaic.transforms)} frames, {len(absent)} left out")


def report_absent(absent: Mapping[int, str], *, strict: bool) -> None:
    """Warn of what a mosaic does not contain.

    Parameters
    ----------
    absent : mapping of int to str
        Photographs or frames by their index, with the reason.
    strict : bool
        Make it an error.

    Raises
    ------
    RegistrationError
        If it is an error; the mosaic must not have been written yet.
    """
    for reason in absent.values():
        session.warn(f"left out: {reason}")
    if strict and absent:
        raise RegistrationError(f"{len(absent)} left out, and --strict allows none; nothing was written")


def grow(mosaic: LiveMosaic, frames: Iterable[Photograph], preview: Path, pace: Pace) -> None:
    """Add frames as they come, print a line for each, and update the preview."""
    shown_s = 0.0
    for frame in frames:
        update = mosaic.add(frame.pixels)
        pace.add(update)
        session.tell(f"{update.number} {frame.name}: {_describe(update)}")
        if not update.reason and time.monotonic() - shown_s >= PREVIEW_SECONDS:
            images.save(preview, images.reduce_to_width(mosaic.image, PREVIEW_WIDTH_PX)[0])
            shown_s = time.monotonic()
    if mosaic.transforms:
        images.save(preview, images.reduce_to_width(mosaic.image, PREVIEW_WIDTH_PX)[0])


def _describe(update: LiveUpdate) -> str:
    if update.reason:
        return f"left out: {update.reason}"
    parts = f"; {update.submaps} separate parts" if update.submaps > 1 else ""
    if update.placement is None:
        return f"starts a separate mosaic{parts}"
    neighbours = ", ".join(map(str, update.placement.neighbours))
    return f"{update.placement.ties} ties to {neighbours}, median {update.placement.error_px:.2f} px{parts}"
