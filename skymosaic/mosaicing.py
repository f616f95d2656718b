"""Overlapping photographs in, one mosaic out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skymosaic.blend import METHODS, blend
from skymosaic.errors import InputError, RegistrationError
from skymosaic.images import Pixels
from skymosaic.registration import Pair, register
from skymosaic.warp import CANVAS_LIMIT_PX, CanvasError, canvas_of

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Mosaic:
    """A mosaic and how it was made.

    Attributes
    ----------
    image : ndarray of uint8, shape (H, W, 3), or (H, W) where every photograph is gray
    transforms : tuple of ndarray, shape (3, 3)
        For each photograph, its original pixels to canvas pixels.
    placed : tuple of int
        Indices of the photographs in the mosaic.
    left_out : dict of int to str
        Indices of the others, with the reason.
    pairs : tuple of Pair
        The registrations behind it.
    """

    image: Pixels
    transforms: tuple[Matrix, ...]
    placed: tuple[int, ...]
    left_out: dict[int, str]
    pairs: tuple[Pair, ...]


def mosaic(
    images: Sequence[str | Path | Pixels],
    *,
    blending: str = "distance",
    scale: float = 1.0,
    canvas_limit_px: int = CANVAS_LIMIT_PX,
    **registration: Any,
) -> Mosaic:
    """Make a mosaic of two photographs; the canvas frame is the right one's.

    Parameters
    ----------
    images : sequence of two paths or arrays
    blending : {"average", "distance", "multiband"}
    scale : float
        Canvas pixels a pixel of the right photograph, more than 0 and at most 1.
    canvas_limit_px : int
        Largest canvas area that is accepted.
    **registration
        Options of `skymosaic.registration.register`.

    Raises
    ------
    InputError
        For an unusable photograph or option.
    RegistrationError
        Where no mosaic can be made, with the reason and the counts.
    """
    if len(images) != 2:
        raise InputError(f"a mosaic takes two images, not {len(images)}")
    pair = register(images[0], images[1], **registration)
    return mosaic_of_pair(pair, blending=blending, scale=scale, canvas_limit_px=canvas_limit_px)


def mosaic_of_pair(
    pair: Pair, *, blending: str = "distance", scale: float = 1.0, canvas_limit_px: int = CANVAS_LIMIT_PX
) -> Mosaic:
    """Warp and blend a registered pair; the time it takes is added to ``pair.seconds``."""
    if not 0 < scale <= 1:
        raise InputError(f"scale is {scale}; it must be more than 0 and at most 1")
    if blending not in METHODS:
        raise InputError(f"blending is {blending!r}; valid: {', '.join(METHODS)}")
    if pair.homography is None:
        raise RegistrationError(f"{pair.left.name} and {pair.right.name} cannot be registered: {pair.reason}")
    start = time.perf_counter()
    # Pixel centres are at integers: scaling about the corner of pixel (0, 0) keeps them there.
    shrink = np.array([[scale, 0, (scale - 1) / 2], [0, scale, (scale - 1) / 2], [0, 0, 1]])
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
        transforms=tuple(canvas.translation @ transform for transform in transforms),
        placed=(0, 1),
        left_out={},
        pairs=(pair,),
    )
