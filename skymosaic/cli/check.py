"""The command that checks a flight while it can still be flown again."""

import dataclasses
from pathlib import Path
from typing import Annotated

from rich.table import Table
from rich.text import Text

from golden_model.text import one_line
from skymosaic.cli.options import OverwriteOption, PhotographsArgument, output_option
from skymosaic.cli.outputs import Writes
from skymosaic.cli.progress import progress_bars
from skymosaic.cli.remarks import group_reasons
from skymosaic.cli.session import session
from skymosaic.common.errors import RegistrationError
from skymosaic.flight.checking.check import FlightCheck, check_flight
from skymosaic.flight.checking.fly_again import plan_again
from skymosaic.flight.flight import Flight
from skymosaic.flight.mapping.place import list_contradictions
from skymosaic.flight.picture.relief import follow_relief
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.images import check_output
from skymosaic.imagery.key_frames import flight_sources
from skymosaic.maps.features import SUFFIXES, write_places
from skymosaic.mosaicking.options import SurveyOptions
from skymosaic.mosaicking.outputs import check_boundary
from skymosaic.mosaicking.run import lay_out
from skymosaic.running.workers import Workers


def check(
    *,
    photographs: PhotographsArgument,
    output: Annotated[
        Path | None, output_option("Where to fly again: .kml or .geojson, of a flight with GPS."), Writes()
    ] = None,
    overwrite: OverwriteOption = False,
    options: SurveyOptions,
) -> None:
    """Check overlap, blur, exposure, GPS and weak links of a flight before you leave the site.

    The exit status is 3 if the photographs do not make one mosaic.
    """
    if output is not None:
        check_output(output, suffixes=SUFFIXES, overwrite=overwrite)
    with (
        progress_bars() as progress,
        flight_sources(photographs, session.note, recursive=options.recursive) as sources,
        Workers(options.scheduler, progress=progress, sources=sources) as workers,
    ):
        captures = group_band_sets(sources, tell=session.note)
        captures = [source.with_damaged(keep=options.keeps_damaged) for source in captures]
        if options.boundary is not None:
            check_boundary(captures, options, options.boundary)
        flight = follow_relief(lay_out(captures, options, workers, session.note))
    report = check_flight(flight)
    contradictions = list_contradictions(flight, options.control_points)
    report = dataclasses.replace(report, problems=(*report.problems, *contradictions))
    session.seconds = flight.seconds
    left_out = {index: flight.shorten(reason) for index, reason in flight.left_out.items()}
    session.numbers = dataclasses.asdict(report) | {"left_out": left_out}
    _print_check(flight, report)
    if output is not None or options.boundary is not None:
        places, share = plan_again(flight, options.control_points, options.boundary)
        if options.boundary is not None:
            session.numbers["boundary_shown"] = share
            session.show(f"boundary: photographs show {share:.1%} of {options.boundary.name}")
    if output is not None:
        write_places(output, f"fly again: {photographs[0]}", places)
        session.wrote(output)
        session.show(f"fly again {output}: {len(places)} places")
    if not report.complete:
        advice = "fly again where links are missing" if flight.layouts else "the warnings say why"
        raise RegistrationError(f"the photographs do not make one mosaic; {advice}")


def _print_check(flight: Flight, report: FlightCheck) -> None:
    titles = "photograph", "links", "overlap", "error", "sharpness", "clipped", "GPS", "problems"
    table = Table(*titles, box=None)
    for photo in report.photographs:
        error = "" if photo.error_px is None else f"{photo.error_px:.1f} px"
        numbers = str(photo.links), f"{photo.overlap:.0%}", error, f"{photo.sharpness:.2f}", f"{photo.clipped:.0%}"
        name = Text(one_line(photo.name))
        table.add_row(name, *numbers, "yes" if photo.gps else "no", ", ".join(photo.problems))
    session.show(table)
    for problem in (*group_reasons(flight.left_out.values()), *report.problems):
        session.warn(problem)
    for layout in flight.layouts:
        session.show(f"overlaps: {layout.agreement.description}")
    for errors in report.errors:
        session.show(f"linked pairs: {errors.description}")
    if report.complete:
        session.show("complete: the photographs make one mosaic" + "; read the warnings" * bool(report.problems))
