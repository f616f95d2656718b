"""The state of a track: where the object is expected, which features are trusted, and the search while it is lost."""

import math
from functools import cached_property

import cv2
import numpy as np

from golden_model.arrays import Array, Pixels
from golden_model.config import MIN_FRAME_PX
from skymosaic.common.errors import RegistrationError
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import DegenerateError, apply, dlt, estimate_similarity
from skymosaic.tracking.template import MIN_ROI_PX, Template, TemplatePose, View

MIN_FEATURES = 12
"""A template with fewer features cannot be distinguished from chance."""
MIN_TO_STAY = 6
"""Inliers that continue a track. If the object is hidden or elsewhere, at most 3 matches agree by chance."""
MIN_BLOCKS = 10
"""Blocks that continue a track where the features do not."""
MIN_TO_BEGIN = 8
"""Inliers that start or resume a track."""
MIN_TO_GUESS = 4
"""Inliers of a guessed pose, which is then verified with `MIN_TO_BEGIN`."""
POSITION_GAIN, VELOCITY_GAIN = 0.85, 0.4
"""Gains of the alpha-beta filter: shares of the prediction error that correct position and velocity."""
COASTED_FRAMES = 10
"""For this many frames after losing the template, it is still searched where its last velocity would have taken it."""
TRUSTED_SHARE = 0.4
"""Only features that followed the object in at least this share of the frames that tell are trusted: a rectangle in the
first frame also contains some ground, which matches where the object is not."""
PART_PX = (1280, 960)
"""Largest part (width, height) of a magnified frame that is searched at once."""
PART_OVERLAP_PX = 192
"""Overlap of neighbouring parts."""
SEARCH_SCALES: tuple[float, ...] = (1.0, 0.7, 1.4, 0.5, 2.0)
"""Sizes of the object relative to the template that are tried in turn until its size is known."""
MAX_CHANGE = 2.0
"""Reject poses whose area differs from the expected one by more than this factor."""


class Track:
    """State of a track: the expected position, the trusted features, and the search for a lost template."""

    def __init__(self, template: Template, rng: np.random.Generator) -> None:
        self.template = template
        self.corners: Array | None = None
        """The smoothed corners (4, 2) in the last frame; the expected ones if the template was lost."""
        self._rng = rng
        self._velocity = np.zeros((4, 2))
        self._is_steady = False
        self._lost_frames = 0
        self._followed, self._left_out = np.zeros((2, len(template.weight)))
        self._moves = False
        self._recent: View | None = None
        self._sees_surroundings = True
        self._saw_twin = False
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
        if pose is not None:
            self._recent = pose.view
        else:
            # While the template is not seen, it is assumed to keep its shape and to move uniformly.
            self._velocity[:] = self._velocity.mean(axis=0)
        self._lost_frames = 0 if pose else self._lost_frames + 1
        return pose

    def explain(self, frame: Pixels) -> str:
        """Why the object is not found in a frame, and what helps."""
        if self.corners is None:
            return "not found yet; a template from this video (--roi) is found best"
        x, y = self.corners.mean(axis=0)
        if not (0 <= x < frame.shape[1] and 0 <= y < frame.shape[0]):
            return "lost: left the frame; it is found again when it comes back"
        side_px = math.sqrt(_area(self.corners))
        if side_px < MIN_ROI_PX:
            return f"lost: only {side_px:.0f} px large; film from nearer"
        if self._saw_twin:
            return "lost: another object looks like it, and is not taken for it; a larger rectangle tells them apart"
        if not self._sees_surroundings:
            return "lost: the picture changed altogether; at a cut, track the next part with a template of its own"
        features = np.count_nonzero(self._weight)
        return (
            f"lost: hidden, blurred or turned, fewer than {MIN_TO_STAY} of {features} features agree; "
            "a rectangle closer around it, or a template that shows this side, helps"
        )

    @property
    def _weight(self) -> Array:
        """Weight of the template's features, by how often each followed an object that moves otherwise."""
        share = (1 + self._followed) / (1 + self._followed + self._left_out)
        return np.where(share >= TRUSTED_SHARE, share * self.template.weight, 0)

    def _follow_expected(self, frame: Pixels) -> TemplatePose | None:
        """Search at the expected pose, and update the expectation by one step of the alpha-beta filter."""
        if self.corners is None or self._lost_frames > COASTED_FRAMES:
            return None
        # An object keeps its shape: the corners' velocities together are a similarity.
        step = estimate_similarity(self.corners, self.corners + self._velocity)
        self.corners = apply(step, self.corners)
        expected = dlt(self.template.corners, self.corners)
        pose = self._verify(frame, expected, MIN_TO_STAY)
        for reference in (self.template.first_view, self._recent):
            if pose is None and reference is not None:
                pose = self._verify(frame, expected, MIN_BLOCKS, reference)
        if pose is not None:
            self._moves |= pose.moves
            error = apply(pose.homography, self.template.corners) - self.corners
            # A new track takes its first step as its velocity.
            position_gain, velocity_gain = (POSITION_GAIN, VELOCITY_GAIN) if self._is_steady else (1.0, 1.0)
            self.corners = self.corners + position_gain * error
            self._velocity = self._velocity + velocity_gain * error
            self._is_steady = True
            self._saw_twin = False
            # Where all features move alike, they tell nothing.
            if len(pose.left_out):
                self._followed[pose.followed] += 1
                self._left_out[pose.left_out] += 1
            return pose
        return None

    def _verify(
        self, frame: Pixels, expected: Array, min_inliers: int, reference: View | None = None
    ) -> TemplatePose | None:
        """Measure the pose near an expected one; None if it is no convex outline of about that size and place."""
        try:
            pose, sees_surroundings = self.template.look_near(
                frame, expected, self._weight, reference, moves=self._moves, min_inliers=min_inliers, rng=self._rng
            )
        except DegenerateError:
            return None
        # A cut shows in the first frame without the object; later, the last view is old.
        if reference is not None and reference is self._recent and not self._lost_frames:
            self._sees_surroundings = sees_surroundings
        if pose is None:
            return None
        corners, before = (apply(homography, self.template.corners) for homography in (pose.homography, expected))
        change = _area(corners) / _area(before)
        plausible = cv2.isContourConvex(corners.astype(np.float32)) and 1 / MAX_CHANGE < change < MAX_CHANGE
        return pose if plausible and not _is_elsewhere(corners, before) else None

    def _search(self, frame: Pixels) -> TemplatePose | None:
        """Search one part of the frame for the object at one size; successive frames try other parts and sizes."""
        # One part per frame bounds the time that a frame takes, whatever its size.
        steps = self._search_steps((frame.shape[1], frame.shape[0]))
        zoom, part = steps[self._lost_frames % len(steps)]
        guess = self.template.guess_within(frame, part, zoom, self._weight, min_inliers=MIN_TO_GUESS)
        pose = None if guess is None else self._verify(frame, guess, MIN_TO_BEGIN)
        if pose is None or self._is_twin(pose):
            return None
        self.begin(pose.homography)
        return pose

    def _is_twin(self, pose: TemplatePose) -> bool:
        """Whether a pose is not where the object is expected, and may be that of another object that looks like it."""
        if self.corners is None:
            return False
        found = apply(pose.homography, self.template.corners)
        self._saw_twin = _is_elsewhere(found, self.corners) and self._has_twin
        return self._saw_twin

    @cached_property
    def _has_twin(self) -> bool:
        """Whether the picture that the template was cut from shows something else that looks like it."""
        picture, roi, zoom = self.template.picture.copy(), self.template.roi, self.template.zoom
        picture[roi.y_px : roi.y_px + roi.height_px, roi.x_px : roi.x_px + roi.width_px] = 128
        size = (picture.shape[1], picture.shape[0])
        if min(size) * zoom < MIN_FRAME_PX:
            return False
        parts = _parts(size, zoom, self.template.corners.mean(axis=0) + roi[:2])
        return any(
            self.template.guess_within(picture, part, zoom, self._weight, min_inliers=MIN_TO_BEGIN) is not None
            for part in parts
        )

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


def _is_elsewhere(found: Array, expected: Array) -> bool:
    """Whether an outline (4, 2) is farther than half its size from where it was expected."""
    away_px = np.linalg.norm(found.mean(axis=0) - expected.mean(axis=0))
    return bool(away_px > math.sqrt(_area(expected)) / 2)


def _area(corners: Array) -> float:
    return float(cv2.contourArea(corners.astype(np.float32)))
