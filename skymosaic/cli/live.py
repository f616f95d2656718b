"""The command for a mosaic that grows while the camera is still in the air."""

import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import OverwriteOption, RequireMapOption, StrictOption, output_option, with_options
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.common.options import INPUT, options_of
from skymosaic.compositing.warp import CANVAS_LIMIT_PX
from skymosaic.features.standing import STANDS_STILL
from skymosaic.flight.mapping.place import MapPlace, explain_absence, place_on_map
from skymosaic.flight.picture.composition import Room
from skymosaic.flight.picture.output import GEOTIFF_SUFFIXES, OutputForm, deliver, room_for
from skymosaic.flight.picture.preparation import compose
from skymosaic.imagery import images
from skymosaic.imagery.key_frames import flight_sources
from skymosaic.imagery.live_frames import LiveFrame, read_live_frames
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.photographs import forget_decoded, is_folder
from skymosaic.mosaicking.live.composing import flight_of_frames
from skymosaic.mosaicking.live.mosaic import ESTIMATORS, LiveMosaic
from skymosaic.mosaicking.live.pace import Pace
from skymosaic.mosaicking.live.update import LiveUpdate
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.running.workers import Workers

PREVIEW_WIDTH_PX = 1280
PREVIEW_SECONDS = 1.0
LIVE_OPTIONS = (
    "preset", "config", "rules", "backend", "working_width_px", "estimator", "seed", "band", "scale", "canvas_limit_px"
)  # fmt: skip
"""The fields of `MosaicOptions` that apply to a live mosaic."""

IdleOption = Annotated[
    float | None,
    typer.Option(min=0, rich_help_panel=INPUT, help="End a live mosaic when no new file has come for this long."),
]


@with_options
def live(
    *,
    source: Annotated[str, typer.Argument(help="A folder being filled, a video file or address, or a camera number.")],
    idle_seconds: IdleOption = None,
    output: Annotated[Path, output_option("The mosaic, written at the end: .png, .tif ...")],
    overwrite: OverwriteOption = False,
    strict: StrictOption = False,
    require_map: RequireMapOption = False,
    options: Annotated[MosaicOptions, LIVE_OPTIONS, {"estimator": ESTIMATORS}],
) -> None:
    """Grow a mosaic frame by frame, with a preview beside it; Ctrl-C or SIGTERM stops and writes it."""
    limits = {"overwrite": overwrite, "strict": strict, "require_map": require_map}
    write_live_mosaic(source, output, options, idle_seconds, **limits)


def check_live(photographs: Sequence[str], options: MosaicOptions, others: Mapping[str, bool]) -> None:
    """Refuse what has no effect on a live mosaic.

    Parameters
    ----------
    photographs : sequence of str
        The sources on the command line.
    options : MosaicOptions
    others : mapping of str to bool
        Flags that do not apply to a live mosaic, and whether each is given.

    Raises
    ------
    InputError
        For more than one source, or an option that has no effect on a live mosaic.
    """
    if len(photographs) != 1:
        raise InputError(f"--live takes one folder, video or camera, not {len(photographs)}")
    changed = [each for each in options_of(MosaicOptions) if getattr(options, each.name) != each.default]
    ineffective = [each.flag for each in changed if each.name not in LIVE_OPTIONS]
    ineffective += [flag for flag, given in others.items() if given]
    if ineffective:
        raise InputError(
            f"{', '.join(ineffective)}: no effect with --live, which adds one frame at a time; leave out either"
        )


def write_live_mosaic(
    source: str,
    output: Path,
    options: MosaicOptions,
    idle_seconds: float | None,
    *,
    overwrite: bool,
    strict: bool,
    require_map: bool,
) -> None:
    """Grow a mosaic until its source ends or the user stops it, and write it.

    Raises
    ------
    InputError
        For an unusable source or output.
    RegistrationError
        If no frame could be used, with ``strict`` if one was left out, with ``require_map`` without a place on the map.
    """
    images.check_output(output, (source,), overwrite=overwrite)
    OutputForm(require_map=require_map).check(output)
    preview = output.with_suffix(".preview.jpg")
    images.check_unused(preview, overwrite=overwrite)
    pace = Pace(options.base_config, options.backend_name)

    def report(update: LiveUpdate) -> None:
        pace.add(update)
        session.stream(update.summary())
        session.tell(f"{update.number} {update.name}: {_describe(update)}")

    mosaic = LiveMosaic(
        options.base_config,
        backend=options.backend_name,
        estimator=options.estimator,
        seed=options.seed,
        working_width_px=options.working_width_px,
        scale=options.scale,
        canvas_limit_px=options.canvas_limit_px or CANVAS_LIMIT_PX,
        on_frame=report,
    )
    outputs = output, preview
    frames = read_live_frames(source, idle_seconds=idle_seconds, tell=session.tell, made=outputs, band=options.band)
    try:
        grow(mosaic, frames, preview)
    # Ctrl-C is how a live mosaic usually ends; `ended_by_signals` turns SIGTERM and a closed terminal into SystemExit.
    # The frames so far are written.
    except (KeyboardInterrupt, SystemExit):
        session.tell("stopped; writing the mosaic")
    mosaic.finish()
    if not mosaic.transforms:
        raise RegistrationError(f"{source}: no frame could be used")
    absent = mosaic.left_out
    try:
        report_absent(absent, strict=strict)
        _report_place(output, mosaic.place, require_map=require_map)
    except RegistrationError:
        # Nothing is left behind that a second run would not overwrite.
        preview.unlink(missing_ok=True)
        raise
    if mosaic.stands_still:
        session.warn(STANDS_STILL)
    # Without a moving display, which a closed terminal would not take.
    session.tell("writing")
    size = _write_composed(mosaic, source, output, options)
    if size is None:
        mosaic.save(output, overwrite=overwrite)
        size = mosaic.image.shape[1], mosaic.image.shape[0]
    if is_folder(Path(source)):
        for path in outputs:
            record_output(path, [Path(source) / path.name])
    for path in outputs:
        session.wrote(path)
    session.tell(str(pace))
    width_px, height_px = size
    frame_count = len(mosaic.transforms)
    session.numbers = {"size": [width_px, height_px], "frames": frame_count, "left_out": absent, "pace": pace.numbers}
    session.numbers |= options.base_config.rules_summary()
    session.show(f"mosaic {output} ({width_px}x{height_px}): {frame_count} frames, {len(absent)} left out")


def _write_composed(mosaic: LiveMosaic, source: str, output: Path, options: MosaicOptions) -> tuple[int, int] | None:
    """Write the mosaic composed from its frames, where they still exist; returns its width and height, else None."""
    is_video = Path(source).is_file()
    if options.band is not None or not (is_video or is_folder(Path(source))):
        return None
    try:
        with flight_sources([source], lambda _line: None) as sources, Workers() as workers:
            by_name = {each.name: each for each in sources}
            flight = flight_of_frames(mosaic.frames, by_name, options.flight_settings(), options.scale, workers)
            if flight is None:
                session.tell("note: written as it was painted, because frames were removed or renamed meanwhile")
                return None
            (layout,) = flight.layouts
            room = room_for(output, planes=4) if options.canvas_limit_px is None else Room(options.canvas_limit_px)
            place = place_on_map(flight, layout)
            composition = compose(flight, layout, scale=options.scale, room=room, place=place)
            deliver(output, flight, layout, composition, composition.bands(workers))
            return composition.size
    # What was painted is better than nothing.
    except (InputError, RegistrationError) as error:
        session.tell(f"note: written as it was painted, because the frames cannot be composed: {error}")
        return None
    finally:
        forget_decoded()


def report_absent(absent: Mapping[int, str], *, strict: bool) -> None:
    """Warn of every photograph or frame that the mosaic does not contain.

    Parameters
    ----------
    absent : mapping of int to str
        Reason for each, by index.
    strict : bool
        Raise an error if anything is absent.

    Raises
    ------
    RegistrationError
        With ``strict``, if anything is absent. Call this before the mosaic is written: the message says it was not.
    """
    for reason in absent.values():
        session.warn(f"left out: {reason}")
    if strict and absent:
        raise RegistrationError(f"{len(absent)} left out, and --strict allows none; nothing was written")


def _report_place(output: Path, place: MapPlace, *, require_map: bool) -> None:
    """Warn of a file without a place on the map, or raise `RegistrationError` where it is required."""
    if place.georeference is not None or output.suffix.lower() not in GEOTIFF_SUFFIXES:
        return
    reason = explain_absence(output, place, "frames with GPS, or mosaic with --gcp FILE")
    if require_map:
        raise RegistrationError(f"{reason}; nothing was written")
    session.warn(reason)


def grow(mosaic: LiveMosaic, frames: Iterable[LiveFrame], preview: Path) -> None:
    """Add frames as they come, and update the preview."""
    previewed_s = 0.0
    for frame in frames:
        update = mosaic.add(frame.pixels, name=frame.name, taken=frame.taken)
        if not update.reason and time.monotonic() - previewed_s >= PREVIEW_SECONDS:
            _write_preview(mosaic, preview)
            previewed_s = time.monotonic()
    if mosaic.transforms:
        _write_preview(mosaic, preview)


def _write_preview(mosaic: LiveMosaic, path: Path) -> None:
    images.save(path, images.reduce_to_width(mosaic.image, PREVIEW_WIDTH_PX)[0])


def _describe(update: LiveUpdate) -> str:
    if update.reason:
        return f"left out: {update.reason}"
    parts = f"; {update.submaps} separate parts" if update.submaps > 1 else ""
    if update.placement is None:
        return f"starts a separate mosaic{parts}"
    neighbours = ", ".join(map(str, update.placement.neighbours))
    return f"{update.placement.ties} ties to {neighbours}, median {update.placement.error_px:.2f} px{parts}"
