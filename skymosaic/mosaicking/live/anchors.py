"""Where a camera's frames lie on a canvas, while they are painted: from their features alone, as a ring brings them.

What has been painted stays where it is, so the canvas must keep its place while the layout of the frames improves.
"""

import contextlib
from functools import partial

import numpy as np

from golden_model.arrays import Array, Matrix, Records
from golden_model.config import Config
from skymosaic.compositing.warp import Canvas, CanvasError
from skymosaic.geometry.homography import apply, estimate_similarity, rescale
from skymosaic.imagery.exif import Metadata
from skymosaic.mosaicking.live.submap import Frame, Submap, likely_neighbours, link_by_features

MIN_FRAMES = 4
"""The layout of fewer does not tell how the first one is tilted, so the canvas would be as oblique as that."""


class Anchors:
    """Places frames one by one, and lays them all out anew when there is time.

    Parameters
    ----------
    size_px : tuple of int
        Width and height of the frames.
    config : Config
        By which the features were computed.
    """

    def __init__(self, size_px: tuple[int, int], config: Config) -> None:
        self._size_px = size_px
        # Without pixels, nothing tells whether it is the ground that agrees.
        self._black = np.zeros(size_px[::-1], np.uint8)
        # A frame is an anchor as it is placed. Levelled ones are off by pixels until the next layout.
        self._submap = Submap(partial(link_by_features, config=config, seed=0), levelling=())
        self._to_canvas: Array | None = None

    def add(self, number: int, features: Records) -> Matrix | None:
        """Place the next frame.

        Returns
        -------
        ndarray of float64, shape (3, 3), or None
            Its pixels to the canvas. None before the first layout, for a frame that overlaps no other, and for one that
            only agrees where it shows the same as others, because a display or dirt on the lens would, too.
        """
        own, name = np.eye(3), f"frame {number}"
        # What a ring gives is overwritten later.
        features = features.copy()
        frame = Frame(number, self._size_px, features, own, own, name, Metadata(), self._black, own)
        near = likely_neighbours(frame, self._submap.frames.values())
        found = (self._submap.register(frame, other) for other in near)
        placed = next((frame.moved(each.transform) for each in found if each), None) if self._submap.frames else frame
        if placed is None:
            return None
        # A frame that would look behind the camera is in no mosaic.
        with contextlib.suppress(CanvasError):
            self._submap.add(placed)
            return None if self._to_canvas is None else rescale(self._to_canvas @ placed.transform)
        return None

    def lay_out(self) -> None:
        """Fit all frames to all their links, which takes seconds where there are hundreds of them.

        The first time makes the canvas, in the pixels of the first frame without its tilt. Later the canvas is put back
        where most of the frames were.
        """
        if len(self._submap.frames) < MIN_FRAMES:
            return
        before = self._corners()
        self._submap.settle(at_last=True)
        if self._to_canvas is None:
            self._to_canvas = np.eye(3)
            return
        self._to_canvas = self._to_canvas @ estimate_similarity(self._corners(), before)

    def _corners(self) -> Array:
        """Corners of all frames in the submap's reference frame, (N, 2)."""
        corners = Canvas(0, 0, *self._size_px).corners
        return np.concatenate([apply(frame.transform, corners) for frame in self._submap.frames.values()])
