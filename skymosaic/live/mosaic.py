"""A mosaic made during the flight: every frame is registered and painted when it arrives, and then released.

Only the features of past frames are kept. A new frame is registered against several frames that it overlaps, not only
against the last one, so that parallel legs of a flight constrain each other. From time to time the layout of all frames
is recomputed and the painted pixels are moved accordingly. A frame that matches nothing starts a separate submap, which
is merged with another one when a later frame overlaps both.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from golden_model.arrays import Array, Pixels, Records
from golden_model.config import Config
from sim.backends.interface import load_backend
from skymosaic.compositing.warp import CANVAS_LIMIT_PX, Canvas, CanvasError
from skymosaic.errors import InputError
from skymosaic.flight.candidates import MIN_VOTES, MOST_SIMILAR
from skymosaic.flight.linking.links import link_views
from skymosaic.flight.linking.resemblance import count_votes
from skymosaic.geometry.homography import apply, estimate, resize_matrix
from skymosaic.imagery.images import reduce_for_front_end
from skymosaic.live.submap import Frame, Placement, Submap
from skymosaic.registration.options import WORKING_WIDTH_PX
from skymosaic.registration.register import extract_within_capacity

LATEST = 3
"""A new frame is first matched with this many of the latest frames; if these fail, with the most similar older ones."""
MIN_FEATURES = 50
"""A frame with fewer features does not start a submap."""


@dataclass(frozen=True, eq=False)
class LiveUpdate:
    """Result of adding one frame.

    Attributes
    ----------
    number : int
        The frame's number, from 0.
    placement : Placement or None
        Its registration; None if it started a submap or was left out.
    reason : str
        Why it was left out; empty if it was painted.
    submaps : int
        Number of submaps after this frame.
    size_px : tuple of int
        Width and height of the frame as registered.
    features : structured ndarray or None
        Its features; None if the frame could not be used.
    """

    number: int
    placement: Placement | None
    reason: str
    submaps: int
    size_px: tuple[int, int] = (0, 0)
    features: Records | None = None


class LiveMosaic:
    """Registers and paints frames as they arrive.

    The mosaic is the submap with the most frames. Its reference frame is that of its first frame without the tilt,
    with pixel coordinates multiplied by ``scale``.

    Parameters
    ----------
    config : Config
        Front end and matcher.
    backend : str
        Name of the backend that computes the features.
    seed : int
        Seed of the robust estimator.
    working_width_px : int
        Wider frames are reduced by area for registration.
    scale : float
        Pixels of the mosaic per pixel of the first frame, more than 0 and at most 1.
    canvas_limit_px : int
        Largest area of the mosaic; a frame that would exceed it is left out.

    Raises
    ------
    InputError
        For a scale out of range.
    """

    def __init__(
        self,
        config: Config,
        backend: str = "golden",
        *,
        seed: int = 0,
        working_width_px: int = WORKING_WIDTH_PX,
        scale: float = 1.0,
        canvas_limit_px: int = CANVAS_LIMIT_PX,
    ) -> None:
        if not 0 < scale <= 1:
            raise InputError(f"scale is {scale}; it must be more than 0 and at most 1")
        self._config = config
        self._front_end = load_backend(backend)
        self._link_views = partial(link_views, config=config, seed=seed)
        self._working_width_px = working_width_px
        self._scale = scale
        self._canvas_limit_px = canvas_limit_px
        self._submaps: list[Submap] = []
        self._reasons: list[str] = []

    @property
    def image(self) -> Pixels:
        """The mosaic so far, (H, W, 3) uint8 BGR; 0 where nothing was painted; empty before the first frame."""
        return self._mosaic.canvas.image

    @property
    def transforms(self) -> dict[int, Array]:
        """For each frame's number, the transformation (3, 3) from its original pixels to those of `image`."""
        return {
            frame.number: self._mosaic.canvas.to_image @ frame.from_original for frame in self._mosaic.frames.values()
        }

    @property
    def left_out(self) -> dict[int, str]:
        """Numbers of the frames that are not in the mosaic, with the reasons."""
        inside = self._mosaic.frames
        default = "does not overlap the mosaic"
        return {number: reason or default for number, reason in enumerate(self._reasons) if number not in inside}

    def add(self, pixels: Pixels, features: Records | None = None) -> LiveUpdate:
        """Register and paint the next frame.

        Parameters
        ----------
        pixels : ndarray of uint8, shape (H, W) or (H, W, 3) BGR
        features : structured ndarray, optional
            Its features, if a front end has already computed them (such as a camera's, in sequence mode), from the
            frame reduced to the working width.

        Returns
        -------
        LiveUpdate
        """
        try:
            frame = self._describe(pixels, features)
        except InputError as error:
            self._reasons.append(str(error))
            return LiveUpdate(len(self._reasons) - 1, None, str(error), len(self._submaps))
        placement, reason = None, ""
        try:
            submap, placement = self._register(frame, self._submaps)
            if submap is not None and placement is not None:
                placed = frame.moved(placement.transform)
                submap.add(placed, pixels)
                self._join(submap, placed).settle()
            elif len(frame.features) >= MIN_FEATURES:
                submap = self._empty_submap()
                submap.add(frame, pixels)
                self._submaps.append(submap)
            else:
                reason = f"too few features (flat or blurred?): {len(frame.features)}, {MIN_FEATURES} needed"
        except CanvasError as error:
            reason = str(error)
        self._reasons.append(reason)
        return LiveUpdate(frame.number, placement, reason, len(self._submaps), frame.size, frame.features)

    def finish(self) -> None:
        """Recompute the layout after the last frame."""
        self._mosaic.settle(at_last=True)

    @property
    def _mosaic(self) -> Submap:
        """The submap with the most frames; an empty submap before the first frame."""
        return max(self._submaps, key=lambda submap: len(submap.frames), default=self._empty_submap())

    def _empty_submap(self) -> Submap:
        return Submap(self._link_views, self._canvas_limit_px)

    def _describe(self, pixels: Pixels, features: Records | None) -> Frame:
        """Reduce a frame to the working width, and compute its features unless they are given."""
        working, to_original = reduce_for_front_end(pixels, self._working_width_px, "frame")
        if features is None:
            results, _ = extract_within_capacity(self._front_end, [working], self._config)
            features = results[0].features
        size = working.shape[1], working.shape[0]
        return Frame(len(self._reasons), size, features, to_original, resize_matrix(self._scale) @ to_original)

    def _register(self, frame: Frame, submaps: list[Submap]) -> tuple[Submap, Placement] | tuple[None, None]:
        """Find a submap that the frame overlaps, and place the frame in it."""
        for submap, other in self._candidates(frame, submaps):
            if (placement := submap.register(frame, other)) is not None:
                return submap, placement
        return None, None

    def _candidates(self, frame: Frame, submaps: list[Submap]) -> Iterator[tuple[Submap, Frame]]:
        """Registered frames to match with a new one, likeliest first: the latest, then those that resemble it."""
        placed = [(submap, other) for submap in submaps for other in submap.frames.values()]
        placed.sort(key=lambda pair: -pair[1].number)
        yield from placed[:LATEST]
        # Votes are only counted when the latest frames have failed, because they take longer than a match.
        older = placed[LATEST:]
        votes = np.array(count_votes(frame.compact, [other.compact for _, other in older]), dtype=np.intp)
        for index in np.argsort(-votes, kind="stable")[:MOST_SIMILAR]:
            if votes[index] >= MIN_VOTES:
                yield older[index]

    def _join(self, submap: Submap, frame: Frame) -> Submap:
        """Merge a submap with another one that its newest frame also overlaps; raises CanvasError as `Submap.add`.

        The smaller submap is absorbed by the larger one, which is returned.
        """
        other, placement = self._register(frame, [other for other in self._submaps if other is not submap])
        if other is None or placement is None:
            return submap
        corners = Canvas(0, 0, *frame.size).corners
        mapped = {submap: apply(frame.transform, corners), other: apply(placement.transform, corners)}
        # The frame lies in both submaps, so its corners relate them; moving the smaller one blurs fewer pixels.
        larger, smaller = (other, submap) if len(other.frames) >= len(submap.frames) else (submap, other)
        larger.absorb(smaller, estimate(mapped[smaller], mapped[larger], model="similarity"))
        self._submaps.remove(smaller)
        return larger
