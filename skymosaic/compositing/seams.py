"""Finds seams: lines between the photographs of a mosaic along which neighbours look alike.

Seams are found on thumbnails. A photograph may show the pixels to which its claim is nearly as strong as any other's:
by its detail there, and by their distance from its border. Within the overlaps that are left, OpenCV's seam finder cuts
where the colours differ least. It compares every two photographs, so of many of one place most leave before.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.compositing.blend import find_owners
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.warp import Canvas, enclosing
from skymosaic.imagery.depth import ValueRange, show_in_8_bit
from skymosaic.imagery.parcel import Parcel

NEARLY_FARTHEST = 0.6
"""A photograph may show a pixel if its claim is at least this share of the strongest claim to it."""
MIN_OWN_SHARE = 0.01
"""A photograph stays if it has the strongest claim to this share of what it covers; of most flights, all do."""
SURROUND_PX = 2
"""Margin of a mask's rectangle around what a photograph may show, because masks continue beyond their rectangle."""
Allowed = tuple[Canvas, Pixels]
"""Where a photograph may show, 255, in a part of the reduced frame."""
NOTHING = SeamMask(Parcel(np.zeros((1, 1), np.uint8)), Canvas(0, 0, 1, 1), 1.0)
"""The seams of a photograph that shows nowhere."""


def find_allowed(thumbnails: Sequence[Layer]) -> dict[int, Allowed]:
    """Find where each photograph may show, by its index, rising; ``thumbnails`` as of `find_seams`, with any tones.

    Left out are those that hardly own a pixel, and none to which one that stays has not nearly as strong a claim.
    """
    whole = enclosing([layer.footprint for layer in thumbnails])
    owner, strongest = find_owners(thumbnails, whole)
    owned = np.bincount(owner[owner >= 0], minlength=len(thumbnails))
    allowed, missing = dict[int, Allowed](), owner >= 0
    for index in np.argsort(-owned, kind="stable").tolist():
        canvas = thumbnails[index].footprint
        where = canvas.within(whole)
        # Computed again, which takes less than the memory of all claims is worth.
        claim = thumbnails[index].claim(canvas)
        near_enough = (claim > 0) & (claim >= NEARLY_FARTHEST * strongest[where])
        enough = owned[index] >= MIN_OWN_SHARE * np.count_nonzero(claim)
        if enough or (missing[where] & (owner[where] == index)).any():
            missing[where] &= ~near_enough
            # The finder compares whole rectangles, but in a dense flight most of each is far from all its seams.
            some = canvas.bounding(near_enough) if near_enough.any() else Canvas(canvas.x_px, canvas.y_px, 1, 1)
            part = some.grown(SURROUND_PX).intersection(canvas) or canvas
            allowed[index] = part, near_enough[part.within(canvas)].astype(np.uint8) * 255
    return dict(sorted(allowed.items()))


def find_seams(
    thumbnails: Sequence[Layer], allowed: Iterable[Allowed], scale: float, values: ValueRange | None = None
) -> list[SeamMask]:
    """Find the pixels that each photograph shows, by thumbnails on a reduced reference frame, all BGR and with tones.

    ``allowed`` is where each may show; ``scale`` is pixels of that frame per pixel of the mosaic's; ``values`` says how
    8 bits show thumbnails of 16 bits.
    """
    # Any, because OpenCV's type hints do not accept arrays here.
    finder: Any = cv2.detail.DpSeamFinder("COLOR_GRAD")
    to_opencv: Any = cv2.UMat
    parts, masks = zip(*allowed, strict=True)
    shown = [layer.pixels(part, cv2.INTER_LINEAR) for layer, part in zip(thumbnails, parts, strict=True)]
    pixels = [to_opencv(show_in_8_bit(each, values)) for each in shown]
    masks = finder.find(pixels, [(part.x_px, part.y_px) for part in parts], masks)
    return [SeamMask(Parcel(mask.get()), part, scale) for mask, part in zip(masks, parts, strict=True)]
