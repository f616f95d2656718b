"""SURF's key points: maxima of a box-filter Hessian over position and scale (Bay, Tuytelaars and Van Gool, 2006).

Second derivatives are box sums of the integral image, so a filter of any size costs the same. OpenCV's packages leave
out OpenCV's own SURF. Only the detector is implemented here; any descriptor can be combined with it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Pixels

OCTAVES_PX = ((9, 15, 21, 27), (15, 27, 39, 51), (27, 51, 75, 99))
"""Sides of each octave's filters; maxima are searched at the inner two."""
MIXED_WEIGHT = 0.9
"""Corrects the mixed derivative for the boxes that replace Gaussians (equation II-6)."""
MIN_RESPONSE = 10.0
"""Smaller determinants are noise, for gray levels 0 to 255 and filters normalised by their area."""
MAX_STEP = 1.0
"""A fitted maximum farther than one pixel or one filter size from its sample belongs to another sample."""


def key_points(gray: Pixels) -> list[cv2.KeyPoint]:
    """Find the key points of a gray image, at sub-pixel positions.

    ``size`` is the side of the filter in px (scale 1.2 size / 9), ``response`` the determinant, ``angle`` -1: the key
    points are upright.
    """
    integral = cv2.integral(gray)
    octaves = (sizes for sizes in OCTAVES_PX if sizes[-1] < min(gray.shape))
    return [point for sizes in octaves for point in _octave(integral, sizes)]


def determinant(integral: NDArray[np.int32], size_px: int) -> Array:
    """Determinant of the box Hessian, Dxx Dyy - (0.9 Dxy)**2, at every pixel (equations II-4 to II-6), (H, W).

    The image is an integral one (H + 1, W + 1), as of `cv2.integral`. The side of the filters is an odd multiple of 3;
    the derivatives are divided by its square. 0 where the filter leaves the image.
    """
    lobe, half = size_px // 3, size_px // 2
    band = 2 * lobe - 1
    dyy = _box(integral, half, (-half, 1 - lobe), (size_px, band))
    dyy -= 3 * _box(integral, half, (-(lobe // 2), 1 - lobe), (lobe, band))
    dxx = _box(integral, half, (1 - lobe, -half), (band, size_px))
    dxx -= 3 * _box(integral, half, (1 - lobe, -(lobe // 2)), (band, lobe))
    square = (lobe, lobe)
    dxy = _box(integral, half, (-lobe, -lobe), square) + _box(integral, half, (1, 1), square)
    dxy -= _box(integral, half, (-lobe, 1), square) + _box(integral, half, (1, -lobe), square)
    area = size_px**2
    # Each derivative is divided by the area before they are multiplied, so that sizes compare.
    inner = (dxx / area) * (dyy / area) - (MIXED_WEIGHT * dxy / area) ** 2
    return np.pad(inner, half)


def _box(
    integral: NDArray[np.int32], margin_px: int, corner: tuple[int, int], shape: tuple[int, int]
) -> NDArray[np.int32]:
    """Box sums at every pixel at least ``margin_px`` from the border; ``corner`` is the box's first (row, column)
    relative to the pixel, ``shape`` its height and width.
    """
    rows, columns = (side - 1 - 2 * margin_px for side in integral.shape)
    top, left = margin_px + corner[0], margin_px + corner[1]

    def corner_sum(row: int, column: int) -> NDArray[np.int32]:
        return integral[top + row : top + row + rows, left + column : left + column + columns]

    height, width = shape
    total: NDArray[np.int32] = (
        corner_sum(height, width) - corner_sum(0, width) - corner_sum(height, 0) + corner_sum(0, 0)
    )
    return total


def _octave(integral: NDArray[np.int32], sizes: tuple[int, ...]) -> list[cv2.KeyPoint]:
    planes = np.stack([determinant(integral, size) for size in sizes])
    around = np.stack([cv2.dilate(plane, np.ones((3, 3))) for plane in planes])
    around[1:-1] = np.max((around[:-2], around[1:-1], around[2:]), axis=0)
    peaks = (planes > MIN_RESPONSE) & (planes == around)
    peaks[[0, -1]] = False
    scale, y, x = np.nonzero(peaks)
    step, response = _fitted_maxima(planes, scale, y, x)
    # Farther away, a quadratic through the neighbours says nothing about the response.
    kept = np.abs(step).max(axis=1, initial=0) <= MAX_STEP
    spacing = sizes[1] - sizes[0]
    return [
        cv2.KeyPoint(float(column), float(row), float(size), -1, float(value))
        for column, row, size, value in zip(
            (x + step[:, 2])[kept],
            (y + step[:, 1])[kept],
            (np.array(sizes)[scale] + spacing * step[:, 0])[kept],
            response[kept],
            strict=True,
        )
    ]


def _fitted_maxima(
    planes: Array, scale: NDArray[np.intp], y: NDArray[np.intp], x: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Maximum of the quadratic fitted to each sample's 26 neighbours: the step (N, 3) in scale, y, x, and its value."""

    def at(ds: int, dy: int, dx: int) -> Array:
        values: Array = planes[scale + ds, y + dy, x + dx]
        return values

    axes = np.eye(3, dtype=int)
    gradient = np.stack([(at(*axis) - at(*-axis)) / 2 for axis in axes], axis=1)
    curvature = np.empty((len(x), 3, 3))
    for i, first in enumerate(axes):
        for j, second in enumerate(axes):
            if i == j:
                curvature[:, i, j] = at(*first) - 2 * at(0, 0, 0) + at(*-first)
            else:
                together, apart = first + second, first - second
                curvature[:, i, j] = (at(*together) - at(*apart) - at(*-apart) + at(*-together)) / 4
    # Where a maximum is flat in some direction the matrix is singular; the pseudo-inverse takes no step there.
    step = -(np.linalg.pinv(curvature, hermitian=True) @ gradient[..., np.newaxis])[..., 0]
    return step, at(0, 0, 0) + (gradient * step).sum(axis=1) / 2
