"""The command that makes a mosaic: of two photographs, of a flight, or of a flight while it lasts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from sim.simulators.build_cache import cache_folder
from skymosaic.cli import flight_options
from skymosaic.cli.flight_options import CacheOption, CameraOption, MaskOption, PhotographsArgument, SchedulerOption
from skymosaic.cli.live import IdleOption, grow_instead, report_absent
from skymosaic.cli.options import (
    AddressOption,
    BackendOption,
    ConfigOption,
    DamagedOption,
    DescriptorOption,
    DetectorOption,
    EffortOption,
    EstimatorOption,
    OverwriteOption,
    PresetOption,
    RefineOption,
    SeedOption,
    StrictOption,
    WorkingWidthOption,
    backend_at,
    choice,
    configuration,
    print_pair,
)
from skymosaic.cli.progress import progress_bars
from skymosaic.cli.session import STDOUT, session
from skymosaic.compositing.blend import METHODS
from skymosaic.compositing.warp import CANVAS_LIMIT_PX
from skymosaic.errors import InputError, RegistrationError
from skymosaic.flight.check import check_flight
from skymosaic.flight.picture.output import GEOTIFF_SUFFIXES, PLAIN, Delivery, OutputForm
from skymosaic.flight.survey import Flight
from skymosaic.imagery.images import check_output, check_unused, save_bytes
from skymosaic.imagery.lens import load_lens
from skymosaic.maps.control_points import load_control_points
from skymosaic.maps.geotiff import COMPRESSIONS
from skymosaic.mosaicking.api import planned
from skymosaic.mosaicking.options import WARPS, MosaicOptions
from skymosaic.registration.register import WORKING_WIDTH_PX
from skymosaic.reports.flight import describe_bands, describe_map, flight_numbers, write_report
from skymosaic.reports.pages import make_folder

MEGABYTE = 1 << 20
MEGAPIXEL = 1_000_000


def mosaic(
    *,
    photographs: PhotographsArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="The mosaic: .png, .tif ...; -: PNG on stdout.")],
    report_folder: Annotated[Path | None, typer.Option("--report", help="Folder for pictures and numbers.")] = None,
    overwrite: OverwriteOption = False,
    strict: StrictOption = False,
    blending: Annotated[
        str | None, choice(METHODS, "By default distance for two photographs, multiband for more.", "--blend")
    ] = None,
    scale: Annotated[float, typer.Option(help="Size of the mosaic against the photographs.")] = 1.0,
    gsd_m: Annotated[
        float | None, typer.Option("--gsd", help="Metres on the ground a pixel, instead of --scale; takes GPS.")
    ] = None,
    compress: Annotated[str, choice(COMPRESSIONS, "Of a .tif; deflate is without loss.")] = "deflate",
    tiles: Annotated[
        Path | None, typer.Option("--tiles", help="Folder for map tiles and a page that shows them offline.")
    ] = None,
    gcp: Annotated[
        Path | None, typer.Option("--gcp", help="Ground control points, as OpenDroneMap's gcp_list.txt.")
    ] = None,
    preset: PresetOption = "aerial",
    detector: DetectorOption = None,
    descriptor: DescriptorOption = None,
    estimator: EstimatorOption = "prosac",
    effort: EffortOption = None,
    warp: Annotated[
        str, choice(WARPS, "A mesh bends the left photograph over relief; for two photographs.")
    ] = "homography",
    backend: BackendOption = "golden",
    address: AddressOption = None,
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    seed: SeedOption = 0,
    refine: RefineOption = False,
    damaged: DamagedOption = "refuse",
    camera: CameraOption = None,
    mask: MaskOption = None,
    band: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=flight_options.MORE,
            help="Of multi-band sets: the band that registers the flight, for instance nir or 2.",
        ),
    ] = None,
    save_camera: Annotated[
        Path | None,
        typer.Option(
            "--save-camera",
            metavar="FILE",
            rich_help_panel=flight_options.MORE,
            help="Write the lens that the ties told, for --camera of the next flight.",
        ),
    ] = None,
    all_groups: Annotated[
        bool,
        typer.Option(
            "--all-groups", rich_help_panel=flight_options.MORE, help="A mosaic of each group that overlaps, numbered."
        ),
    ] = False,
    memory_mb: Annotated[int, typer.Option("--memory", min=64, help="Megabytes of photographs kept decoded.")] = 1024,
    canvas_mpx: Annotated[
        int, typer.Option("--canvas-limit", min=1, help="Largest mosaic, megapixels.")
    ] = CANVAS_LIMIT_PX // MEGAPIXEL,
    scheduler: SchedulerOption = None,
    cache: CacheOption = None,
    live: Annotated[
        bool, typer.Option("--live", help="Grow the mosaic while a folder fills, a video plays or a camera films.")
    ] = False,
    idle_seconds: IdleOption = None,
) -> None:
    """Make one mosaic of overlapping photographs: two, or a whole flight."""
    options = MosaicOptions(
        blending=blending,
        scale=scale,
        gsd_m=gsd_m,
        band=band,
        control=load_control_points(gcp) if gcp else None,
        canvas_limit_px=canvas_mpx * MEGAPIXEL,
        config=configuration(preset, config),
        detector=detector,
        descriptor=descriptor,
        estimator=estimator,
        effort=effort,
        warp=warp,
        backend=backend_at(backend, address),
        seed=seed,
        working_width_px=working_width_px,
        refine=refine,
        damaged=damaged,
        lens=load_lens(camera, mask) if camera or mask else None,
        all_groups=all_groups,
        scheduler=scheduler,
        cache=cache,
        default_cache=cache_folder() / "flights",
        memory_bytes=memory_mb * MEGABYTE,
    )
    form = OutputForm(compress, tiles)
    if live:
        if form != PLAIN or gsd_m or gcp:
            raise InputError("--gsd, --gcp, --compress and --tiles need the whole flight; leave them out, or --live")
        if save_camera is not None:
            raise InputError("--save-camera: a live mosaic does not estimate the lens; leave out either")
        grow_instead(photographs, output, report_folder, options, idle_seconds, overwrite=overwrite, strict=strict)
        return
    if idle_seconds is not None:
        raise InputError("--idle-seconds ends a live mosaic; add --live, or leave it out")
    if save_camera is not None and camera is not None:
        raise InputError("--save-camera: the lens is given by --camera, so it is not estimated; leave one out")
    with session.destination(output, "mosaic.png") as target:
        deliveries = _made(
            photographs,
            target,
            report_folder,
            options,
            form=form,
            save_camera=save_camera,
            overwrite=overwrite,
            strict=strict,
        )
        _show(deliveries, output, report_folder)
    if save_camera is not None:
        _save_camera(save_camera, deliveries[0].flight)


def _made(
    photographs: Sequence[str],
    output: Path,
    report_folder: Path | None,
    options: MosaicOptions,
    *,
    form: OutputForm,
    save_camera: Path | None,
    overwrite: bool,
    strict: bool,
) -> list[Delivery]:
    """Write the mosaics and their report; of a pair that cannot be registered, the report alone, which shows why."""
    with progress_bars() as progress, planned(photographs, options, progress, session.tell) as plan:
        plan.check_outputs(output, form, overwrite=overwrite)
        if save_camera is not None:
            if len(plan.sources) == 2:
                raise InputError("--save-camera: two photographs do not tell the lens; leave it out")
            check_output(save_camera, (str(output), *photographs), (".toml",), overwrite=overwrite)
        if report_folder:
            check_unused(report_folder, overwrite=overwrite)
            make_folder(report_folder)
        deliveries: list[Delivery] = []
        try:
            layouts = plan.layouts
            whole = plan.flight.left_out if options.all_groups else plan.flight.absent_from(layouts[0])
            report_absent(whole, strict=strict)
            deliveries = plan.write(output, form, overwrite=overwrite)
        except RegistrationError:
            if report_folder:
                write_report(report_folder, plan.flight, deliveries)
            raise
        if report_folder:
            write_report(report_folder, plan.flight, deliveries)
    return deliveries


def _save_camera(path: Path, flight: Flight) -> None:
    """Write the lens that the ties told, or say why there is none."""
    if flight.calibration is None:
        session.warn("no camera file: straightening the lens does not help the ties, or they are too few")
    else:
        save_bytes(path, flight.calibration.camera_file.encode())
        session.wrote(path)
        session.show(f"camera {path}")


def _show(deliveries: Sequence[Delivery], output: Path, report_folder: Path | None) -> None:
    flight = deliveries[0].flight
    session.seconds = dict(flight.seconds)
    session.numbers = flight_numbers(deliveries, check_flight(flight))
    if flight.pair is not None:
        session.numbers["pair"] = flight.pair.summary()
        print_pair(flight.pair)
        if flight.sources[0].bend is not None:
            session.show("warp: a mesh bends the left photograph to follow the relief")
    for delivery in deliveries:
        _show_mosaic(delivery, output if output == STDOUT else delivery.path)
    if (lens := flight.calibration) is not None:
        session.show(
            f"lens: k1 {lens.k1:.4f} (focal length {lens.focal_px:.0f} px); median error of held-out ties "
            f"{lens.before_px:.2f} px without it, {lens.after_px:.2f} px with it"
        )
    if report_folder:
        session.wrote(report_folder)
        session.show(f"report {report_folder / 'index.html'}")


def _show_mosaic(delivery: Delivery, path: Path) -> None:
    flight, layout, (width_px, height_px) = delivery.flight, delivery.layout, delivery.composition.size
    session.wrote(path)
    # A pair counts its blending among its own stages, and a flight does not.
    writing = delivery.seconds - (flight.pair.seconds["warping and blending"] if flight.pair else 0.0)
    session.seconds["writing" if flight.pair else "blending and writing"] = writing
    session.show(f"mosaic {path} ({width_px}x{height_px}), {len(layout.members)} photographs of {len(flight.names)}")
    if flight.pair is None:
        session.show(f"{layout.model}, median reprojection error {layout.median_error_px:.2f} px; {layout.reason}")
    if delivery.tiles:
        session.wrote(delivery.tiles)
        session.show(f"tiles {delivery.tiles / 'index.html'}")
    if delivery.composition.band_names:
        session.show(f"bands: {describe_bands(delivery.composition)}")
    if values := delivery.composition.values:
        session.show(f"range: {values.description}")
    if delivery.georeference:
        session.show(describe_map(delivery))
    # Who asks for a picture of two photographs expects no map; who asks for a .tif may.
    wants_map = flight.pair is None or path.suffix.lower() in GEOTIFF_SUFFIXES
    if delivery.map_note and (delivery.georeference or wants_map):
        session.tell(f"note: {delivery.map_note}")
