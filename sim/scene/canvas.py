"""The window of the plane that is being painted: its reflectance and relief, and the noise for both."""

from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Float32, Mask, Points

Plane = Float32

MARGIN_PX = 96
"""Margin painted around a tile: the longest shadow and the widest edge strip reach so far."""

BLOCK_PX = 1024
"""Lengths are rounded as those from the corner of a block of the plane: whatever part of the block is painted."""


@dataclass(frozen=True)
class Canvas:
    """A window of the plane with its top left pixel at ``x_px``, ``y_px``.

    ``reflectance`` has shape (3, H, W), BGR, display values 0..1; ``relief`` (H, W) is the height of the surface in
    pixels; ``noise`` comes from `sim.scene.noise.make_noise`, shape (octaves, H, W). Painting changes the first two.
    """

    x_px: int
    y_px: int
    reflectance: Plane
    relief: Plane
    noise: Plane

    @property
    def block(self) -> tuple[int, int]:
        """The point of the plane from which the block's lengths count: its corner, with the margin."""
        x, y = ((start + MARGIN_PX) // BLOCK_PX * BLOCK_PX - MARGIN_PX for start in (self.x_px, self.y_px))
        return x, y

    @property
    def in_block(self) -> tuple[int, int]:
        """The canvas's top left pixel, from there."""
        x, y = self.block
        return self.x_px - x, self.y_px - y

    def window(self, x: float, y: float, reach_px: float) -> tuple[slice, slice] | None:
        """Rows and columns within ``reach_px`` of a point of the plane; None if they lie outside the canvas."""
        height, width = self.relief.shape
        left, top = int(x - reach_px) - self.x_px, int(y - reach_px) - self.y_px
        size = int(2 * reach_px) + 2
        if left >= width or top >= height or left + size <= 0 or top + size <= 0:
            return None
        return slice(max(top, 0), min(top + size, height)), slice(max(left, 0), min(left + size, width))

    def offsets(self, window: tuple[slice, slice], x: float, y: float) -> tuple[Plane, Plane]:
        """Horizontal and vertical distance of a window's pixels from a point, shapes (1, w) and (h, 1)."""
        rows, columns = window
        (left, top), (corner_x, corner_y) = self.in_block, self.block
        across = np.arange(left + columns.start, left + columns.stop, dtype=np.float32) + np.float32(corner_x - x)
        down = np.arange(top + rows.start, top + rows.stop, dtype=np.float32) + np.float32(corner_y - y)
        return across[np.newaxis, :], down[:, np.newaxis]

    def local(self, points: Points) -> Points:
        """Points of the plane, shape (n, 2), relative to the canvas."""
        return points - (self.x_px, self.y_px)

    def meets(self, points: Points) -> bool:
        """Whether the bounding box of points of the plane, with a margin of 64 px, overlaps the canvas."""
        (left, top), (right, bottom) = self.local(points.min(0)) - 64, self.local(points.max(0)) + 64
        height, width = self.relief.shape
        return bool(left < width and top < height and right > 0 and bottom > 0)


def bgr(red: float, green: float, blue: float) -> Plane:
    """A display colour 0..255, given as RGB, as BGR in 0..1; shape (3, 1, 1)."""
    return np.array([blue, green, red], np.float32).reshape(3, 1, 1) / np.float32(255)


def lay_over(under: Plane, over: Plane, share: Plane | Mask) -> None:
    """Blend ``over`` onto ``under`` in place, with opacity ``share`` (0..1)."""
    under += (over - under) * share
