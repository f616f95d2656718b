"""The command that makes a mosaic: of two photographs, or of a flight."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import (
    OverwriteOption,
    PhotographsArgument,
    RequireMapOption,
    StrictOption,
    choice,
    output_option,
    print_pair,
)
from skymosaic.cli.outputs import Typed, Writes
from skymosaic.cli.progress import progress_bars
from skymosaic.cli.remarks import report_absent, show_notes
from skymosaic.cli.session import STDOUT, session
from skymosaic.common.errors import InputError, RegistrationError, noting
from skymosaic.common.options import MAP, OUTPUT
from skymosaic.flight.checking.check import check_flight, describe_moving, doubts, layout_errors
from skymosaic.flight.picture.formats import OutputForm, sources_of
from skymosaic.flight.picture.output import Delivery
from skymosaic.imagery.images import check_output, check_output_folder, save_bytes
from skymosaic.maps.geotiff import COMPRESSIONS
from skymosaic.maps.tiles import OWN_NAMES as TILE_NAMES
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.mosaicking.outputs import check_outputs, list_numbered
from skymosaic.mosaicking.run import MosaicRun
from skymosaic.reports.flight import flight_numbers, write_report
from skymosaic.reports.pages import OWN_NAMES as REPORT_NAMES


def _list_groups(output: Path | None, typed: Typed) -> list[Path]:
    """An output, and those of further groups that exist."""
    return [] if output is None else [output, *(list_numbered(output) if typed["all_groups"] else ())]


def _list_mosaics(output: Path, typed: Typed) -> list[Path]:
    """The mosaics, and what is written beside each."""
    mosaics = _list_groups(output, typed)
    return [*mosaics, *(map(sources_of, mosaics) if typed["sources"] else ())]


def mosaic(
    *,
    photographs: PhotographsArgument,
    output: Annotated[
        Path,
        output_option("The mosaic: .png, .tif, .mbtiles, .kmz ...; -: PNG on stdout."),
        Writes(list_outputs=_list_mosaics),
    ],
    report: Annotated[
        Path | None, typer.Option(rich_help_panel=OUTPUT, help="Folder for pictures and numbers."), Writes(REPORT_NAMES)
    ] = None,
    save_camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            rich_help_panel=OUTPUT,
            help="Write the lens estimated from a flight's tie points, for --camera of the next one.",
        ),
        Writes(),
    ] = None,
    compress: Annotated[
        str, choice(COMPRESSIONS, "Compression of a .tif; deflate is lossless.", group=OUTPUT)
    ] = "deflate",
    overwrite: OverwriteOption = False,
    strict: StrictOption = False,
    require_map: RequireMapOption = False,
    tiles: Annotated[
        Path | None,
        typer.Option(rich_help_panel=MAP, help="Folder for map tiles and a page that shows them offline."),
        Writes(TILE_NAMES, list_outputs=_list_groups),
    ] = None,
    sources: Annotated[
        bool,
        typer.Option(
            "--sources",
            rich_help_panel=OUTPUT,
            help="Write which photograph each pixel shows, beside mosaic.tif as mosaic.sources.tif.",
        ),
    ] = False,
    options: MosaicOptions,
) -> None:
    """Make one mosaic of overlapping photographs: two, or a whole flight."""
    if sources and output == STDOUT:
        raise InputError("--sources: a mosaic on stdout has no file beside it; name one by -o")
    if save_camera and options.lens and options.lens.matrix is not None:
        raise InputError("--save-camera: the lens is given by --camera, so it is not estimated; leave one out")
    form = OutputForm(compress, tiles, require_map, sources)
    with (
        session.destination(output, "mosaic.png") as target,
        progress_bars() as progress,
        open_run(photographs, options, progress, session.note) as run,
    ):
        check_outputs(target, form, run.sources, options, overwrite=overwrite)
        if save_camera:
            if len(run.sources) == 2:
                raise InputError("--save-camera: two photographs are too few to estimate the lens; leave it out")
            check_output(save_camera, suffixes=(".toml",), overwrite=overwrite)
        if report:
            check_output_folder(report, overwrite=overwrite)
        written = _write_mosaics(run, target, form, report, overwrite=overwrite, strict=strict)
    # Before anything is printed, which a closed pipe ends.
    if save_camera:
        _save_camera(save_camera, written)
    _show(written, output)
    if written.failures:
        raise InputError("; ".join(written.failures))


@dataclass
class _Written:
    """The outputs that were written, and lines about those that could not be."""

    deliveries: list[Delivery]
    failures: list[str]
    report: Path | None = None
    camera: Path | None = None


def _write_mosaics(
    run: MosaicRun, output: Path, form: OutputForm, report: Path | None, *, overwrite: bool, strict: bool
) -> _Written:
    """Write the mosaics and their report; of a pair that cannot be registered, the report alone, which shows why."""
    # An error of the survey itself leaves nothing to report.
    groups = len(run.flight.layouts)
    if groups > 1 and not run.options.all_groups:
        rule = "the one with most photographs, of as many the one with most pixels"
        session.note(f"note: {groups} groups; this is {rule}; `all_groups` makes a mosaic of each")
    try:
        deliveries = run.write(output, form, overwrite=overwrite, on_absent=partial(report_absent, strict=strict))
    except RegistrationError:
        # The report of two photographs shows what was matched, and so why they were refused.
        if report:
            write_report(report, run.flight, [])
        raise
    written = _Written(deliveries, [line for delivery in deliveries for line in delivery.failures])
    if report:
        with noting(written.failures):
            write_report(report, run.flight, deliveries)
            written.report = report
    return written


def _save_camera(path: Path, written: _Written) -> None:
    """Write the lens estimated from tie points, or say why there is none."""
    lens = written.deliveries[0].flight.calibration
    if lens is None:
        session.warn("no camera file: correcting the lens does not improve the tie points, or they are too few")
        return
    with noting(written.failures):
        save_bytes(path, lens.camera_file.encode())
        written.camera = path


def _show(written: _Written, output: Path) -> None:
    deliveries, flight = written.deliveries, written.deliveries[0].flight
    session.seconds = dict(flight.seconds)
    session.numbers = flight_numbers(deliveries, check_flight(flight))
    if flight.pair is not None:
        session.numbers["pair"] = flight.pair.summary()
        print_pair(flight.pair)
    if moves := describe_moving(flight):
        session.warn(moves)
    for delivery in deliveries:
        _show_mosaic(delivery, output if output == STDOUT else delivery.path)
    if (lens := flight.calibration) is not None:
        numbers = list(lens.lens.numbers.items())[2:]
        session.show(
            f"lens: {', '.join(f'{name} {value:.4g}' for name, value in numbers)}; median error of held-out ties "
            f"{lens.before_px:.2f} px without it, {lens.after_px:.2f} px with it"
        )
    if written.report:
        session.wrote(written.report)
        session.show(f"report {written.report / 'index.html'}")
    if written.camera:
        session.wrote(written.camera)
        session.show(f"camera {written.camera}")


def _show_mosaic(delivery: Delivery, path: Path) -> None:
    flight, layout, (width_px, height_px) = delivery.flight, delivery.layout, delivery.composition.size
    session.wrote(path)
    # A pair counts its blending among its own stages, and a flight does not.
    writing = delivery.seconds - (flight.pair.seconds["warping and blending"] if flight.pair else 0.0)
    session.seconds["writing" if flight.pair else "blending and writing"] = writing
    session.show(f"mosaic {path} ({width_px}x{height_px}), {len(layout.members)} photographs of {len(flight.names)}")
    if flight.pair is None:
        session.show(f"{layout.model}; {layout.reason}")
        for line in doubts(flight, layout):
            session.warn(line)
        session.show(f"overlaps: {layout.agreement.description}")
        if (errors := layout_errors(flight, layout)) is not None:
            session.show(f"linked pairs: {errors.description}")
    if delivery.sources:
        session.wrote(delivery.sources)
        session.show(f"sources {delivery.sources}")
    if delivery.tiles:
        session.wrote(delivery.tiles)
        session.show(f"tiles {delivery.tiles / 'index.html'}")
    show_notes(delivery, path)
