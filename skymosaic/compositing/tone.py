"""The tone of a photograph in a mosaic: exposure gain, lens falloff, field of light and highlight shoulder."""

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
"""Factors are computed on a grid this coarse and interpolated: exact to a hundredth at the worst."""


@dataclass(frozen=True, eq=False)
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
    light : ndarray of float64, shape (rows, columns, 1 or 3), or None
        Logarithms of further gains, from the photograph's first pixel to its last one, bilinear in between.
    shoulder : float
        Share of white from which highlights are compressed.
    """

    gain: tuple[float, ...] = (1.0,)
    falloff: tuple[float, float] = (0.0, 0.0)
    black: float = 0.0
    light: Array | None = None
    shoulder: float = SHOULDER_START

    @property
    def is_neutral(self) -> bool:
        """Whether it changes nothing."""
        return all(gain == 1 for gain in self.gain) and not self.varies

    @property
    def varies(self) -> bool:
        """Whether it differs between places of the photograph."""
        return self.light is not None or any(self.falloff)

    def applied(self, pixels: Intensities, factors: Float32 | None = None) -> Intensities:
        """The toned intensities.

        White is the largest number of the pixels' type. Above the shoulder a rational curve continues the straight
        line with the same slope and ends at (white, white), whatever the factor: factors above 1 burn nothing out,
        factors below 1 do not turn white gray.

        Parameters
        ----------
        pixels : ndarray of uint8 or uint16, shape (H, W) or (H, W, 3)
        factors : ndarray of float32, shape (H, W, 1 or 3), or None
            From `factors`; None: the gain alone.
        """
        if self.is_neutral:
            return pixels
        planes = pixels[..., None] if pixels.ndim == 2 else pixels
        factor = np.array(self.gain, dtype=np.float32) if factors is None else factors
        factor = np.broadcast_to(factor[..., : planes.shape[2]], planes.shape)
        black = np.float32(self.black)
        white = np.float32(np.iinfo(pixels.dtype).max) - black
        toned = planes.astype(np.float32)
        if black:
            toned -= black
        toned *= factor
        start = np.float32(self.shoulder) * white
        bright = toned > start
        if bright.any():
            room = white - start
            above = (toned[bright] - start) / room
            above_at_white = (white * factor[bright] - start) / room
            toned[bright] = start + room * above / (1 + above * (1 - 1 / above_at_white))
        if black:
            toned = np.maximum(toned + black, 0)
        return np.asarray(np.rint(toned), dtype=pixels.dtype).reshape(pixels.shape)

    def factors(self, size: tuple[int, int], part: Canvas, to_image: Array | None = None) -> Float32:
        """The factors on a photograph's intensities.

        Parameters
        ----------
        size : (int, int)
            Width and height of the photograph, px.
        part : Canvas
        to_image : ndarray of float64, shape (3, 3), or None
            Reference pixels to the photograph's pixels; None: they are the same.

        Returns
        -------
        ndarray of float32, shape (height_px, width_px, 1 or 3)
        """
        columns, rows = (max(side // FIELD_STEP_PX, 1) + 1 for side in (part.width_px, part.height_px))
        x = part.x_px + np.linspace(0, part.width_px - 1, columns)
        y = part.y_px + np.linspace(0, part.height_px - 1, rows)
        points = np.stack(np.meshgrid(x, y), axis=-1)
        if to_image is not None:
            points = apply(to_image, points)
        last = np.array(size) - 1
        squared = ((points - last / 2) ** 2).sum(axis=-1) / (np.hypot(*size) / 2) ** 2
        logs = np.asarray((self.falloff[0] * squared + self.falloff[1] * squared**2)[..., None] + np.log(self.gain))
        if self.light is not None:
            nodes = np.array(self.light.shape[1::-1]) - 1
            places = (np.clip(points / last, 0, 1) * nodes).astype(np.float32)
            light = cv2.remap(self.light.astype(np.float32), places[..., 0], places[..., 1], cv2.INTER_LINEAR)
            logs = logs + light.reshape(rows, columns, -1)
        return _enlarged(np.exp(logs).astype(np.float32), part)


NEUTRAL = Tone()
"""Changes nothing."""


def _enlarged(coarse: Float32, part: Canvas) -> Float32:
    """A grid whose first and last samples lie on the first and last pixels of ``part``, interpolated to its pixels."""
    rows, columns = coarse.shape[:2]
    across, down = (columns - 1) / max(part.width_px - 1, 1), (rows - 1) / max(part.height_px - 1, 1)
    size = (part.width_px, part.height_px)
    matrix = np.array([[across, 0.0, 0.0], [0.0, down, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    enlarged = cv2.warpAffine(coarse, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(enlarged, dtype=np.float32).reshape(part.height_px, part.width_px, -1)
