"""Lays out a flight: from many photographs to the pose of each on the ground."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from golden_model.arrays import Array
from skymosaic.errors import InputError
from skymosaic.flight import candidates
from skymosaic.flight.cache import ResultCache
from skymosaic.flight.layout.layout import Layout, groups, lay_out, rough_transforms
from skymosaic.flight.layout.self_calibration import Calibration, calibrate, remaining_distortion, straightened_links
from skymosaic.flight.linking.links import Candidate, Link, PairEstimator, holding
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.flight.linking.view import Settings, View
from skymosaic.flight.second_look import across_heights, with_more_features
from skymosaic.flight.workers import Workers
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.registration.pair import Pair
from skymosaic.stopwatch import Stopwatch

MAX_ROUNDS = 6
"""How often a better layout may propose further pairs."""
SECOND_LOOK_SAMPLES = 20_000
BLURRED = 0.25
"""Relative sharpness below which a photograph is blurred: a blur of about 0.8 working px."""


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight laid out.

    Attributes
    ----------
    names : tuple of str
        Of all photographs, as given.
    sources : tuple of Source
        The photographs that could be read, without repetitions.
    views : tuple of View
        One for each source, in the same order. Links and layouts refer to views by their index in this tuple.
    links : tuple of Link
        Every pair that was tried.
    layouts : tuple of Layout
        Groups of at least two linked views, the largest first.
    left_out : dict of int to str
        Photographs in none of the layouts, by their index among those given, with the reason.
    settings : Settings
    seconds : dict of str to float
        Wall time of each stage.
    pair : Pair or None
        The registration of two photographs, see `skymosaic.flight.two_photographs`.
    calibration : Calibration or None
        What the ties told about the lens. Views, links and layouts are then those of straightened photographs.
    """

    names: tuple[str, ...]
    sources: tuple[Source, ...]
    views: tuple[View, ...]
    links: tuple[Link, ...]
    layouts: tuple[Layout, ...]
    left_out: dict[int, str]
    settings: Settings
    seconds: dict[str, float]
    pair: Pair | None = None
    calibration: Calibration | None = None

    @property
    def lens(self) -> Lens:
        """What straightens the photographs: the lens that was given, or the one that the ties told."""
        return self.settings.lens if self.calibration is None else self.calibration.lens

    @cached_property
    def relative_sharpness(self) -> Array:
        """Sharpness of each view over the median of the views it is linked with, or of all if it has no link, (V,).

        Sharpness depends more on the ground than on the lens, so only views of the same ground are compared.
        """
        neighbours: list[list[float]] = [[] for _ in self.views]
        for link in self.links:
            if link.holds:
                neighbours[link.left].append(self.views[link.right].sharpness)
                neighbours[link.right].append(self.views[link.left].sharpness)
        overall = float(np.median([view.sharpness for view in self.views]))
        expected = [float(np.median(around)) if around else overall for around in neighbours]
        return np.array([view.sharpness / max(value, 1e-9) for view, value in zip(self.views, expected, strict=True)])

    def absent_from(self, layout: Layout) -> dict[int, str]:
        """Photographs that are not in a layout, by their index among those given, with the reason."""
        elsewhere = ((member, other) for other in self.layouts if other is not layout for member in other.members)
        apart = {
            self.sources[member].index: f"{self.sources[member].name}: in another group of "
            f"{len(other.members)} photographs, which nothing links to this one"
            for member, other in elsewhere
        }
        return dict(sorted((self.left_out | apart).items()))


def survey(sources: Sequence[Source], settings: Settings, seed: int, workers: Workers, cache: ResultCache) -> Flight:
    """Compute the layouts of a flight.

    Parameters
    ----------
    sources : sequence of Source
        In any order; fewer pairs have to be tried in the order of the flight.
    settings : Settings
    seed : int
        Of the robust estimator.
    workers : Workers
        What computes features and pairs.
    cache : ResultCache
        Keeps both for the next run.

    Returns
    -------
    Flight
        Without layouts where no two photographs could be linked.

    Raises
    ------
    InputError
        For fewer than two photographs, or if none of them can be used.
    """
    if len(sources) < 2:
        raise InputError(f"a mosaic takes at least two photographs, not {len(sources)}")
    clock = Stopwatch()
    surveyor = Surveyor(settings, PairEstimator(settings.config, seed), workers, cache)
    distinct, left_out = _distinct(sources)
    described = dict(zip(distinct, surveyor.describe(distinct), strict=True))
    left_out |= {source.index: reason for source, reason in described.items() if isinstance(reason, str)}
    seen = {source: view for source, view in described.items() if isinstance(view, View)}
    if not seen:
        raise InputError(f"none of the {len(sources)} photographs can be used: {next(iter(left_out.values()))}")
    of = tuple(seen.values())
    clock.lap("features")
    votes = surveyor.votes(of)
    links = surveyor.link(of, candidates.first_candidates(of, votes))
    _explore(surveyor, of, links)
    if (further := settings.second_look()) is not None:
        estimator = PairEstimator(further.config, seed, SECOND_LOOK_SAMPLES)
        closer = Surveyor(further, estimator, workers, cache)
        links |= with_more_features(closer, tuple(seen), of, links, votes)
    links |= across_heights(surveyor, of, links)
    _explore(surveyor, of, links)
    clock.lap("pairs")
    held = holding(links)
    parts = groups(len(of), held)
    calibration = None
    if settings.lens.matrix is None:
        calibration = calibrate(of, parts[0], held, settings.lens.mask, cache)
    if calibration is not None:
        of, calibration = _without_distortion(surveyor, tuple(seen), of, links, members=parts[0], found=calibration)
        held = holding(links)
    clock.lap("lens")
    layouts = tuple(lay_out(of, members, held) for members in parts if len(members) > 1)
    clock.lap("layout")
    alone = (members[0] for members in parts if len(members) == 1)
    left_out |= {tuple(seen)[view].index: _why_alone(view, of, links.values()) for view in alone}
    names = tuple(source.name for source in sources)
    return Flight(
        names=names,
        sources=tuple(seen),
        views=of,
        links=tuple(links.values()),
        layouts=layouts,
        left_out=left_out,
        settings=settings,
        seconds=clock.seconds,
        calibration=calibration,
    )


def _distinct(sources: Sequence[Source]) -> tuple[list[Source], dict[int, str]]:
    """The sources that can be read and do not repeat another, and why the rest are left out."""
    first: dict[str, Source] = {}
    left_out: dict[int, str] = {}
    for source in sources:
        try:
            same = first.setdefault(source.digest, source)
        except InputError as error:
            left_out[source.index] = str(error)
            continue
        if same is not source:
            left_out[source.index] = f"{source.name}: the same photograph as {same.name}"
    return list(first.values()), left_out


def _explore(surveyor: Surveyor, of: Sequence[View], links: dict[Candidate, Link]) -> None:
    """Add links that the present layout predicts: closed loops, and neighbours that were not candidates before."""
    for _ in range(MAX_ROUNDS):
        held = holding(links)
        rough = [rough_transforms(of, part, held) for part in groups(len(of), held) if len(part) > 2]
        proposed = {pair for transforms in rough for pair in candidates.predicted(of, transforms, links)}
        if not proposed:
            return
        links |= surveyor.link(of, proposed)


def _without_distortion(
    surveyor: Surveyor,
    sources: Sequence[Source],
    of: Sequence[View],
    links: dict[Candidate, Link],
    *,
    members: Sequence[int],
    found: Calibration,
) -> tuple[tuple[View, ...], Calibration]:
    """Views of the straightened photographs, whose links replace those that hold, and the distortion by these links.

    Near the border of a bent photograph a corner looks different from what it is in the middle of a neighbour, and its
    position is off: features have to be found again. Where the new ones do not link two views, the old ties stay.
    """
    straight = surveyor.through(found.lens)
    described = straight.describe(sources)
    if (reason := next((view for view in described if isinstance(view, str)), None)) is not None:
        raise InputError(reason)
    views = tuple(view for view in described if isinstance(view, View))
    held = {(link.left, link.right): link for link in straightened_links(holding(links), of, found.distortion)}
    held |= {pair: link for pair, link in straight.link(views, held).items() if link.holds}
    remaining = remaining_distortion(views, members, list(held.values()), surveyor.cache)
    links |= {(link.left, link.right): link for link in straightened_links(list(held.values()), views, remaining)}
    return views, found.with_remaining(remaining)


def _why_alone(view: int, of: Sequence[View], links: Iterable[Link]) -> str:
    """Why no link joins a view to the others, with its best match."""
    features = len(of[view].features)
    if features < MIN_INLIERS:
        return f"{of[view].name}: too few features ({features}; flat or blurred image?)"
    tried = [link for link in links if view in (link.left, link.right)]
    if not tried:
        return f"{of[view].name}: no other photograph can be used"
    best = max(tried, key=lambda link: link.inliers)
    other = of[best.left + best.right - view].name
    found = f"at best {best.inliers} matches agree, with {other}; {MIN_INLIERS} are needed"
    return f"{of[view].name}: nothing links it to the others ({found})"
