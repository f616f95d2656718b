"""A connected part of a live mosaic: registered frames and the links between them."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Pixels, Records
from golden_model.config import Config
from skymosaic.compositing.mesh import Ties
from skymosaic.compositing.warp import Canvas, CanvasError, footprint
from skymosaic.flight.layout.adjustment import MODELS, Network
from skymosaic.flight.layout.linked_group import LinkedGroup, normalisation
from skymosaic.flight.layout.motions import shapes
from skymosaic.flight.linking.links import TIE_PX, Link, link_views
from skymosaic.flight.linking.resemblance import compact, count_votes
from skymosaic.flight.pairing.candidates import MIN_VOTES, MOST_SIMILAR
from skymosaic.geometry.ground import Sight
from skymosaic.geometry.homography import apply, estimate_similarity, rescale
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.exif import Metadata

LATEST = 3
"""A new frame is first matched with this many of the latest frames; if these fail, with the most similar older ones."""
MAX_NEIGHBOURS = 4
"""A new frame is registered against at most this many frames."""
MIN_USE = 0.1
"""Smallest share of the new frame's area that each of them must overlap in addition to the others."""
GROWTH = 2
"""The layout is recomputed when the number of frames has grown by this factor."""
LEVELLING = (0.2, 0.1, 0.05)
"""Shares of its stretch and tilt of which each frame loses the largest whose cost is at most `LEVELLING_COST_PX`.
Homographies alone bend a growing mosaic more and more; similarities do not fit a camera that sways."""
LEVELLING_COST_PX = 0.2
"""Increase of the median error that is accepted for a flatter mosaic."""


@dataclass(frozen=True, eq=False)
class Frame:
    """What is known of a frame; its pixels are kept elsewhere."""

    number: int
    size: tuple[int, int]
    """Width and height of the working image, px."""
    features: Records
    """Feature records of the working image."""
    to_original: Array
    """(3, 3): working pixels to the frame's original pixels."""
    transform: Array
    """(3, 3): working pixels to the submap's reference frame."""
    name: str
    taken: Metadata
    """What the camera recorded."""
    thumbnail: Pixels
    """(H, W) or (H, W, 3): for previews, and for `sight`."""
    from_thumbnail: Array
    """(3, 3): its pixels to working pixels."""

    @cached_property
    def compact(self) -> Records:
        """The strongest features, to find frames that resemble this one."""
        return compact(self.features)

    @property
    def sight(self) -> Sight:
        """The ground that it shows, to tell whether this agrees."""
        return Sight(self.thumbnail, None, self.from_thumbnail)

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
    """Frames in a common reference frame, that of the first without its tilt.

    Each time the number of frames has doubled, their layout is recomputed. ``link_frames`` links two frames, the
    earlier first; ``levelling`` is described at `LEVELLING`.
    """

    def __init__(self, link_frames: Callable[[Frame, Frame], Link], *, levelling: Sequence[float] = LEVELLING) -> None:
        self.frames: dict[int, Frame] = {}
        """Frames by their numbers, in order of time."""
        self.links: list[Link] = []
        """Those that placed the frames."""
        self._link_frames = link_frames
        self._levelling = levelling
        # So the first layout is computed at four frames.
        self._laid_out = 2

    def register(self, frame: Frame, similar: Frame) -> Placement | None:
        """Register a new frame against a ``similar`` one and others that it overlaps; None if too few points agree."""
        first = self._link_frames(similar, frame)
        if not first.holds:
            return None
        guess = frame.moved(estimate_similarity(first.right_points, self._ground_points(first)))
        others = (self._link_frames(other, frame) for other in self._neighbours(guess, similar))
        links = [first, *(link for link in others if link.holds)]
        # If the neighbours contradict each other, too few ties agree; then only the first neighbour is used.
        for group in (links, links[:1]):
            ground = np.concatenate([self._ground_points(link) for link in group])
            transform, error_px = _fit(
                guess, ground, np.concatenate([link.right_points for link in group]), self._levelling
            )
            ties = int(np.count_nonzero(error_px <= TIE_PX))
            if ties >= MIN_INLIERS:
                self.links += group
                return Placement(transform, tuple(link.left for link in group), ties, float(np.median(error_px)))
        return None

    def add(self, frame: Frame) -> None:
        """Add a registered frame.

        Raises
        ------
        CanvasError
            If a corner of it would lie behind the camera; nothing has changed then.
        """
        _check([frame])
        self.frames[frame.number] = frame

    def absorb(self, other: Submap, to_this: Array) -> None:
        """Add all frames and links of another submap, moved by ``to_this`` (3, 3); raises CanvasError as `add`."""
        moved = {number: frame.moved(rescale(to_this @ frame.transform)) for number, frame in other.frames.items()}
        _check(moved.values())
        self.frames = dict(sorted((self.frames | moved).items()))
        self.links += other.links

    def settle(self, *, at_last: bool = False) -> None:
        """Recompute the layout if the number of frames has doubled since the last time, or if ``at_last``."""
        if len(self.frames) >= (3 if at_last else GROWTH * self._laid_out):
            self._laid_out = len(self.frames)
            moved = self._lay_out()
            # A layout in which a frame would look behind the camera is worse than the one before.
            with contextlib.suppress(CanvasError):
                _check(moved.values())
                self.frames = moved

    def _lay_out(self) -> dict[int, Frame]:
        """Fit the transformations of all frames to all ties together; position and scale of the first stay fixed."""
        # Links of a frame that was registered but could not be added are ignored: it is not among the frames.
        group = LinkedGroup({number: frame.size for number, frame in self.frames.items()}, self.links, reference=0)
        network = group.network(slice(None), max_ties=None)
        to_unit = group.normalisations
        frames = zip(self.frames.values(), to_unit, strict=True)
        transforms = np.stack(
            [_nearest_similarity(to_unit[0] @ frame.transform @ np.linalg.inv(unit)) for frame, unit in frames]
        )
        for model in MODELS:
            transforms = network.adjust(transforms, model)
        to_ground = group.to_ground(transforms)
        return {number: frame.moved(rescale(to_ground[number])) for number, frame in self.frames.items()}

    def _ground_points(self, link: Link) -> Array:
        """The points of a link's registered frame in the reference frame, (N, 2)."""
        return apply(self.frames[link.left].transform, link.left_points)

    def _neighbours(self, frame: Frame, first: Frame) -> list[Frame]:
        """More registered frames that overlap much of a new one and little of each other."""
        use = {other: frame.overlap(other) for other in self.frames.values() if other is not first}
        chosen = [first]
        while use and len(chosen) < MAX_NEIGHBOURS:
            use = {other: value * (1 - chosen[-1].overlap(other)) for other, value in use.items()}
            best = max(use, key=lambda other: use[other])
            if use.pop(best) < MIN_USE:
                break
            chosen.append(best)
        return chosen[1:]


def link_by_features(left: Frame, right: Frame, config: Config, seed: int) -> Link:
    """Link two frames by their features, and see whether it is the ground that agrees."""
    pair, sights = (left.number, right.number), (left.sight, right.sight)
    return link_views(pair, left.features, right.features, config=config, seed=seed, sights=sights)


def likely_neighbours(frame: Frame, placed: Iterable[Frame]) -> Iterator[Frame]:
    """Placed frames to match with a new one, likeliest first: the latest, then those that resemble it."""
    newest_first = sorted(placed, key=lambda other: -other.number)
    yield from newest_first[:LATEST]
    # Votes are only counted when the latest frames have failed, because they take longer than a match.
    older = newest_first[LATEST:]
    votes = np.array(count_votes(frame.compact, [other.compact for other in older]), dtype=np.intp)
    for index in np.argsort(-votes, kind="stable")[:MOST_SIMILAR]:
        if votes[index] >= MIN_VOTES:
            yield older[index]


def _check(frames: Iterable[Frame]) -> None:
    """Raise CanvasError if a corner of a frame would lie behind the camera."""
    for frame in frames:
        footprint(frame.size, frame.transform)


def _nearest_similarity(transform: Array) -> Array:
    """The similarity closest to a transformation (3, 3) of normalised coordinates."""
    corners = np.array([[-0.8, -0.6], [0.8, -0.6], [0.8, 0.6], [-0.8, 0.6]])
    return estimate_similarity(corners, apply(transform, corners))


def _fit(guess: Frame, ground: Array, points: Array, levelling: Sequence[float]) -> tuple[Array, Array]:
    """Fit a frame's transformation to its ties: a homography that loses some of its stretch and tilt.

    ``guess`` is the frame about where it lies; its ties (N, 2) are ``ground`` in the reference frame and ``points`` in
    working px. Returns the transformation (3, 3), working px to the reference frame, and the ties' errors (N,), px.
    """
    to_unit = normalisation(guess.size)
    unit_to_reference = guess.transform @ np.linalg.inv(to_unit)
    reference_to_unit = np.linalg.inv(unit_to_reference).astype(np.float64)
    # The network has two views: the reference frame, seen as the guess sees it, and the new frame.
    ties = Ties(0, 1, apply(reference_to_unit, ground), apply(to_unit, points))
    network = Network([ties], [1 / float(to_unit[0, 0])] * 2, reference=0)
    views = network.adjust(np.stack([np.eye(3)] * 2), "homography")
    errors_px = network.errors_px(views)[0]
    max_px = float(np.median(errors_px)) + LEVELLING_COST_PX
    fitted = rescale(np.linalg.inv(views[0]) @ views[1])
    shape = shapes(rescale(unit_to_reference @ fitted)[None])[0]
    for share in levelling:
        level = network.adjust(np.stack([np.eye(3), fitted @ _deformation(-share * shape)]), "similarity")
        level_errors_px = network.errors_px(level)[0]
        if np.median(level_errors_px) <= max_px:
            views, errors_px = level, level_errors_px
            break
    return rescale(unit_to_reference @ np.linalg.inv(views[0]) @ views[1] @ to_unit), errors_px


def _deformation(shape: Array) -> Array:
    """The transformation (3, 3) with a small stretch and tilt (4,), see `skymosaic.flight.layout.motions.shapes`."""
    along_axes, along_diagonals, tilt_x, tilt_y = shape
    return np.array([[1 + along_axes, along_diagonals, 0], [along_diagonals, 1 - along_axes, 0], [tilt_x, tilt_y, 1]])
