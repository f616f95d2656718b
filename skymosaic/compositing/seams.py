"""Seams: lines between the photographs of a mosaic along which neighbours look alike.

Seams are found on thumbnails. Each photograph may show the pixels that are nearly as far from its own border as from
any other's; within the remaining overlaps, OpenCV's seam finder cuts where the colours differ least.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.warp import canvas_of, footprint

NEARLY_FARTHEST = 0.6
"""A photograph may show a pixel if its claim is at least this share of the strongest claim to it."""


def seam_masks(thumbnails: Sequence[Layer], scale: float) -> list[SeamMask]:
    """Find the pixels that each photograph shows.

    Parameters
    ----------
    thumbnails : sequence of Layer
        The photographs on a reduced reference frame, all BGR, with their gains.
    scale : float
        Pixels of that frame per pixel of the mosaic's reference frame.

    Returns
    -------
    list of SeamMask
        One for each thumbnail.
    """
    canvases = [footprint(layer.size, layer.transform) for layer in thumbnails]
    claims = [layer.claim(canvas) for layer, canvas in zip(thumbnails, canvases, strict=True)]
    whole = canvas_of([layer.size for layer in thumbnails], [layer.transform for layer in thumbnails])
    strongest = np.zeros((whole.height_px, whole.width_px), dtype=np.float32)
    for canvas, claim in zip(canvases, claims, strict=True):
        where = canvas.within(whole)
        strongest[where] = np.maximum(strongest[where], claim)
    # Lists of Any, because OpenCV's type hints do not accept lists of arrays here.
    allowed: list[Any] = []
    for canvas, claim in zip(canvases, claims, strict=True):
        near_enough = (claim > 0) & (claim >= NEARLY_FARTHEST * strongest[canvas.within(whole)])
        allowed.append(near_enough.astype(np.uint8) * 255)
    pixels: list[Any] = [
        layer.pixels(canvas).astype(np.float32) for layer, canvas in zip(thumbnails, canvases, strict=True)
    ]
    corners = [(canvas.x_px, canvas.y_px) for canvas in canvases]
    found = cv2.detail.DpSeamFinder("COLOR_GRAD").find(pixels, corners, allowed)
    return [SeamMask(mask.get(), canvas, scale) for mask, canvas in zip(found, canvases, strict=True)]
