"""Paints a preview of a live mosaic from the thumbnails of its frames, anew each time, since their places change."""

from collections.abc import Sequence

import cv2
import numpy as np

from golden_model.arrays import Matrix, Pixels
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.warp import enclosing_canvas
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import resize_matrix

PREVIEW_WIDTH_PX = 1280


def paint_preview(frames: Sequence[tuple[View, Matrix]], width_px: int = PREVIEW_WIDTH_PX) -> Pixels:
    """Paint frames on top of each other, (H, W, 3) BGR; each pixel shows the one whose border is farthest away.

    Each comes with the transformation (3, 3) of its working pixels to the reference frame. The picture is at most
    ``width_px`` wide and twice as high; 0 where there is no frame, empty without frames.
    """
    if not frames:
        return np.zeros((0, 0, 3), np.uint8)
    sizes, transforms = [view.working_size for view, _ in frames], [transform for _, transform in frames]
    whole = enclosing_canvas(sizes, transforms, limit_px=np.inf)
    scale = resize_matrix(min(1.0, width_px / whole.width_px, 2 * width_px / whole.height_px))
    canvas = enclosing_canvas(sizes, [scale @ transform for transform in transforms])
    picture = np.zeros((canvas.height_px, canvas.width_px, 3), np.uint8)
    nearest = np.zeros(picture.shape[:2], np.float32)
    for view, transform in frames:
        image = view.thumbnail if view.thumbnail.ndim == 3 else np.dstack([view.thumbnail] * 3)
        layer = Layer(image, scale @ transform @ view.sight.to_working)
        if (part := layer.footprint.intersection(canvas)) is None:
            continue
        where, distance = part.within(canvas), layer.border_distance(part)
        shown = distance > nearest[where]
        picture[where][shown] = layer.pixels(part, cv2.INTER_LINEAR)[shown]
        np.maximum(nearest[where], distance, out=nearest[where])
    return picture
