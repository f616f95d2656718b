"""Tracks an object through a video: its four corners in every frame (thesis, section IV.6.3).

The template's features remain the reference in all frames, so that errors do not accumulate. Each frame is searched at
the expected pose (constant velocity), enlarged; where too few features are found, for blocks of the template, and then
of the last view of the object. While the object is lost, one other part of each frame is searched, the nearest parts
first.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, Self, Unpack

import numpy as np

from golden_model.arrays import Array, Pixels
from sim.backends.interface import Backend
from skymosaic.common.brief import brief
from skymosaic.common.errors import InputError
from skymosaic.common.options import choose_options, document_options, list_options
from skymosaic.imagery.images import load
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.registration.options import BackendOptions, ConfigOptions, Seeded
from skymosaic.tracking.template import MIN_ROI_PX, Roi, Template, TemplatePose
from skymosaic.tracking.track import Track

if TYPE_CHECKING:
    from skymosaic.keywords import TrackerKeywords


@document_options
@dataclass(frozen=True, kw_only=True)
class TrackerOptions(Seeded, ConfigOptions, BackendOptions):
    """How an object is followed."""


@brief
@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """Result of tracking in one frame.

    Attributes
    ----------
    number : int
        The frame's number, from 0.
    pixels : ndarray of uint8, shape (H, W, 3)
        The frame.
    corners : ndarray of float64, shape (4, 2), or None
        The template's corners in frame pixels, smoothed, clockwise from its top left; None if it is lost.
    pose : TemplatePose or None
        The homography measured in this frame, with model and inliers; None if the template was not found.
    reason : str
        Why the object was not found, and what helps; empty where it was found.
    """

    number: int
    pixels: Pixels
    corners: Array | None
    pose: TemplatePose | None
    reason: str = ""


class Tracker:
    """Follows an object from frame to frame; as a context manager it releases the front end at the end.

    Parameters
    ----------
    template : path, array or Roi
        A picture of the object, or its rectangle in the first frame.
    options : TrackerOptions, optional
    on_frame : callable, optional
        Receives the `TrackedFrame` of each frame. What it raises leaves `follow`; the next frame continues the track.
    **changes
        Single options by the names of `TrackerOptions`; they take precedence over ``options``.

    Raises
    ------
    InputError
        For a template that cannot be read, or options that are unusable.

    Examples
    --------
    >>> from sim.scene import make_pair
    >>> first, second = make_pair(seed=5, size=(320, 240)).images
    >>> with Tracker(Roi(100, 80, 120, 90)) as tracker:
    ...     [tracker.follow(frame).number for frame in (first, first)]
    [0, 1]
    """

    @list_options
    def __init__(
        self,
        template: str | Path | Pixels | Roi,
        options: TrackerOptions | None = None,
        *,
        on_frame: Callable[[TrackedFrame], object] = lambda _frame: None,
        **changes: "Unpack[TrackerKeywords]",
    ) -> None:
        options = choose_options(TrackerOptions, options, changes)
        options.check()
        self._template = (
            template if isinstance(template, Roi) else load(template, "template", min_side_px=MIN_ROI_PX).pixels
        )
        self._config = options.base_config
        self._front_end: Backend | None = options.open_backend()
        self._rng = np.random.default_rng(options.seed)
        self._on_frame = on_frame
        self._track: Track | None = None
        self._frames = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._track = self._front_end = None

    def __reduce__(self) -> NoReturn:
        """Refuse to be pickled."""
        raise TypeError("a Tracker holds a front end, so it is not pickled; its tracked frames are")

    def follow(self, frame: Pixels) -> TrackedFrame:
        """Find the object in the next frame.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W) or (H, W, 3) BGR
            All frames have one size; none is kept.

        Raises
        ------
        InputError
            For a frame that is no picture; in the first frame, for a rectangle that is too small or not inside it.
        RegistrationError
            For a template with too few features.
        """
        frame = load(frame, f"frame {self._frames}").pixels
        if self._track is None:
            self._track = self._begin(frame)
        pose = self._track.follow(frame)
        corners, reason = (self._track.corners, "") if pose else (None, self._track.explain(frame))
        tracked = TrackedFrame(self._frames, frame, corners, pose, reason)
        self._frames += 1
        self._on_frame(tracked)
        return tracked

    def _begin(self, first: Pixels) -> Track:
        if self._front_end is None:
            raise InputError("the tracker has ended; make another one")
        if isinstance(self._template, Roi):
            _check_roi(self._template, first)
            picture, roi = first, self._template
        else:
            picture, roi = self._template, Roi(0, 0, self._template.shape[1], self._template.shape[0])
        # Without cell selection, the threshold is raised until the first frame fits; with it, nothing changes.
        _, config = extract_within_capacity(self._front_end, [first], self._config)
        track = Track(Template(picture, roi, self._front_end, config), self._rng)
        if isinstance(self._template, Roi):
            track.begin(track.template.in_picture)
        return track


def _check_roi(roi: Roi, frame: Pixels) -> None:
    height, width = frame.shape[:2]
    text = ",".join(map(str, roi))
    if min(roi.width_px, roi.height_px) < MIN_ROI_PX:
        raise InputError(f"roi {text}: too small; give at least {MIN_ROI_PX}x{MIN_ROI_PX} pixels")
    if min(roi) < 0 or roi.x_px + roi.width_px > width or roi.y_px + roi.height_px > height:
        raise InputError(f"roi {text}: not inside the first frame, {width}x{height} pixels; give x,y,width,height")
