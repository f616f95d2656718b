"""Forward warping and the cylinder: the thesis's alternatives to backward warping and the plane (section II.2.4)."""

import math

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply


def warp_forward(image: Pixels, transform: Array, canvas: Canvas) -> Pixels:
    """Warp forward, x' = Hx, to the nearest pixel (thesis, equation II-16).

    Arguments and result as in `skymosaic.compositing.warp.warp_backward`. Pixels that nothing maps to stay 0, so the
    result has holes where the transformation enlarges.
    """
    warped = np.zeros((canvas.height_px, canvas.width_px, *image.shape[2:]), dtype=np.uint8)
    whole = Canvas(0, 0, *image.shape[1::-1])
    for part in whole.tiles():
        rows, columns = part.within(whole)
        y, x = np.mgrid[rows, columns]
        target = apply(canvas.translation @ transform, np.stack([x, y], axis=-1))
        inside = ((target > -0.5) & (target < np.array([canvas.width_px, canvas.height_px]) - 0.5)).all(axis=-1)
        column, row = np.rint(target[inside]).astype(np.int64).T
        warped[row, column] = image[rows, columns][inside]
    return warped


def project_to_cylinder(image: Pixels, focal_px: float) -> Pixels:
    """Project an image onto a cylinder about the vertical axis through the camera (thesis, section II.2.4).

    On the cylinder, a rotation of the camera about that axis becomes a shift along x.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) uint8 ndarray
        Taken with its optical axis through the centre.
    focal_px : float
        Focal length in pixels, the cylinder's radius; the scale at the centre is kept.

    Returns
    -------
    uint8 ndarray
        As high as the image and as wide as its arc; 0 where the image shows nothing.
    """
    height, width = image.shape[:2]
    arc = 2 * math.floor(focal_px * math.atan((width - 1) / 2 / focal_px)) + 1
    angle = (np.arange(arc) - (arc - 1) / 2) / focal_px
    rise = np.arange(height) - (height - 1) / 2
    x = np.broadcast_to(focal_px * np.tan(angle) + (width - 1) / 2, (height, arc))
    y = rise[:, None] / np.cos(angle) + (height - 1) / 2
    return np.asarray(cv2.remap(image, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR), dtype=np.uint8)
