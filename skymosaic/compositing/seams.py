"""Finds seams: lines between the photographs of a mosaic along which neighbours look alike.

Seams are found on thumbnails. A photograph may show the pixels to which its claim is nearly as strong as any other's:
by its detail there, and by their distance from its border. Within the overlaps that are left, OpenCV's seam finder cuts
where the colours differ least.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Mask
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.warp import Canvas, enclosing
from skymosaic.imagery.depth import ValueRange, show_in_8_bit
from skymosaic.imagery.parcel import Parcel

NEARLY_FARTHEST = 0.6
"""A photograph may show a pixel if its claim is at least this share of the strongest claim to it."""
SURROUND_PX = 2
"""Margin of a mask's rectangle around what a photograph may show, because masks continue beyond their rectangle."""


def find_seams(thumbnails: Sequence[Layer], scale: float, values: ValueRange | None = None) -> list[SeamMask]:
    """Find the pixels that each photograph shows, by thumbnails on a reduced reference frame, all BGR and with tones.

    ``scale`` is pixels of that frame per pixel of the mosaic's; ``values`` says how 8 bits show thumbnails of 16 bits.
    """
    canvases = [layer.footprint for layer in thumbnails]
    whole = enclosing(canvases)
    strongest = np.zeros((whole.height_px, whole.width_px), dtype=np.float32)
    for layer, canvas in zip(thumbnails, canvases, strict=True):
        where = canvas.within(whole)
        strongest[where] = np.maximum(strongest[where], layer.claim(canvas))
    # Any, because OpenCV's type hints do not accept arrays here.
    finder: Any = cv2.detail.DpSeamFinder("COLOR_GRAD")
    to_opencv: Any = cv2.UMat
    parts, allowed, pixels = [], [], []
    for layer, canvas in zip(thumbnails, canvases, strict=True):
        # Computed again, which takes less than the memory of all claims is worth.
        claim = layer.claim(canvas)
        near_enough = (claim > 0) & (claim >= NEARLY_FARTHEST * strongest[canvas.within(whole)])
        # The finder compares whole rectangles, but in a dense flight most of a photograph is far from all its seams.
        part = _surround(near_enough, canvas)
        parts.append(part)
        allowed.append(near_enough[part.within(canvas)].astype(np.uint8) * 255)
        pixels.append(to_opencv(show_in_8_bit(layer.pixels(part, cv2.INTER_LINEAR), values)))
    corners = [(part.x_px, part.y_px) for part in parts]
    masks = finder.find(pixels, corners, allowed)
    return [SeamMask(Parcel(mask.get()), part, scale) for mask, part in zip(masks, parts, strict=True)]


def _surround(mask: Mask, canvas: Canvas) -> Canvas:
    """The part of a canvas that contains the mask and `SURROUND_PX` around it; one pixel if the mask is empty."""
    if not mask.any():
        return Canvas(canvas.x_px, canvas.y_px, 1, 1)
    return canvas.bounding(mask).grown(SURROUND_PX).intersection(canvas) or canvas
