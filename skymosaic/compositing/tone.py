"""Tone of a photograph in a mosaic: exposure gain, the camera's shading, light field and highlight shoulder."""

from dataclasses import dataclass

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Intensities, Points
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply

SHOULDER_START = 200 / 255
"""Toned intensities above this share of white are compressed, so that what was below white stays below white."""
SHADING_TERMS = 4
"""Terms of the shading, see `shading_terms`."""
STRIP_PX = 16
"""Rows that are toned at a time."""
FIELD_STEP_PX = 16
"""Factors are computed on a grid this coarse and interpolated, with errors of a hundredth at most."""


@dataclass(frozen=True, eq=False)
class Tone:
    """Correction that makes a photograph's intensities agree with those of its neighbours."""

    gain: tuple[float, ...] = (1.0,)
    """Factor on the intensities, one for all channels or one per channel."""
    shading: Array | None = None
    """(4, 1 or 3): the light that belongs to the camera, the same for all its photographs: each is darker by the
    exponential of `shading_terms` times these coefficients, and the tone undoes that."""
    black: float = 0.0
    """The intensity that no gain changes. Above 0 for photographs of 16 bits from a camera with a black level."""
    light: Float32 | None = None
    """(rows, columns, 1 or 3): logarithms of further gains, from the photograph's first pixel to its last one, bilinear
    in between."""
    shoulder: float = SHOULDER_START
    """Share of white from which highlights are compressed."""

    @property
    def varies(self) -> bool:
        """Whether the tone differs between places of the photograph."""
        return self.light is not None or self.shading is not None

    def apply(self, pixels: Intensities, factors: Float32 | None = None) -> Intensities:
        """Apply the tone to intensities.

        White is the largest number of the pixels' type. Above the shoulder, a share of white or of what a factor below
        1 makes of it, a rational curve continues the straight line with the same slope and ends at (white, white). So
        factors above 1 burn nothing out, those below 1 do not turn white gray, and where they vary, as over a burnt
        sky, nothing jumps. ``factors`` (H, W, 1 or 3) are from `factors`; None: the gain alone.
        """
        if all(gain == 1 for gain in self.gain) and not self.varies:
            return pixels
        planes = pixels[..., None] if pixels.ndim == 2 else pixels
        factor = np.array(self.gain, dtype=np.float32) if factors is None else factors
        factor = np.broadcast_to(factor[..., : planes.shape[2]], planes.shape)
        black = np.float32(self.black)
        white = np.float32(np.iinfo(pixels.dtype).max) - black
        toned = np.empty_like(planes)
        # Each step is a pass over all pixels, so few rows at a time, which a processor's cache holds.
        for rows in (slice(top, top + STRIP_PX) for top in range(0, len(planes), STRIP_PX)):
            gain, straight = (each[rows].astype(np.float32).reshape(1, -1) for each in (factor, planes))
            straight = (straight - black) * gain
            start = np.float32(self.shoulder) * white * np.minimum(gain, np.float32(1))
            room = white - start
            above = np.maximum(straight - start, np.float32(0)) / room
            if above.any():
                # a / (1 + c a) has slope 1 where the shoulder begins, and this c takes white to white.
                above_at_white = (white * gain - start) / room
                bent = start + room * above / (1 + above * (1 - 1 / above_at_white))
                cv2.copyTo(bent, (above > 0).view(np.uint8), straight)
            toned[rows] = round_to(straight + black, pixels.dtype).reshape(toned[rows].shape)
        return toned.reshape(pixels.shape)

    def factors(self, size: tuple[int, int], part: Canvas, to_image: Array | None = None) -> Float32:
        """Factors on the intensities of a photograph of ``size`` in a part of the reference frame, (H, W, 1 or 3).

        ``to_image`` (3, 3) takes reference pixels to the photograph's; None: the identity.
        """

        def compute(points: Points) -> Array:
            if to_image is not None:
                # Far outside, and towards a horizon, the shading's powers have no bounds.
                points = np.clip(np.nan_to_num(apply(to_image, points)), -np.array(size), 2 * np.array(size))
            logs = np.broadcast_to(np.log(self.gain), (len(points), len(self.gain)))
            if self.shading is not None:
                logs = logs + shading_terms(points, size) @ self.shading
            if self.light is not None:
                nodes = np.array(self.light.shape[1::-1]) - 1
                places = (np.clip(points / (np.array(size) - 1), 0, 1) * nodes).astype(np.float32)
                light = cv2.remap(self.light, places[:, 0], places[:, 1], cv2.INTER_LINEAR)
                logs = logs + light.reshape(len(points), -1)
            return np.asarray(np.exp(logs))

        return part.interpolate(compute, FIELD_STEP_PX)


NEUTRAL = Tone()


def round_to(values: Float32, kind: np.dtype[np.uint8 | np.uint16]) -> Intensities:
    """Round to whole numbers of the photographs' type, which saturate."""
    return np.asarray(cv2.add(values, (0, 0, 0, 0), dtype=cv2.CV_8U if kind == np.uint8 else cv2.CV_16U), dtype=kind)


def shading_terms(points: Array, size: tuple[int, int]) -> Array:
    """What the camera's shading is made of, (..., 4): r^2, r^4, x and y, as of a falling lens and a lamp at one side.

    Of ``points`` (..., 2), pixels of a photograph, x, y and r count from its centre, in half diagonals.
    """
    from_centre = (points - (np.array(size) - 1) / 2) / (np.hypot(*size) / 2)
    squared = (from_centre**2).sum(axis=-1, keepdims=True)
    return np.concatenate((squared, squared**2, from_centre), axis=-1)
