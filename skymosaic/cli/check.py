"""The command that checks a flight while it can still be flown again."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from rich.table import Table
from rich.text import Text

from golden_model.text import one_line
from sim.simulators.build_cache import cache_folder
from skymosaic.cli.flight_options import CacheOption, CameraOption, MaskOption, PhotographsArgument, SchedulerOption
from skymosaic.cli.options import (
    AddressOption,
    BackendOption,
    ConfigOption,
    DamagedOption,
    PresetOption,
    SeedOption,
    WorkingWidthOption,
    backend_at,
    configuration,
)
from skymosaic.cli.progress import progress_bars
from skymosaic.cli.session import session
from skymosaic.errors import RegistrationError
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.check import FlightCheck, check_flight
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.workers import Workers
from skymosaic.imagery.band_sets import group_band_sets
from skymosaic.imagery.images import keeps_damaged
from skymosaic.imagery.key_frames import flight_sources
from skymosaic.imagery.lens import load_lens
from skymosaic.registration.register import WORKING_WIDTH_PX


def check(
    *,
    photographs: PhotographsArgument,
    preset: PresetOption = "aerial",
    backend: BackendOption = "golden",
    address: AddressOption = None,
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    seed: SeedOption = 0,
    damaged: DamagedOption = "refuse",
    camera: CameraOption = None,
    mask: MaskOption = None,
    scheduler: SchedulerOption = None,
    cache: CacheOption = None,
) -> None:
    """Check overlap, blur, exposure, GPS and weak links of a flight before you leave the site.

    The exit status is 3 if the photographs do not make one mosaic.
    """
    lens = load_lens(camera, mask)
    settings = Settings(configuration(preset, config), backend_at(backend, address), working_width_px, lens)
    keep = keeps_damaged(damaged)
    kept = ResultCache(cache or cache_folder() / "flights", required=cache is not None, tell=session.tell)
    with (
        progress_bars() as progress,
        flight_sources(photographs, session.tell) as sources,
        Workers(scheduler, progress=progress) as workers,
    ):
        captures = group_band_sets(sources, tell=session.tell)
        kept_damaged = [source.with_damaged(keep=keep) for source in captures]
        flight = survey(kept_damaged, settings, seed, workers, kept)
    found = check_flight(flight)
    session.seconds = flight.seconds
    session.numbers = dataclasses.asdict(found) | {"left_out": flight.left_out}
    _print_check(flight, found)
    if not found.complete:
        raise RegistrationError("the photographs do not make one mosaic; fly again where links are missing")


def _print_check(flight: Flight, found: FlightCheck) -> None:
    table = Table("photograph", "links", "overlap", "sharpness", "clipped", "GPS", "problems", box=None)
    for photo in found.photographs:
        numbers = str(photo.links), f"{photo.overlap:.0%}", f"{photo.sharpness:.2f}", f"{photo.clipped:.0%}"
        name = Text(one_line(Path(photo.name).name))
        table.add_row(name, *numbers, "yes" if photo.gps else "no", ", ".join(photo.problems))
    session.show(table)
    for problem in (*flight.left_out.values(), *found.problems):
        session.warn(problem)
    if found.complete and not found.problems:
        session.show("complete: the photographs make one mosaic")
