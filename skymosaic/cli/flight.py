"""The commands for whole flights: mosaic, of a pair as well, and check."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from sim.build_cache import cache_folder
from skymosaic.cli.live import IdleOption
from skymosaic.cli.live import live as grow_mosaic
from skymosaic.cli.options import (
    AddressOption,
    BackendOption,
    ConfigOption,
    DescriptorOption,
    DetectorOption,
    EstimatorOption,
    PresetOption,
    RefineOption,
    SeedOption,
    WorkingWidthOption,
    backend_at,
    configuration,
    console,
    tell,
)
from skymosaic.cli.pair import mosaic_pair
from skymosaic.compositing.warp import CANVAS_LIMIT_PX
from skymosaic.errors import InputError, RegistrationError
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.check import FlightCheck, check_flight
from skymosaic.flight.composition import compose
from skymosaic.flight.output import Delivery, deliver
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.view import Settings
from skymosaic.flight.workers import Workers
from skymosaic.imagery import images
from skymosaic.imagery.key_frames import flight_sources, is_video
from skymosaic.imagery.lens import load_lens
from skymosaic.imagery.photographs import Source
from skymosaic.mosaicing import FLIGHT_BLENDING, PAIR_BLENDING, check_linked, check_options
from skymosaic.registration import WORKING_WIDTH_PX
from skymosaic.reports.flight import write_flight_report
from skymosaic.reports.pair import prepare

FLIGHTS = "Flights of more than two photographs"
MEGABYTE = 1 << 20

PhotographsArgument = Annotated[
    list[str],
    typer.Argument(help="Overlapping photographs, folders of them, or a video.", metavar="PHOTOGRAPHS|FOLDER|VIDEO"),
]
CameraOption = Annotated[
    Path | None, typer.Option("--camera", rich_help_panel=FLIGHTS, help="TOML file with intrinsics and distortion.")
]
MaskOption = Annotated[
    Path | None,
    typer.Option("--mask", rich_help_panel=FLIGHTS, help="Picture, black where photographs show no ground."),
]
SchedulerOption = Annotated[
    str | None, typer.Option(rich_help_panel=FLIGHTS, help="Dask scheduler (tcp://HOST:PORT) instead of threads.")
]
CacheOption = Annotated[
    Path | None, typer.Option("--cache", rich_help_panel=FLIGHTS, help="Folder for what the next run need not repeat.")
]


def mosaic(
    *,
    photographs: PhotographsArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="The mosaic: .png, .tif, .jpg ...")],
    report_folder: Annotated[Path | None, typer.Option("--report", help="Folder for pictures and numbers.")] = None,
    blending: Annotated[
        str | None,
        typer.Option("--blend", help="average, distance (two photographs) or multiband (more, along seams)."),
    ] = None,
    scale: Annotated[float, typer.Option(help="Size of the mosaic against the photographs.")] = 1.0,
    preset: PresetOption = "aerial",
    detector: DetectorOption = None,
    descriptor: DescriptorOption = None,
    estimator: EstimatorOption = "prosac",
    backend: BackendOption = "golden",
    address: AddressOption = None,
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    seed: SeedOption = 0,
    refine: RefineOption = False,
    camera: CameraOption = None,
    mask: MaskOption = None,
    all_groups: Annotated[
        bool,
        typer.Option("--all-groups", rich_help_panel=FLIGHTS, help="A mosaic of each group that overlaps, numbered."),
    ] = False,
    memory_mb: Annotated[
        int,
        typer.Option("--memory", min=64, rich_help_panel=FLIGHTS, help="Megabytes of photographs kept decoded."),
    ] = 1024,
    canvas_mpx: Annotated[
        int, typer.Option("--canvas-limit", min=1, rich_help_panel=FLIGHTS, help="Largest mosaic, megapixels.")
    ] = CANVAS_LIMIT_PX // 1_000_000,
    scheduler: SchedulerOption = None,
    cache: CacheOption = None,
    live: Annotated[
        bool, typer.Option("--live", help="Grow the mosaic while a folder fills, a video plays or a camera films.")
    ] = False,
    idle_seconds: IdleOption = None,
) -> None:
    """Make one mosaic of overlapping photographs: two, or a whole flight."""
    backend = backend_at(backend, address)
    of_flights = camera or mask or all_groups or scheduler or cache
    of_pairs = detector or descriptor or estimator != "prosac" or refine
    if live:
        if len(photographs) != 1 or report_folder or blending or of_flights or of_pairs:
            raise InputError("--live takes one folder, video or camera, and no report, blending, mask or cluster")
        grow_mosaic(
            source=photographs[0],
            output=output,
            idle_seconds=idle_seconds,
            scale=scale,
            preset=preset,
            backend=backend,
            config=config,
            working_width_px=working_width_px,
            seed=seed,
        )
        return
    chosen = configuration(preset, config)
    with _sources(photographs) as given:
        images.check_output(output, tuple(source.name for source in given))
        if len(given) == 2 and not (camera or mask or any(map(is_video, photographs))):
            mosaic_pair(
                [source.content for source in given],
                output,
                report_folder,
                blending=blending or PAIR_BLENDING,
                scale=scale,
                config=chosen,
                detector=detector,
                descriptor=descriptor,
                estimator=estimator,
                backend=backend,
                seed=seed,
                working_width_px=working_width_px,
                refine=refine,
            )
            return
        if of_pairs:
            raise InputError("--detector, --descriptor, --estimator and --refine are for two photographs alone")
        settings = Settings(chosen, backend, working_width_px, load_lens(camera, mask))
        blending = blending or FLIGHT_BLENDING
        check_options(blending, scale)
        if report_folder:
            prepare(report_folder)
        with _workers(scheduler) as workers:
            flight = survey(given, settings, seed, workers, _cache(cache))
            check_linked(flight)
            layouts = flight.layouts if all_groups else flight.layouts[:1]
            limit_px = canvas_mpx * 1_000_000
            compositions = [
                compose(flight, layout, blending=blending, scale=scale, canvas_limit_px=limit_px) for layout in layouts
            ]
            paths = [output, *(output.with_stem(f"{output.stem}_{number}") for number in range(2, len(layouts) + 1))]
            deliveries = [
                deliver(path, flight, layout, composition, workers=workers, memory_bytes=memory_mb * MEGABYTE)
                for path, layout, composition in zip(paths, layouts, compositions, strict=True)
            ]
    if report_folder:
        write_flight_report(report_folder, deliveries, check_flight(flight))
    _print_deliveries(deliveries, report_folder)


def check(
    *,
    photographs: PhotographsArgument,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")] = False,
    preset: PresetOption = "aerial",
    backend: BackendOption = "golden",
    address: AddressOption = None,
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    seed: SeedOption = 0,
    camera: CameraOption = None,
    mask: MaskOption = None,
    scheduler: SchedulerOption = None,
    cache: CacheOption = None,
) -> None:
    """Check overlap, blur, exposure, GPS and weak links of a flight, while it can still be flown again.

    The exit status is 3 where the photographs do not make one mosaic.
    """
    settings = Settings(
        configuration(preset, config), backend_at(backend, address), working_width_px, load_lens(camera, mask)
    )
    with _sources(photographs) as given, _workers(scheduler) as workers:
        flight = survey(given, settings, seed, workers, _cache(cache))
    found = check_flight(flight)
    if as_json:
        typer.echo(json.dumps(dataclasses.asdict(found) | {"left_out": flight.left_out}))
    else:
        _print_check(flight, found)
    if not found.complete:
        raise RegistrationError("the photographs do not make one mosaic; fly again where links are missing")


@contextmanager
def _sources(photographs: Sequence[str]) -> Iterator[list[Source]]:
    with ExitStack() as stack:
        with console.status("reading"):
            given = stack.enter_context(flight_sources(photographs, tell))
        yield given


@contextmanager
def _workers(scheduler: str | None) -> Iterator[Workers]:
    """Workers whose progress is shown with the time that is left."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks or bars.tasks[tasks[stage]].finished:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done)

        with Workers(scheduler, progress=show) as workers:
            yield workers


def _cache(folder: Path | None) -> ResultCache:
    return ResultCache(folder or cache_folder() / "flights")


def _print_deliveries(deliveries: Sequence[Delivery], report_folder: Path | None) -> None:
    flight = deliveries[0].flight
    lines = []
    for delivery in deliveries:
        layout, (width_px, height_px) = delivery.layout, delivery.composition.size
        placed = f"{len(layout.members)} photographs of {len(flight.names)}"
        lines.append(f"mosaic {delivery.path} ({width_px}x{height_px}), {placed}")
        lines.append(f"{layout.model}, median reprojection error {layout.median_error_px:.2f} px; {layout.reason}")
        if delivery.place:
            lines.append(f"EPSG:{delivery.place.epsg}, GPS residual {delivery.place.residual_m:.2f} m")
        if delivery.map_note:
            lines.append(f"note: {delivery.map_note}")
    absent = flight.left_out if len(deliveries) == len(flight.layouts) else flight.absent_from(deliveries[0].layout)
    lines += [f"left out: {reason}" for reason in absent.values()]
    lines.append("seconds: " + ", ".join(f"{stage} {value:.1f}" for stage, value in flight.seconds.items()))
    if report_folder:
        lines.append(f"report {report_folder / 'index.html'}")
    for line in lines:
        tell(line)


def _print_check(flight: Flight, found: FlightCheck) -> None:
    table = Table("photograph", "links", "overlap", "sharpness", "clipped", "GPS", "problems", box=None)
    for photo in found.photographs:
        numbers = str(photo.links), f"{photo.overlap:.0%}", f"{photo.sharpness:.2f}", f"{photo.clipped:.0%}"
        table.add_row(Path(photo.name).name, *numbers, "yes" if photo.gps else "no", ", ".join(photo.problems))
    console.print(table)
    for problem in (*flight.left_out.values(), *found.problems):
        tell(problem)
    if found.complete and not found.problems:
        console.print("complete: the photographs make one mosaic")
