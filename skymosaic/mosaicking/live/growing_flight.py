"""A flight that grows: its views, the links between them, and where each part of it puts its own views."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from golden_model.arrays import Array, Matrix
from golden_model.config import Config
from skymosaic.compositing.mesh import Ties
from skymosaic.compositing.warp import Canvas, CanvasError, footprint
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.adjustment import MODELS, Network
from skymosaic.flight.layout.agreement import measure_agreement
from skymosaic.flight.layout.extent import outline, overlap
from skymosaic.flight.layout.linked_group import groups, linked_group, normalisation
from skymosaic.flight.layout.motions import shapes
from skymosaic.flight.linking.links import TIE_PX, Candidate, Link, link_views, valid_links
from skymosaic.flight.linking.resemblance import count_votes
from skymosaic.flight.linking.view import Settings, View
from skymosaic.flight.mapping.anchoring import fit_layout
from skymosaic.flight.pairing.candidates import MIN_VOTES, MOST_SIMILAR
from skymosaic.flight.survey import lay_out_all, why_alone
from skymosaic.geometry.homography import apply, estimate_similarity, rescale
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.key_frames import KEY_OVERLAP
from skymosaic.imagery.photographs import Source

LATEST = 3
"""A new view is first matched with this many of the latest ones; if these fail, with the most similar older ones."""
MAX_NEIGHBOURS = 4
"""A new view is registered against at most this many."""
MIN_USE = 0.1
"""Smallest share of the new view's area that each of them must overlap in addition to the others."""
GROWTH = 2
"""The layout is recomputed when the number of views has grown by this factor."""
LEVELLING = (0.2, 0.1, 0.05)
"""Shares of its stretch and tilt of which each view loses the largest whose cost is at most `LEVELLING_COST_PX`.
Homographies alone bend a growing mosaic more and more; similarities do not fit a camera that sways."""
LEVELLING_COST_PX = 0.2
"""Increase of the median error that is accepted for a flatter mosaic."""

Part = dict[int, Matrix]
"""Where the views of a connected part lie, by their numbers, rising: working px to the frame of its first one without
its tilt, (3, 3)."""


class Placement(NamedTuple):
    """Registration of a new view.

    ``transform`` (3, 3) maps working pixels to the ground of a part. ``neighbours`` are the numbers of the views it was
    registered against, ``ties`` counts the common points that agree, ``error_px`` is the median error of all common
    points in working pixels.
    """

    transform: Matrix
    neighbours: tuple[int, ...]
    ties: int
    error_px: float


class GrowingFlight:
    """Views that come one by one, in parts that links connect.

    ``link`` links two views, the earlier first; ``levelling`` is described at `LEVELLING`.
    """

    def __init__(
        self, link: Callable[[Candidate, View, View], Link], *, levelling: Sequence[float] = LEVELLING
    ) -> None:
        self.views: dict[int, View] = {}
        """By their numbers."""
        self.links: dict[Candidate, Link] = {}
        """Those that placed the views, and those that were tried and do not hold."""
        self.parts: dict[int, Part] = {}
        """By their names: each is the number of the view that began it. Of parts that are joined, the larger stays."""
        self._link = link
        self._levelling = levelling
        self._laid_out: dict[int, int] = {}
        """Number of views in the last layout of each part."""

    @property
    def largest(self) -> Part:
        """The part with the most views; an empty one before the first view."""
        return max(self.parts.values(), key=len, default={})

    def part_of(self, number: int) -> int:
        """The name of the part that a view is in."""
        return next(name for name, part in self.parts.items() if number in part)

    def begin(self, number: int, view: View) -> None:
        """Begin a part with a view."""
        self.views[number], self.parts[number] = view, {number: np.eye(3)}

    def add(self, number: int, view: View) -> Placement | None:
        """Add a view to a part that it overlaps, and join that with another one that it also overlaps.

        Returns
        -------
        Placement or None
            None if the view overlaps no other; it is not added then.

        Raises
        ------
        CanvasError
            If a corner of the view would lie behind the camera; it is not added then, either.
        """
        found = self._register(number, view, self.parts)
        if found is None:
            return None
        name, placement = found
        footprint(view.working_size, placement.transform)
        self.views[number] = view
        self.parts[name][number] = placement.transform
        # Parts stay apart that would look behind the camera together.
        with contextlib.suppress(CanvasError):
            self._join(number, name)
        return placement

    def settle(self) -> None:
        """Recompute the layout of each part that has doubled since the last time; the first is that of four views."""
        for name, part in tuple(self.parts.items()):
            if len(part) >= GROWTH * self._laid_out.get(name, 2):
                self.lay_out(name)

    def lay_out(self, name: int) -> None:
        """Fit all views of a part to all their links together; position and scale of the first stay fixed."""
        part = self.parts[name]
        if len(part) < 3:
            return
        self._laid_out[name] = len(part)
        group = linked_group(self.views, list(part), valid_links(self.links), reference=next(iter(part)))
        network = group.network(slice(None), max_ties=None)
        to_unit = group.normalisations
        views = zip(part.values(), to_unit, strict=True)
        transforms = np.stack(
            [_nearest_similarity(to_unit[0] @ transform @ np.linalg.inv(unit)) for transform, unit in views]
        )
        for model in MODELS:
            transforms = network.adjust(transforms, model)
        # A layout in which a view would look behind the camera is worse than the one before.
        with contextlib.suppress(CanvasError):
            self.parts[name] = self._checked(group.to_ground(transforms))

    def thinned(self) -> GrowingFlight:
        """The flight of its key views, which are linked anew: chosen as of a video, by where they lie; often of all."""
        keys = set[int]()
        for part in self.parts.values():
            shown = {number: outline(self.views[number], place) for number, place in part.items()}
            key = before = next(iter(part))
            for number in part:
                if overlap(shown[key], shown[number]) < KEY_OVERLAP:
                    keys.add(key)
                    key = number if before == key else before
                before = number
            keys |= {key, before}
        flight = self if len(keys) == len(self.views) else GrowingFlight(self._link)
        for number in sorted(keys - flight.views.keys()):
            if flight.add(number, self.views[number]) is None:
                flight.begin(number, self.views[number])
        return flight

    def finished(
        self, sources: Mapping[int, Source], names: tuple[str, ...], left_out: Mapping[int, str], settings: Settings
    ) -> Flight:
        """The flight laid out as photographs are, all of its parts; the rest by the numbers of the views.

        ``names`` and ``left_out`` also have those that could not be used.
        """
        row = {number: index for index, number in enumerate(self.views)}
        views, inside = tuple(self.views.values()), [pair for pair in self.links if row.keys() >= set(pair)]
        links = {
            (row[left], row[right]): replace(self.links[left, right], left=row[left], right=row[right])
            for left, right in inside
        }
        look, parts = partial(measure_agreement, views), groups(len(views), valid_links(links))
        layouts, alone = lay_out_all(views, parts, links, lambda _layout: {}, look)
        numbers = tuple(self.views)
        reasons = {
            numbers[view]: f"{views[view].name}: {reason or why_alone(view, views, links.values())}"
            for view, reason in alone.items()
        }
        flight = Flight(
            names=names,
            sources=tuple(sources[number] for number in numbers),
            views=views,
            links=tuple(links.values()),
            layouts=tuple(layouts),
            left_out={**left_out, **reasons},
            settings=settings,
            seconds={},
        )
        return replace(flight, layouts=tuple(fit_layout(flight, layout) for layout in layouts))

    def _register(self, number: int, view: View, parts: Iterable[int]) -> tuple[int, Placement] | None:
        """Find one of some parts that a new view overlaps, and its place in that."""
        home = {each: name for name in parts for each in self.parts[name]}
        for similar in likely_neighbours(view, {each: self.views[each] for each in home}):
            if placement := self._place(number, view, similar, self.parts[home[similar]]):
                return home[similar], placement
        return None

    def _place(self, number: int, view: View, similar: int, part: Part) -> Placement | None:
        """Register a new view against a ``similar`` one and others that it overlaps; None if too few points agree."""
        first = self._try(similar, number, view)
        if not first.holds:
            return None
        guess = estimate_similarity(first.right_points, apply(part[similar], first.left_points))
        others = (self._try(other, number, view) for other in self._neighbours(view, guess, similar, part))
        links = [first, *(link for link in others if link.holds)]
        # If the neighbours contradict each other, too few ties agree; then only the first neighbour is used.
        for group in (links, links[:1]):
            ground = np.concatenate([apply(part[link.left], link.left_points) for link in group])
            points = np.concatenate([link.right_points for link in group])
            transform, error_px = _fit(view.working_size, guess, ground, points, self._levelling)
            ties = int(np.count_nonzero(error_px <= TIE_PX))
            if ties >= MIN_INLIERS:
                self.links |= {(link.left, number): link for link in group}
                return Placement(transform, tuple(link.left for link in group), ties, float(np.median(error_px)))
        return None

    def _try(self, other: int, number: int, view: View) -> Link:
        """Link a view with a new one; who uses a link that holds also keeps it."""
        link = self._link((other, number), self.views[other], view)
        if not link.holds:
            self.links[other, number] = link
        return link

    def _neighbours(self, view: View, guess: Matrix, first: int, part: Part) -> list[int]:
        """More views of a part that overlap much of a new one and little of each other."""
        shown = {each: outline(self.views[each], transform) for each, transform in part.items()}
        own = outline(view, guess)
        use = {each: overlap(own, ground) for each, ground in shown.items() if each != first}
        chosen = [first]
        while use and len(chosen) < MAX_NEIGHBOURS:
            use = {each: value * (1 - overlap(shown[chosen[-1]], shown[each])) for each, value in use.items()}
            best = max(use, key=use.__getitem__)
            if use.pop(best) < MIN_USE:
                break
            chosen.append(best)
        return chosen[1:]

    def _join(self, number: int, name: int) -> None:
        """Join a part with another one that its newest view also overlaps; the larger stays; raises as `add`."""
        view = self.views[number]
        found = self._register(number, view, [other for other in self.parts if other != name])
        if found is None:
            return
        other, placement = found
        # The view lies in both parts, so its corners relate them.
        corners = Canvas(0, 0, *view.working_size).corners
        mapped = {name: apply(self.parts[name][number], corners), other: apply(placement.transform, corners)}
        larger, smaller = (other, name) if len(self.parts[other]) >= len(self.parts[name]) else (name, other)
        to_larger = estimate_similarity(mapped[smaller], mapped[larger])
        moved = {each: to_larger @ transform for each, transform in self.parts[smaller].items()}
        self.parts[larger] = dict(sorted((self.parts[larger] | self._checked(moved)).items()))
        del self.parts[smaller]

    def _checked(self, part: Part) -> Part:
        """The same places, rescaled; raises CanvasError if a corner of a view would lie behind the camera."""
        for number, transform in part.items():
            footprint(self.views[number].working_size, transform)
        return {number: rescale(transform) for number, transform in part.items()}


def link_by_features(pair: Candidate, left: View, right: View, *, config: Config, seed: int) -> Link:
    """Link two views by their features, and see whether it is the ground that agrees."""
    sights = left.sight, right.sight
    return link_views(pair, left.features, right.features, config=config, seed=seed, sights=sights)


def likely_neighbours(view: View, placed: Mapping[int, View]) -> Iterator[int]:
    """Numbers of placed views to match with a new one, likeliest first: the latest, then those that resemble it."""
    newest_first = sorted(placed, reverse=True)
    yield from newest_first[:LATEST]
    # Votes are only counted when the latest views have failed, because they take longer than a match.
    older = newest_first[LATEST:]
    votes = np.array(count_votes(view.strongest, [placed[number].strongest for number in older]), dtype=np.intp)
    for index in np.argsort(-votes, kind="stable")[:MOST_SIMILAR]:
        if votes[index] >= MIN_VOTES:
            yield older[index]


def _nearest_similarity(transform: Array) -> Array:
    """The similarity closest to a transformation (3, 3) of normalised coordinates."""
    corners = np.array([[-0.8, -0.6], [0.8, -0.6], [0.8, 0.6], [-0.8, 0.6]])
    return estimate_similarity(corners, apply(transform, corners))


def _fit(
    size: tuple[int, int], guess: Matrix, ground: Array, points: Array, levelling: Sequence[float]
) -> tuple[Matrix, Array]:
    """Fit a view's transformation to its ties: a homography that loses some of its stretch and tilt.

    ``guess`` (3, 3) says about where a view of this size lies; its ties (N, 2) are ``ground`` in the frame of the part
    and ``points`` in working px. Returns the transformation (3, 3), and the ties' errors (N,), px.
    """
    to_unit = normalisation(size)
    unit_to_reference = guess @ np.linalg.inv(to_unit)
    reference_to_unit = np.linalg.inv(unit_to_reference).astype(np.float64)
    # The network has two views: the reference frame, seen as the guess sees it, and the new view.
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
