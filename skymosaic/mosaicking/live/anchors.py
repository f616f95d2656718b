"""Where a camera's frames lie on a canvas, while they are painted: from their features alone, as a ring brings them.

What has been painted stays where it is, so the canvas must keep its place while the layout of the frames improves.
"""

import contextlib
from dataclasses import replace
from functools import partial

import numpy as np

from golden_model.arrays import Array, Matrix, Records
from golden_model.config import Config
from skymosaic.compositing.warp import Canvas, CanvasError
from skymosaic.flight.linking.resemblance import compact
from skymosaic.flight.linking.view import Settings, make_view
from skymosaic.geometry.homography import apply, estimate_similarity, rescale
from skymosaic.imagery.images import Photograph
from skymosaic.imagery.photographs import Source
from skymosaic.mosaicking.live.growing_flight import GrowingFlight, link_by_features

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
        black = Photograph("", np.zeros(size_px[::-1], np.uint8))
        source, none = Source(0, "", black.pixels), np.zeros(0, config.front_end.pattern.record.dtype)
        self._view = make_view(
            source, black, Settings(config), working=black.pixels, to_original=np.eye(3), features=none
        )
        # A frame is an anchor as it is placed. Levelled ones are off by pixels until the next layout.
        self._flight = GrowingFlight(partial(link_by_features, config=config, seed=0), levelling=())
        self._to_canvas: Array | None = None

    def add(self, number: int, features: Records) -> Matrix | None:
        """Place the next frame.

        Returns
        -------
        ndarray of float64, shape (3, 3), or None
            Its pixels to the canvas. None before the first layout, for a frame that overlaps no other, and for one that
            only agrees where it shows the same as others, because a display or dirt on the lens would, too.
        """
        # What a ring gives is overwritten later.
        features = features.copy()
        view = replace(self._view, features=features, strongest=compact(features))
        # A frame that would look behind the camera is in no mosaic.
        with contextlib.suppress(CanvasError):
            if self._flight.parts:
                self._flight.add(number, view)
            else:
                self._flight.begin(number, view)
        place = self._flight.largest.get(number)
        return None if self._to_canvas is None or place is None else rescale(self._to_canvas @ place)

    def lay_out(self) -> None:
        """Fit all frames to all their links, which takes seconds where there are hundreds of them.

        The first time makes the canvas, in the pixels of the first frame without its tilt. Later the canvas is put back
        where most of the frames were.
        """
        if len(self._flight.views) < MIN_FRAMES:
            return
        before = self._corners()
        self._flight.lay_out(*self._flight.parts)
        if self._to_canvas is None:
            self._to_canvas = np.eye(3)
            return
        self._to_canvas = self._to_canvas @ estimate_similarity(self._corners(), before)

    def _corners(self) -> Array:
        """Corners of all frames in their reference frame, (N, 2)."""
        corners = Canvas(0, 0, *self._size_px).corners
        return np.concatenate([apply(transform, corners) for transform in self._flight.largest.values()])
