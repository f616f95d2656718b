"""The tone of a photograph in a mosaic: exposure gain, lens falloff and highlight shoulder."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Intensities
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply

SHOULDER_START = 200 / 255
"""Toned intensities above this share of white are compressed, so that what was below white stays below white."""
FIELD_STEP_PX = 16
"""Distances from the image centre are computed on a grid this coarse and interpolated: exact to a thousandth."""


@dataclass(frozen=True)
class Tone:
    """What makes a photograph's intensities agree with those of its neighbours.

    Attributes
    ----------
    gain : tuple of float
        Factor on the intensities, one or one for each channel.
    falloff : tuple of float
        Coefficients v of the lens falloff: the photograph is darker towards its corners by
        exp(-(v[0] r^2 + v[1] r^4)), with r the distance from its centre in half diagonals, and the tone undoes it.
        The same for all photographs of a camera.
    black : float
        The intensity that stays as it is whatever the gain. Above 0 for photographs of 16 bits, whose numbers begin at
        some level of the camera's.
    """

    gain: tuple[float, ...] = (1.0,)
    falloff: tuple[float, float] = (0.0, 0.0)
    black: float = 0.0

    @property
    def is_neutral(self) -> bool:
        """Whether it changes nothing."""
        return all(gain == 1 for gain in self.gain) and not self.needs_radius

    @property
    def needs_radius(self) -> bool:
        """Whether it differs between centre and corners."""
        return any(self.falloff)

    def applied(self, pixels: Intensities, radius: Float32 | None = None) -> Intensities:
        """The toned intensities.

        Parameters
        ----------
        pixels : ndarray of uint8 or uint16, shape (H, W) or (H, W, 3)
        radius : ndarray of float32, shape (H, W), or None
            Distance of each pixel from the centre of its photograph, in half diagonals; None: 0 everywhere.
        """
        if self.is_neutral:
            return pixels
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        gain = self.gain * channels if len(self.gain) == 1 else self.gain
        planes = pixels[..., None] if pixels.ndim == 2 else pixels
        field = self.field(radius) if radius is not None and self.needs_radius else None
        black = np.float32(self.black)
        toned = [_compressed(planes[..., k], np.float32(gain[k]), field, black) for k in range(channels)]
        return toned[0] if pixels.ndim == 2 else np.asarray(cv2.merge(toned), dtype=pixels.dtype)

    def field(self, radius: Float32) -> Float32:
        """The factor that undoes the lens falloff."""
        squared = radius * radius
        return np.asarray(np.exp(self.falloff[0] * squared + self.falloff[1] * squared * squared), dtype=np.float32)


NEUTRAL = Tone()
"""Changes nothing."""


def _compressed(plane: Intensities, gain: np.float32, field: Float32 | None, black: np.float32) -> Intensities:
    """One channel times gain and field, with the highlights compressed: white stays white, all else below it.

    White is the largest number of the plane's type. Above `SHOULDER_START` a rational curve continues the straight
    line with the same slope and ends at (white, white), whatever the factor: factors above 1 burn nothing out,
    factors below 1 do not turn white gray.
    """
    factor = np.full(plane.shape, gain, dtype=np.float32) if field is None else gain * field
    white = np.float32(np.iinfo(plane.dtype).max) - black
    toned = plane.astype(np.float32)
    if black:
        toned -= black
    toned *= factor
    start = np.float32(SHOULDER_START) * white
    bright = toned > start
    if bright.any():
        room = white - start
        above = (toned[bright] - start) / room
        above_at_white = (white * factor[bright] - start) / room
        toned[bright] = start + room * above / (1 + above * (1 - 1 / above_at_white))
    if black:
        toned = np.maximum(toned + black, 0)
    return np.asarray(np.rint(toned), dtype=plane.dtype)


def radius_of(size: tuple[int, int], part: Canvas, to_image: Array | None = None) -> Float32:
    """Distance of the pixels of ``part`` from the centre of an image of ``size``, in half diagonals of the image.

    Parameters
    ----------
    size : (int, int)
        Width and height of the image, px.
    part : Canvas
    to_image : ndarray of float64, shape (3, 3), or None
        Reference pixels to image pixels; None: they are the same.

    Returns
    -------
    ndarray of float32, shape (height_px, width_px)
    """
    columns, rows = (max(side // FIELD_STEP_PX, 1) + 1 for side in (part.width_px, part.height_px))
    x = part.x_px + np.linspace(0, part.width_px - 1, columns)
    y = part.y_px + np.linspace(0, part.height_px - 1, rows)
    points = np.stack(np.meshgrid(x, y), axis=-1)
    if to_image is not None:
        points = apply(to_image, points)
    distance = np.linalg.norm(points - (np.array(size) - 1) / 2, axis=-1) / (np.hypot(*size) / 2)
    # The grid's first and last samples lie on the first and last pixels, so resize's half-pixel frame does not fit.
    steps = [np.linspace(0, count - 1, side) for count, side in ((columns, part.width_px), (rows, part.height_px))]
    map_x, map_y = np.meshgrid(*(step.astype(np.float32) for step in steps))
    return np.asarray(cv2.remap(distance.astype(np.float32), map_x, map_y, cv2.INTER_LINEAR), dtype=np.float32)
