"""The command for a mosaic that grows while the camera is still in the air."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from skymosaic.cli.options import (
    AddressOption,
    BackendOption,
    ConfigOption,
    PresetOption,
    SeedOption,
    WorkingWidthOption,
    backend_at,
    configuration,
    console,
    tell,
)
from skymosaic.errors import RegistrationError
from skymosaic.imagery import images
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.live_frames import live_frames
from skymosaic.live.mosaic import LiveMosaic, LiveUpdate
from skymosaic.registration import WORKING_WIDTH_PX

PREVIEW_WIDTH_PX = 1280
PREVIEW_SECONDS = 1.0

IdleOption = Annotated[
    float | None,
    typer.Option("--idle-seconds", min=0, help="End a live mosaic when a folder got nothing new for so long."),
]


def live(
    *,
    source: Annotated[str, typer.Argument(help="A folder that fills, a video or its address, a camera's number.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The mosaic, written at the end: .png, .tif ...")],
    idle_seconds: IdleOption = None,
    scale: Annotated[float, typer.Option(help="Size of the mosaic against the frames.")] = 1.0,
    preset: PresetOption = "aerial",
    backend: BackendOption = "golden",
    address: AddressOption = None,
    config: ConfigOption = None,
    working_width_px: WorkingWidthOption = WORKING_WIDTH_PX,
    seed: SeedOption = 0,
) -> None:
    """Grow a mosaic frame by frame, with a preview beside it; Ctrl-C stops and writes it."""
    images.check_output(output, (source,))
    computed_by = backend_at(backend, address)
    mosaic = LiveMosaic(
        configuration(preset, config), computed_by, seed=seed, working_width_px=working_width_px, scale=scale
    )
    preview = output.with_suffix(".preview.jpg")
    frames = live_frames(source, idle_seconds=idle_seconds, tell=tell, made=(output, preview))
    try:
        grow(mosaic, frames, preview)
    except KeyboardInterrupt:
        tell("stopped")
    mosaic.finish()
    if not mosaic.transforms:
        raise RegistrationError(f"{source}: no frame could be used")
    with console.status("writing"):
        images.save(output, mosaic.image)
    height_px, width_px = mosaic.image.shape[:2]
    tell(f"mosaic {output} ({width_px}x{height_px}): {len(mosaic.transforms)} frames, {len(mosaic.left_out)} left out")
    for number, reason in mosaic.left_out.items():
        tell(f"left out: frame {number}: {reason}")


def grow(mosaic: LiveMosaic, frames: Iterable[Photograph], preview: Path) -> None:
    """Add frames as they come, tell of each, and keep the preview up to date."""
    shown = 0.0
    for frame in frames:
        update = mosaic.add(frame.pixels)
        tell(f"{update.number} {frame.name}: {_what_became(update)}")
        if not update.reason and time.monotonic() - shown >= PREVIEW_SECONDS:
            images.save(preview, images.reduced(mosaic.image, PREVIEW_WIDTH_PX)[0])
            shown = time.monotonic()
    if mosaic.transforms:
        images.save(preview, images.reduced(mosaic.image, PREVIEW_WIDTH_PX)[0])


def _what_became(update: LiveUpdate) -> str:
    if update.reason:
        return f"left out: {update.reason}"
    parts = f"; {update.submaps} separate parts" if update.submaps > 1 else ""
    if update.placement is None:
        return f"begins a part{parts}"
    neighbours = ", ".join(map(str, update.placement.neighbours))
    return f"{update.placement.ties} ties to {neighbours}, median {update.placement.error_px:.2f} px{parts}"
