"""A connected part of a live mosaic: registered frames and their painted pixels."""

from __future__ import annotations

import contextlib
import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Pixels, Records
from skymosaic.compositing.warp import Canvas, CanvasError
from skymosaic.flight.layout.adjustment import MODELS, Network, Ties, shapes
from skymosaic.flight.layout.layout import normalisation
from skymosaic.flight.linking.links import TIE_PX, PairEstimator, verify
from skymosaic.flight.linking.resemblance import compact
from skymosaic.geometry.homography import apply, estimate, rescale
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.live.growing_canvas import GrowingCanvas

MOST_NEIGHBOURS = 4
"""A new frame is registered against at most this many frames."""
LEAST_USE = 0.1
"""Least share of the new frame's area that each of them must overlap in addition to the others."""
GROWTH = 2
"""The layout is recomputed when the number of frames has grown by this factor."""
WORTH_MOVING_PX = 1.0
"""Painted pixels are moved only if a frame's corner moves farther than this, in pixels of the reference frame."""
LEVELLING = (0.2, 0.1, 0.05)
"""Shares of its stretch and tilt of which each frame loses the largest whose cost is at most `LEVELLING_COST_PX`.
Homographies alone bend a growing mosaic more and more; similarities do not fit a camera that sways."""
LEVELLING_COST_PX = 0.2
"""Increase of the median error that is accepted for a flatter mosaic."""


@dataclass(frozen=True, eq=False)
class Frame:
    """The data kept for a frame; its pixels are not.

    Attributes
    ----------
    number : int
    size : (int, int)
        Width and height of the working image, px.
    features : structured ndarray
        Feature records of the working image.
    to_original : ndarray of float64, shape (3, 3)
        Working pixels to the frame's original pixels.
    transform : ndarray of float64, shape (3, 3)
        Working pixels to the submap's reference frame.
    """

    number: int
    size: tuple[int, int]
    features: Records
    to_original: Array
    transform: Array

    @cached_property
    def compact(self) -> Records:
        """The strongest features, to find frames that resemble this one."""
        return compact(self.features)

    @cached_property
    def outline(self) -> Float32:
        """Corners (4, 2) in the reference frame."""
        return apply(self.transform, Canvas(0, 0, *self.size).corners).astype(np.float32)

    @property
    def from_original(self) -> Array:
        """Original pixels to the reference frame, (3, 3)."""
        return np.asarray(self.transform @ np.linalg.inv(self.to_original), dtype=np.float64)

    def overlap(self, other: Frame) -> float:
        """Share of this frame's area that the other one also shows."""
        common, _ = cv2.intersectConvexConvex(self.outline, other.outline)
        return float(common) / float(cv2.contourArea(self.outline))

    def moved(self, transform: Array) -> Frame:
        """The same frame with another transformation to the reference frame."""
        return dataclasses.replace(self, transform=transform)


class Tied(NamedTuple):
    """Common points of a registered frame and a new one: ``placed`` (N, 2) and ``points`` (N, 2) in working pixels.

    ``placed`` are pixels of the registered ``frame``, ``points`` of the new one.
    """

    frame: Frame
    placed: Array
    points: Array

    @property
    def ground(self) -> Array:
        """The points in the reference frame, (N, 2)."""
        return apply(self.frame.transform, self.placed)


class _Link(NamedTuple):
    """Common points (N, 2) of two frames in working pixels, and the frames' numbers."""

    left: int
    right: int
    left_points: Array
    right_points: Array


class Placement(NamedTuple):
    """Registration of a new frame.

    ``transform`` (3, 3) maps working pixels to the reference frame. ``neighbours`` are the numbers of the frames it was
    registered against, ``ties`` counts the common points that agree, ``error_px`` is the median error of all common
    points in working pixels.
    """

    transform: Array
    neighbours: tuple[int, ...]
    ties: int
    error_px: float


class Submap:
    """Frames in a common reference frame, and the canvas they are painted on.

    Each time the number of frames has doubled, their layout is recomputed and the painted pixels are moved.

    Attributes
    ----------
    frames : list of Frame
        In order of time.
    canvas : GrowingCanvas
    """

    def __init__(self, estimator: PairEstimator, limit_px: int) -> None:
        self.frames: list[Frame] = []
        self.canvas = GrowingCanvas(limit_px)
        self._estimator = estimator
        self._limit_px = limit_px
        self._links: list[_Link] = []
        self._laid_out = 2

    def tied(self, other: Frame, frame: Frame) -> Tied | None:
        """Common points of a registered frame ``other`` and a new one; None if they do not match."""
        link = verify(self._estimator, (other.number, frame.number), other.features, frame.features)
        return Tied(other, link.left_points, link.right_points) if link.holds else None

    def register(self, frame: Frame, first: Tied) -> Placement | None:
        """Register a frame against those that it overlaps, given its common points with one of them.

        None if too few of the common points agree.
        """
        guess = frame.moved(estimate(first.points, first.ground, model="similarity"))
        others = (self.tied(other, frame) for other in self._neighbours(guess, first.frame))
        tied = [first, *filter(None, others)]
        # If the neighbours contradict each other, too few ties agree; then only the first neighbour is used.
        for group in (tied, tied[:1]):
            transform, error_px = _fitted(guess, group)
            ties = int(np.count_nonzero(error_px <= TIE_PX))
            if ties >= MIN_INLIERS:
                numbers = tuple(each.frame.number for each in group)
                self._links += [_Link(each.frame.number, frame.number, each.placed, each.points) for each in group]
                return Placement(transform, numbers, ties, float(np.median(error_px)))
        return None

    def add(self, frame: Frame, pixels: Pixels) -> None:
        """Paint a frame by its transform and add it to the submap.

        Raises
        ------
        CanvasError
            If the canvas would become too large; nothing has changed then.
        """
        self.canvas.paint(pixels, frame.from_original, frame.number)
        self.frames.append(frame)

    def absorb(self, other: Submap, to_this: Array) -> None:
        """Add all frames and pixels of another submap, moved by ``to_this`` (3, 3); raises CanvasError as `add`."""
        self.canvas.take_over(other.canvas, {frame.number: to_this for frame in other.frames}, matching=True)
        moved = [frame.moved(rescale(to_this @ frame.transform)) for frame in other.frames]
        self.frames = sorted([*self.frames, *moved], key=lambda frame: frame.number)
        self._links += other._links

    def settle(self, *, at_last: bool = False) -> None:
        """Recompute the layout if the number of frames has doubled since the last time, or if ``at_last``.

        Painted pixels are only moved if the layout changes noticeably, because every move costs some sharpness.
        """
        if len(self.frames) < (3 if at_last else GROWTH * self._laid_out):
            return
        self._laid_out = len(self.frames)
        transforms = self._layout()
        if self._largest_move_px(transforms) < WORTH_MOVING_PX:
            return
        motions = {f.number: t @ np.linalg.inv(f.transform) for f, t in zip(self.frames, transforms, strict=True)}
        canvas = GrowingCanvas(self._limit_px)
        with contextlib.suppress(CanvasError):  # If the new layout does not fit, the old one is kept.
            canvas.take_over(self.canvas, motions, matching=False)
            self.canvas = canvas
            self.frames = [frame.moved(t) for frame, t in zip(self.frames, transforms, strict=True)]

    def _layout(self) -> list[Array]:
        """Transformations of all frames, fitted to all ties together; position and scale of the first stay fixed."""
        row = {frame.number: index for index, frame in enumerate(self.frames)}
        to_unit = [normalisation(frame.size) for frame in self.frames]
        ties = [
            Ties(left, right, apply(to_unit[left], link.left_points), apply(to_unit[right], link.right_points))
            for link in self._links
            for left, right in [(row[link.left], row[link.right])]
        ]
        network = Network(ties, [1 / float(unit[0, 0]) for unit in to_unit], reference=0)
        frames = zip(self.frames, to_unit, strict=True)
        found = np.stack([_similar(to_unit[0] @ frame.transform @ np.linalg.inv(unit)) for frame, unit in frames])
        for model in MODELS:
            found = network.adjust(found, model)
        to_reference = np.linalg.inv(to_unit[0])
        return [rescale(to_reference @ each @ unit) for each, unit in zip(found, to_unit, strict=True)]

    def _largest_move_px(self, transforms: list[Array]) -> float:
        corners = [Canvas(0, 0, *frame.size).corners for frame in self.frames]
        moved = [apply(transform, each) for transform, each in zip(transforms, corners, strict=True)]
        moves = [np.abs(there - frame.outline).max() for there, frame in zip(moved, self.frames, strict=True)]
        return float(max(moves))

    def _neighbours(self, frame: Frame, first: Frame) -> list[Frame]:
        """More registered frames that overlap much of a new one and little of each other."""
        use = {other: frame.overlap(other) for other in self.frames if other is not first}
        chosen = [first]
        while use and len(chosen) < MOST_NEIGHBOURS:
            use = {other: value * (1 - chosen[-1].overlap(other)) for other, value in use.items()}
            best = max(use, key=lambda other: use[other])
            if use.pop(best) < LEAST_USE:
                break
            chosen.append(best)
        return chosen[1:]


def _similar(transform: Array) -> Array:
    """The similarity closest to a transformation (3, 3) of normalised coordinates."""
    corners = np.array([[-0.8, -0.6], [0.8, -0.6], [0.8, 0.6], [-0.8, 0.6]])
    return estimate(corners, apply(transform, corners), model="similarity")


def _fitted(guess: Frame, tied: list[Tied]) -> tuple[Array, Array]:
    """Fit a frame's transformation to its ties; returns it and the error of each tie in the frame's pixels.

    A homography is fitted, loses some of its stretch and tilt, and is then adjusted by a similarity.
    """
    width, height = guess.size
    unit_px = float(np.hypot(width, height)) / 2
    to_unit = np.array([[1, 0, (1 - width) / 2], [0, 1, (1 - height) / 2], [0, 0, unit_px]])
    unit_to_reference = guess.transform @ np.linalg.inv(to_unit)
    reference_to_unit = np.linalg.inv(unit_to_reference).astype(np.float64)
    # The network has two views: the reference frame, seen as the guess sees it, and the new frame.
    ground = apply(reference_to_unit, np.concatenate([each.ground for each in tied]))
    points = apply(to_unit, np.concatenate([each.points for each in tied]))
    network = Network([Ties(0, 1, ground, points)], [unit_px] * 2, reference=0)
    views = network.adjust(np.stack([np.eye(3)] * 2), "homography")
    errors_px = network.errors_px(views)[0]
    most_px = float(np.median(errors_px)) + LEVELLING_COST_PX
    fitted = rescale(np.linalg.inv(views[0]) @ views[1])
    shape = shapes(rescale(unit_to_reference @ fitted)[None])[0]
    for share in LEVELLING:
        level = network.adjust(np.stack([np.eye(3), fitted @ _deformation(-share * shape)]), "similarity")
        level_errors_px = network.errors_px(level)[0]
        if np.median(level_errors_px) <= most_px:
            views, errors_px = level, level_errors_px
            break
    return rescale(unit_to_reference @ np.linalg.inv(views[0]) @ views[1] @ to_unit), errors_px


def _deformation(shape: Array) -> Array:
    """The transformation (3, 3) with a small stretch and tilt (4,), see `skymosaic.flight.layout.adjustment.shapes`."""
    along_axes, along_diagonals, tilt_x, tilt_y = shape
    return np.array([[1 + along_axes, along_diagonals, 0], [along_diagonals, 1 - along_axes, 0], [tilt_x, tilt_y, 1]])
