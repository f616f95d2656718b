"""A growing mosaic and the frames that hold each other in it."""

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
from skymosaic.flight.adjustment import MODELS, Network, Ties, shapes
from skymosaic.flight.layout import normalisation
from skymosaic.flight.links import TIE_PX, PairEstimator, compact, verify
from skymosaic.geometry.homography import apply, estimate, scaled
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.live.growing_canvas import GrowingCanvas

MOST_NEIGHBOURS = 4
LEAST_USE = 0.1
"""Placed frames that a new one is registered against, and the least share of it that each adds to the others."""
GROWTH = 2
"""A submap is laid out anew when it has so many times the frames it had the last time."""
WORTH_MOVING_PX = 1.0
"""What is painted is moved if a frame's corner goes farther, in pixels of the reference frame."""
LEVELLING = (0.2, 0.1, 0.05)
LEVELLING_COST_PX = 0.2
"""Every frame gives up the largest of these shares of its stretch and tilt that costs no more than this much median
error. Homographies alone bend a growing mosaic more and more; similarities do not fit a camera that sways."""


@dataclass(frozen=True, eq=False)
class Frame:
    """What is kept of a frame.

    Attributes
    ----------
    number : int
    size : (int, int)
        Of the working image, px.
    features : structured ndarray
        Its feature records.
    to_original : ndarray of float64, shape (3, 3)
        Working pixels to the frame's own.
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
        """Its strongest features, to find what it resembles."""
        return compact(self.features)

    @cached_property
    def outline(self) -> Float32:
        """Corners (4, 2) in the reference frame."""
        return apply(self.transform, Canvas(0, 0, *self.size).corners).astype(np.float32)

    @property
    def from_original(self) -> Array:
        """The frame's own pixels to the reference frame, (3, 3)."""
        return np.asarray(self.transform @ np.linalg.inv(self.to_original), dtype=np.float64)

    def overlap(self, other: Frame) -> float:
        """Share of its area that the other shows too."""
        common, _ = cv2.intersectConvexConvex(self.outline, other.outline)
        return float(common) / float(cv2.contourArea(self.outline))

    def moved(self, transform: Array) -> Frame:
        """The same at another place."""
        return dataclasses.replace(self, transform=transform)


class Tied(NamedTuple):
    """What a new frame has in common with a placed one: (N, 2) in the placed one's pixels and in the new one's."""

    frame: Frame
    placed: Array
    points: Array

    @property
    def ground(self) -> Array:
        """The points in the reference frame, (N, 2)."""
        return apply(self.frame.transform, self.placed)


class _Link(NamedTuple):
    """The same, with the numbers of both frames."""

    left: int
    right: int
    left_points: Array
    right_points: Array


class Placement(NamedTuple):
    """Where a new frame lies, which frames hold it, by how many ties, and their median error in working pixels."""

    transform: Array
    neighbours: tuple[int, ...]
    ties: int
    error_px: float


class Submap:
    """Frames in one reference frame, and what they show.

    Each time their number has doubled, all frames are laid out anew, and what is painted moves along.

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
        """The points that a placed frame has in common with a new one; None where they show no common ground."""
        link = verify(self._estimator, (other.number, frame.number), other.features, frame.features)
        return Tied(other, link.left_points, link.right_points) if link.holds else None

    def place(self, frame: Frame, first: Tied) -> Placement | None:
        """Register a frame against those it overlaps, given what it has in common with one of them."""
        guess = frame.moved(estimate(first.points, first.ground, model="similarity"))
        others = (self.tied(other, frame) for other in self._neighbours(guess, first.frame))
        tied = [first, *filter(None, others)]
        # Neighbours that contradict each other hold nothing: then the first must do.
        for group in (tied, tied[:1]):
            transform, error_px = _fitted(guess, group)
            ties = int(np.count_nonzero(error_px <= TIE_PX))
            if ties >= MIN_INLIERS:
                numbers = tuple(each.frame.number for each in group)
                self._links += [_Link(each.frame.number, frame.number, each.placed, each.points) for each in group]
                return Placement(transform, numbers, ties, float(np.median(error_px)))
        return None

    def add(self, frame: Frame, pixels: Pixels) -> None:
        """Paint a frame where its transform says, and keep it.

        Raises
        ------
        CanvasError
            If the canvas would become too large; nothing has changed.
        """
        self.canvas.paint(pixels, frame.from_original, frame.number)
        self.frames.append(frame)

    def absorb(self, other: Submap, to_this: Array) -> None:
        """Take over all that another submap holds, moved by ``to_this``; raises as `add` does."""
        self.canvas.take_over(other.canvas, {frame.number: to_this for frame in other.frames}, matching=True)
        moved = [frame.moved(scaled(to_this @ frame.transform)) for frame in other.frames]
        self.frames = sorted([*self.frames, *moved], key=lambda frame: frame.number)
        self._links += other._links

    def settle(self, *, at_last: bool = False) -> None:
        """Lay all frames out anew if there are twice as many as the last time, or ``at_last``.

        What is painted is moved where that makes a difference; each time costs a little sharpness.
        """
        if len(self.frames) < (3 if at_last else GROWTH * self._laid_out):
            return
        self._laid_out = len(self.frames)
        transforms = self._layout()
        if self._largest_move_px(transforms) < WORTH_MOVING_PX:
            return
        motions = {f.number: t @ np.linalg.inv(f.transform) for f, t in zip(self.frames, transforms, strict=True)}
        canvas = GrowingCanvas(self._limit_px)
        with contextlib.suppress(CanvasError):  # Then all stays as it is.
            canvas.take_over(self.canvas, motions, matching=False)
            self.canvas = canvas
            self.frames = [frame.moved(t) for frame, t in zip(self.frames, transforms, strict=True)]

    def _layout(self) -> list[Array]:
        """Transformations of all frames, fitted to all their ties at once; the first frame keeps place and scale."""
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
        return [scaled(to_reference @ each @ unit) for each, unit in zip(found, to_unit, strict=True)]

    def _largest_move_px(self, transforms: list[Array]) -> float:
        corners = [Canvas(0, 0, *frame.size).corners for frame in self.frames]
        moved = [apply(transform, each) for transform, each in zip(transforms, corners, strict=True)]
        moves = [np.abs(there - frame.outline).max() for there, frame in zip(moved, self.frames, strict=True)]
        return float(max(moves))

    def _neighbours(self, frame: Frame, first: Frame) -> list[Frame]:
        """Further placed frames that overlap much with a new one and little with each other."""
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
    """A frame's transformation by what it has in common with placed ones, and the error of each tie in its pixels.

    A homography is fitted, gives up some of its stretch and tilt, and is fitted again by a similarity.
    """
    width, height = guess.size
    unit_px = float(np.hypot(width, height)) / 2
    to_unit = np.array([[1, 0, (1 - width) / 2], [0, 1, (1 - height) / 2], [0, 0, unit_px]])
    unit_to_reference = guess.transform @ np.linalg.inv(to_unit)
    reference_to_unit = np.linalg.inv(unit_to_reference).astype(np.float64)
    # The network's two views are the reference frame, as the guess shows it, and the frame.
    ground = apply(reference_to_unit, np.concatenate([each.ground for each in tied]))
    points = apply(to_unit, np.concatenate([each.points for each in tied]))
    network = Network([Ties(0, 1, ground, points)], [unit_px] * 2, reference=0)
    views = network.adjust(np.stack([np.eye(3)] * 2), "homography")
    errors_px = network.errors_px(views)[0]
    most_px = float(np.median(errors_px)) + LEVELLING_COST_PX
    fitted = scaled(np.linalg.inv(views[0]) @ views[1])
    shape = shapes(scaled(unit_to_reference @ fitted)[None])[0]
    for share in LEVELLING:
        level = network.adjust(np.stack([np.eye(3), fitted @ _deformation(-share * shape)]), "similarity")
        level_errors_px = network.errors_px(level)[0]
        if np.median(level_errors_px) <= most_px:
            views, errors_px = level, level_errors_px
            break
    return scaled(unit_to_reference @ np.linalg.inv(views[0]) @ views[1] @ to_unit), errors_px


def _deformation(shape: Array) -> Array:
    """The transformation (3, 3) with a small stretch and tilt (4,), see `skymosaic.flight.adjustment.shapes`."""
    along_axes, along_diagonals, tilt_x, tilt_y = shape
    return np.array([[1 + along_axes, along_diagonals, 0], [along_diagonals, 1 - along_axes, 0], [tilt_x, tilt_y, 1]])
