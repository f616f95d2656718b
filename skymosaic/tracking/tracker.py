"""Tracks an object through a video: its four corners in every frame (thesis, section IV.6.3).

The template's features remain the reference in all frames, so that errors do not accumulate. Each frame is searched at
the expected pose (constant velocity), enlarged. While the template is lost, one other part of each frame is searched,
the nearest parts first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self, Unpack

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from golden_model.config import MIN_FRAME_PX
from sim.backends.interface import Backend
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.common.options import choose_options, document_options, list_options
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import DegenerateError, apply, dlt
from skymosaic.imagery.images import load
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.registration.options import FrontEndKeywords, FrontEndOptions, Seeded, SeedKeywords
from skymosaic.tracking.template import Roi, Template, TemplatePose

MIN_ROI_PX = 16
MIN_FEATURES = 12
"""A template with fewer features cannot be distinguished from chance."""
MIN_TO_STAY = 6
"""Inliers that continue a track. If the object is hidden or elsewhere, at most 3 matches agree by chance."""
MIN_TO_BEGIN = 8
"""Inliers that start or resume a track."""
MIN_TO_GUESS = 4
"""Inliers of a guessed pose, which is then verified with `MIN_TO_BEGIN`."""
POSITION_GAIN, VELOCITY_GAIN = 0.85, 0.4
"""Gains of the alpha-beta filter: shares of the prediction error that correct position and velocity."""
COASTED_FRAMES = 10
"""For this many frames after losing the template, it is still searched where its last velocity would have taken it."""
LEARNING_FRAMES = 5
"""Frames after which features are weighted by how often they followed the object."""
TRUSTED_SHARE = 0.15
"""Only features that followed the object in at least this share of the frames are trusted: a rectangle in the first
frame also contains some ground, which matches where the object is not."""
PART_PX = (1280, 960)
"""Largest part (width, height) of a magnified frame that is searched at once."""
PART_OVERLAP_PX = 192
"""Overlap of neighbouring parts."""
SEARCH_SCALES: tuple[float, ...] = (1.0, 0.7, 1.4, 0.5, 2.0)
"""Sizes of the object relative to the template that are tried in turn until its size is known."""
MAX_CHANGE = 2.0
"""Reject poses whose area differs from the expected one by more than this factor."""


@document_options
@dataclass(frozen=True, kw_only=True)
class TrackerOptions(Seeded, FrontEndOptions):
    """How an object is followed."""


class TrackerKeywords(FrontEndKeywords, SeedKeywords, total=False):
    """The fields of `TrackerOptions` as keyword arguments."""


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
    """

    number: int
    pixels: Pixels
    corners: Array | None
    pose: TemplatePose | None

    @property
    def reason(self) -> str:
        """Why the object was not found; empty where it was."""
        return "" if self.pose else "lost: too few features of the template agree"


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
        **changes: Unpack[TrackerKeywords],
    ) -> None:
        options = choose_options(TrackerOptions, options, changes)
        options.check()
        self._template = template if isinstance(template, Roi) else load(template, "template").pixels
        self._config = options.base_config
        self._front_end: Backend | None = options.open_backend()
        self._rng = np.random.default_rng(options.seed)
        self._on_frame = on_frame
        self._track: _Track | None = None
        self._frames = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        self._track = self._front_end = None

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
        tracked = TrackedFrame(self._frames, frame, self._track.corners if pose else None, pose)
        self._frames += 1
        self._on_frame(tracked)
        return tracked

    def _begin(self, first: Pixels) -> _Track:
        if self._front_end is None:
            raise InputError("the tracker has ended; make another one")
        if isinstance(self._template, Roi):
            _check_roi(self._template, first)
            picture, roi = first, self._template
        else:
            picture, roi = self._template, Roi(0, 0, self._template.shape[1], self._template.shape[0])
        # Without cell selection, the threshold is raised until the first frame fits; with it, nothing changes.
        _, config = extract_within_capacity(self._front_end, [first], self._config)
        track = _Track(Template(picture, roi, self._front_end, config), self._rng)
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


class _Track:
    """State of a track: the expected position, the trusted features, and the search for a lost template."""

    def __init__(self, template: Template, rng: np.random.Generator) -> None:
        self.template = template
        self.corners: Array | None = None
        """The smoothed corners (4, 2) in the last frame; the expected ones if the template was lost."""
        self._rng = rng
        self._velocity = np.zeros((4, 2))
        self._is_steady = False
        self._lost_frames = 0
        self._followed_frames = 0
        self._followed = np.zeros(len(template.weight))
        features = np.count_nonzero(template.weight)
        if features < MIN_FEATURES:
            raise RegistrationError(
                f"the template has {features} features, {MIN_FEATURES} needed; choose a larger part with more detail"
            )

    def begin(self, homography: Array) -> None:
        """Start the track at a known pose: ``homography`` (3, 3) maps template pixels to frame pixels."""
        self.corners = apply(homography, self.template.corners)
        self._velocity = np.zeros((4, 2))
        self._is_steady = False

    def follow(self, frame: Pixels) -> TemplatePose | None:
        """The pose in the next frame; None if the template is not found."""
        pose = self._follow_expected(frame) or self._search(frame)
        if pose is None:
            # While the template is not seen, it is assumed to keep its shape and to move uniformly.
            self._velocity[:] = self._velocity.mean(axis=0)
        self._lost_frames = 0 if pose else self._lost_frames + 1
        return pose

    @property
    def _weight(self) -> Array:
        """Weight of the template's features, by how often each followed the object so far."""
        if self._followed_frames < LEARNING_FRAMES:
            return self.template.weight
        share = self._followed / self._followed_frames
        return np.where(share >= TRUSTED_SHARE, share * self.template.weight, 0)

    def _follow_expected(self, frame: Pixels) -> TemplatePose | None:
        """Search at the expected pose, and update the expectation by one step of the alpha-beta filter."""
        if self.corners is None or self._lost_frames > COASTED_FRAMES:
            return None
        self.corners = self.corners + self._velocity
        pose = self._verify(frame, dlt(self.template.corners, self.corners), MIN_TO_STAY)
        if pose is not None:
            error = apply(pose.homography, self.template.corners) - self.corners
            # A new track takes its first step as its velocity.
            position_gain, velocity_gain = (POSITION_GAIN, VELOCITY_GAIN) if self._is_steady else (1.0, 1.0)
            self.corners = self.corners + position_gain * error
            self._velocity = self._velocity + velocity_gain * error
            self._is_steady = True
            self._followed[pose.features] += 1
            self._followed_frames += 1
        return pose

    def _verify(self, frame: Pixels, expected: Array, min_inliers: int) -> TemplatePose | None:
        """Measure the pose near an expected one; None if its corners are not convex or its area changed too much."""
        try:
            pose = self.template.find_near(frame, expected, self._weight, min_inliers=min_inliers, rng=self._rng)
        except DegenerateError:
            return None
        if pose is None:
            return None
        corners, before = (apply(homography, self.template.corners) for homography in (pose.homography, expected))
        change = _area(corners) / _area(before)
        plausible = cv2.isContourConvex(corners.astype(np.float32)) and 1 / MAX_CHANGE < change < MAX_CHANGE
        return pose if plausible else None

    def _search(self, frame: Pixels) -> TemplatePose | None:
        """Search one part of the frame for the object at one size; successive frames try other parts and sizes."""
        # One part per frame bounds the time that a frame takes, whatever its size.
        steps = self._search_steps((frame.shape[1], frame.shape[0]))
        zoom, part = steps[self._lost_frames % len(steps)]
        guess = self.template.guess_within(frame, part, zoom, self._weight, min_inliers=MIN_TO_GUESS)
        pose = None if guess is None else self._verify(frame, guess, MIN_TO_BEGIN)
        if pose is not None:
            self.begin(pose.homography)
        return pose

    def _search_steps(self, size: tuple[int, int]) -> list[tuple[float, Canvas]]:
        """Magnifications of the frame, each with a part of the magnified frame, in the order of the search."""
        middle, scales = np.array(size) / 2, SEARCH_SCALES
        if self.corners is not None:
            middle = self.corners.mean(axis=0)
            scales = (math.sqrt(_area(self.corners) / _area(self.template.corners)),)
        # The front end takes no smaller picture.
        min_zoom = MIN_FRAME_PX / min(size)
        zooms = [max(self.template.zoom / scale, min_zoom) for scale in scales]
        return [(zoom, part) for zoom in zooms for part in _parts(size, zoom, middle)]


def _parts(size: tuple[int, int], zoom: float, middle: Array) -> list[Canvas]:
    """Overlapping parts of a magnified frame, sorted by distance from ``middle`` (in pixels of the frame)."""
    spans = []
    for side, part_px in zip(size, PART_PX, strict=True):
        whole = round(side * zoom)
        length = min(whole, part_px)
        count = 1 + math.ceil((whole - length) / (part_px - PART_OVERLAP_PX))
        spans.append([(round(start), length) for start in np.linspace(0, whole - length, count)])
    parts = [Canvas(x, y, width, height) for y, height in spans[1] for x, width in spans[0]]
    return sorted(parts, key=lambda part: float(np.linalg.norm(part.corners.mean(axis=0) - zoom * middle)))


def _area(corners: Array) -> float:
    return float(cv2.contourArea(corners.astype(np.float32)))
