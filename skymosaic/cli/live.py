"""The command for a mosaic that grows while the camera is still in the air."""

from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import PICTURES, OverwriteOption, RequireMapOption, StrictOption, output_option
from skymosaic.cli.outputs import Writes
from skymosaic.cli.progress import print_stages
from skymosaic.cli.remarks import Absent, report_absent, show_notes
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError, RegistrationError, noting
from skymosaic.common.options import INPUT
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.flight.checking.check import describe_moving
from skymosaic.flight.picture.formats import OutputForm, numbered, room_for
from skymosaic.flight.picture.output import Delivery
from skymosaic.geometry.ground import MOVES_WITH_CAMERA
from skymosaic.imagery import images
from skymosaic.imagery.live_frames import read_live_frames
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.patterns import is_folder
from skymosaic.mosaicking.live.mosaic import LiveMosaic
from skymosaic.mosaicking.live.pace import Pace
from skymosaic.mosaicking.live.run import grow
from skymosaic.mosaicking.live.update import LiveUpdate
from skymosaic.mosaicking.options import LiveOptions
from skymosaic.mosaicking.outputs import check_room


def live(
    *,
    source: Annotated[
        str, typer.Argument(help="A folder being filled, a video file or address, or a camera number."), PICTURES
    ],
    idle_seconds: Annotated[
        float | None, typer.Option(min=0, rich_help_panel=INPUT, help="End when no new file has come for this long.")
    ] = None,
    output: Annotated[
        Path,
        output_option("The mosaic, written at the end: .png, .tif, .mbtiles, .kmz ..."),
        Writes(list_outputs=lambda output, _: [output, _preview_of(output)]),
    ],
    overwrite: OverwriteOption = False,
    strict: StrictOption = False,
    require_map: RequireMapOption = False,
    options: LiveOptions,
) -> None:
    """Grow a mosaic frame by frame, with a preview beside it; Ctrl-C or SIGTERM stops and writes it."""
    form = OutputForm(require_map=require_map)
    form.check(output)
    images.check_output(output, overwrite=overwrite)
    preview = _preview_of(output)
    images.check_output(preview, overwrite=overwrite)
    if options.canvas_limit_px is None:
        # In colour, with alpha.
        check_room(output, room_for(output, planes=4))
    pace = Pace(options.base_config, options.backend_name, options.estimator)
    replaces, clock = output.exists(), Stopwatch()
    session.seconds = clock.seconds

    def report(update: LiveUpdate) -> None:
        pace.add(update)
        session.stream(update.summary())
        session.tell(f"{update.number} {update.name}: {update}")

    mosaic = LiveMosaic(options, on_frame=report)
    unusable: dict[str, str] = {}
    frames = read_live_frames(
        source,
        idle_seconds=idle_seconds,
        tell=session.note,
        unusable=unusable,
        made=(output, preview),
        band=options.band,
        recursive=options.recursive,
        keep_damaged=options.keeps_damaged,
    )
    try:
        grow(mosaic, pace.watch(frames), preview, session.tell)
    # Ctrl-C is how a live mosaic usually ends; `ended_by_signals` turns SIGTERM and a closed terminal into SystemExit.
    # The frames so far are written.
    except (KeyboardInterrupt, SystemExit):
        session.tell("stopped; writing the mosaic; stop again for the preview alone")
    clock.lap("growing")
    _refuse_nothing(source, mosaic, unusable, options.band)
    if mosaic.left_out_moving:
        session.warn(MOVES_WITH_CAMERA)
    target = output if replaces else next(path for n in count(1) if not (path := numbered(output, n)).exists())
    try:
        delivery, absent = _write(mosaic, unusable, target, form, overwrite=overwrite, strict=strict)
    except RegistrationError:
        # Nothing is left behind that a second run would not overwrite.
        preview.unlink(missing_ok=True)
        raise
    except (InputError, OSError):
        # It is all that there is.
        if preview.exists():
            session.wrote(preview)
        raise
    clock.lap("laying out and composing")
    written = [path for path in (target, preview) if path.exists()]
    for path in written:
        session.wrote(path)
    if target != output:
        session.warn(f"{output}: came as a frame meanwhile, and stays; the mosaic is {target}")
    session.tell(str(pace))
    _show(delivery, absent, mosaic, pace)
    session.numbers |= options.base_config.rules_summary()
    failures = list(delivery.failures)
    for path in written if is_folder(Path(source)) else ():
        with noting(failures):
            record_output(path, [Path(source)])
    if failures:
        raise InputError("; ".join(failures))


def _preview_of(output: Path) -> Path:
    return output.parent / f"{output.stem}.preview.jpg"


def _refuse_nothing(source: str, mosaic: LiveMosaic, unusable: Mapping[str, str], band: str | None) -> None:
    """Raise `RegistrationError` if no frame was placed, with the first reason."""
    if mosaic.transforms:
        return
    reasons = [*mosaic.left_out.values(), *unusable.values()]
    came = f"none came of band {band}" if band else "none came"
    why = f"{len(reasons)} left out, the first: {reasons[0]}" if reasons else came
    raise RegistrationError(f"{source}: no frame could be used; {why}")


def _write(
    mosaic: LiveMosaic, unusable: Mapping[str, str], output: Path, form: OutputForm, *, overwrite: bool, strict: bool
) -> tuple[Delivery, Absent]:
    """Compose and write what was placed; also returns the frames and files that are not in it, with the reasons."""
    lost: Absent = {**mosaic.left_out, **unusable}
    report_absent(lost, strict=strict)

    def report_more(absent: Mapping[int, str]) -> None:
        report_absent({number: reason for number, reason in absent.items() if number not in lost}, strict=strict)

    # Without a moving display, which a closed terminal would not take.
    try:
        with mosaic.open_run(session.note, print_stages(session.tell)) as run:
            (delivery,) = run.write(output, form, overwrite=overwrite, on_absent=report_more)
            return delivery, {**unusable, **delivery.flight.absent_from(delivery.layout)}
    except KeyboardInterrupt:
        raise InputError(f"{output}: stopped again, so it is not composed; its preview stays") from None


def _show(delivery: Delivery, absent: Absent, mosaic: LiveMosaic, pace: Pace) -> None:
    if not mosaic.left_out_moving and (still := describe_moving(delivery.flight)):
        session.warn(still)
    (width_px, height_px), count = delivery.composition.size, len(delivery.composition.placements)
    session.numbers = {"size": [width_px, height_px], "frames": count, "left_out": absent, "pace": pace.numbers}
    session.show(f"mosaic {delivery.path} ({width_px}x{height_px}): {count} frames, {len(absent)} left out")
    show_notes(delivery, delivery.path)
