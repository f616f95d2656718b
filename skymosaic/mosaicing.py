"""Overlapping photographs in, one mosaic out."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from golden_model.arrays import Matrix, Pixels
from golden_model.config import Config, preset_config
from skymosaic.compositing.blend import METHODS, blend
from skymosaic.compositing.warp import CANVAS_LIMIT_PX, CanvasError, canvas_of
from skymosaic.errors import InputError, RegistrationError
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.composition import MEMORY_BYTES, compose
from skymosaic.flight.survey import Flight, survey
from skymosaic.flight.view import Settings
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.key_frames import flight_sources, is_video
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import sources
from skymosaic.registration import WORKING_WIDTH_PX, Pair, register

PAIR_BLENDING, FLIGHT_BLENDING = "distance", "multiband"
"""Default methods: many photographs, of which ten may show one place, would average to a blur."""


@dataclass(frozen=True)
class Mosaic:
    """A mosaic and how it was made.

    Attributes
    ----------
    image : ndarray of uint8, shape (H, W, 3), or (H, W) where every photograph is gray
    transforms : dict of int to ndarray, shape (3, 3)
        For each photograph in the mosaic, its original pixels to canvas pixels. Of a photograph taken with a known
        camera, its pixels once the distortion is taken out.
    placed : tuple of int
        Indices of the photographs in the mosaic.
    left_out : dict of int to str
        Indices of the others, with the reason.
    pairs : tuple of Pair
        The registration behind the mosaic of a pair.
    flight : Flight or None
        What is behind the mosaic of many.
    """

    image: Pixels
    transforms: dict[int, Matrix]
    placed: tuple[int, ...]
    left_out: dict[int, str]
    pairs: tuple[Pair, ...] = ()
    flight: Flight | None = None


def mosaic(
    images: Sequence[str | Path | Pixels],
    *,
    blending: str | None = None,
    scale: float = 1.0,
    canvas_limit_px: int = CANVAS_LIMIT_PX,
    **options: Any,
) -> Mosaic:
    """Make a mosaic of overlapping photographs.

    Parameters
    ----------
    images : sequence of paths or arrays
        At least two; a folder stands for its pictures, a video for its key frames.
    blending : {"average", "distance", "multiband"} or None
        None: distance for two images, multiband along seams for more.
    scale : float
        Canvas pixels a pixel of the reference, more than 0 and at most 1. The reference is the right image of two,
        of more the most connected one, without its tilt.
    canvas_limit_px : int
        Largest canvas area that is accepted.
    **options
        Of `skymosaic.registration.register` for two images, of `mosaics` for more.

    Raises
    ------
    InputError
        For an unusable photograph or option.
    RegistrationError
        Where no mosaic can be made, with the reason and the counts.
    """
    if not any(map(is_video, images)) and len(given := sources(images)) == 2:
        pair = register(given[0].content, given[1].content, **options)
        chosen = blending or PAIR_BLENDING
        return mosaic_of_pair(pair, blending=chosen, scale=scale, canvas_limit_px=canvas_limit_px)
    chosen = blending or FLIGHT_BLENDING
    return next(mosaics(images, blending=chosen, scale=scale, canvas_limit_px=canvas_limit_px, **options))


def mosaics(
    images: Sequence[str | Path | Pixels],
    *,
    blending: str = FLIGHT_BLENDING,
    scale: float = 1.0,
    canvas_limit_px: int = CANVAS_LIMIT_PX,
    preset: str = "aerial",
    config: Config | None = None,
    backend: str = "golden",
    seed: int = 0,
    working_width_px: int = WORKING_WIDTH_PX,
    lens: Lens | None = None,
    scheduler: str | None = None,
    cache: Path | None = None,
    memory_bytes: int = MEMORY_BYTES,
) -> Iterator[Mosaic]:
    """Make a mosaic of each group of photographs that overlap, the largest first.

    Parameters
    ----------
    images, blending, scale, canvas_limit_px
        As `mosaic`.
    preset, config, backend, seed, working_width_px
        As `skymosaic.registration.register`.
    lens : Lens or None
        Distortion and mask that all photographs share, from `skymosaic.imagery.lens.load_lens`.
    scheduler : str or None
        Address of a Dask scheduler; None: threads.
    cache : Path or None
        Folder that keeps features and links for the next run.
    memory_bytes : int
        Limit of the decoded photographs that are kept at once.

    Raises
    ------
    InputError, RegistrationError
        As `mosaic`.
    """
    check_options(blending, scale)
    settings = Settings(config or preset_config(preset), backend, working_width_px, lens or Lens())
    with Workers(scheduler) as workers, flight_sources(images) as given:
        flight = survey(given, settings, seed, workers, ResultCache(cache))
        check_linked(flight)
        for layout in flight.layouts:
            composition = compose(flight, layout, blending=blending, scale=scale, canvas_limit_px=canvas_limit_px)
            image = composition.image(workers, memory_bytes)
            transforms = {placement.source.index: placement.transform for placement in composition.placements}
            yield Mosaic(
                image=image,
                transforms=transforms,
                placed=tuple(sorted(transforms)),
                left_out=flight.absent_from(layout),
                flight=flight,
            )


def check_options(blending: str, scale: float) -> None:
    """Refuse what no mosaic can be made with, before the long work begins."""
    if not 0 < scale <= 1:
        raise InputError(f"scale is {scale}; it must be more than 0 and at most 1")
    if blending not in METHODS:
        raise InputError(f"blending is {blending!r}; valid: {', '.join(METHODS)}")


def check_linked(flight: Flight) -> None:
    """Refuse a flight without any two photographs that could be linked."""
    if not flight.layouts:
        reasons = "; ".join(flight.left_out.values())
        raise RegistrationError(f"none of the photographs could be linked with another: {reasons}")


def mosaic_of_pair(
    pair: Pair, *, blending: str = "distance", scale: float = 1.0, canvas_limit_px: int = CANVAS_LIMIT_PX
) -> Mosaic:
    """Warp and blend a registered pair; the time it takes is added to ``pair.seconds``."""
    check_options(blending, scale)
    if pair.homography is None:
        raise RegistrationError(f"{pair.left.name} and {pair.right.name} cannot be registered: {pair.reason}")
    start = time.perf_counter()
    shrink = resize_matrix(scale)
    photographs = [pair.left, pair.right]
    transforms = [shrink @ pair.homography, shrink]
    try:
        canvas = canvas_of([photo.size for photo in photographs], transforms, limit_px=canvas_limit_px)
    except CanvasError as error:
        raise RegistrationError(f"{pair.left.name} and {pair.right.name}: {error}") from None
    image = blend([photo.pixels for photo in photographs], transforms, canvas, method=blending)
    pair.seconds["warping and blending"] = time.perf_counter() - start
    return Mosaic(
        image=image,
        transforms={side: canvas.translation @ transform for side, transform in enumerate(transforms)},
        placed=(0, 1),
        left_out={},
        pairs=(pair,),
    )
