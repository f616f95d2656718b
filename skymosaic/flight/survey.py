"""Whole flights: from many photographs to where each of them lies on the ground."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skymosaic.errors import InputError
from skymosaic.flight import links as pair_links
from skymosaic.flight import view as flight_view
from skymosaic.flight.cache import ResultCache, key_of
from skymosaic.flight.layout import Layout, groups, lay_out, predicted, rough_transforms
from skymosaic.flight.links import Candidate, Link, PairEstimator, verify
from skymosaic.flight.view import Settings, View, describe
from skymosaic.flight.workers import Workers
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.imagery.photographs import Source
from skymosaic.stopwatch import Stopwatch

MAX_ROUNDS = 3
"""How often a better layout may propose further pairs."""
SECOND_LOOK_SAMPLES = 20_000
SECOND_LOOK_PARTNERS = 2


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight laid out.

    Attributes
    ----------
    names : tuple of str
        Of all photographs, as given.
    sources : tuple of Source
        Those that could be read, without repetitions.
    views : tuple of View
        Theirs, in the same order; links and layouts speak of them by their place in it.
    links : tuple of Link
        Every pair that was tried.
    layouts : tuple of Layout
        Groups of at least two linked views, the largest first.
    left_out : dict of int to str
        Photographs in none of them, by their place among those given, with the reason.
    settings : Settings
    seconds : dict of str to float
        Wall time of each stage.
    """

    names: tuple[str, ...]
    sources: tuple[Source, ...]
    views: tuple[View, ...]
    links: tuple[Link, ...]
    layouts: tuple[Layout, ...]
    left_out: dict[int, str]
    settings: Settings
    seconds: dict[str, float]

    def absent_from(self, layout: Layout) -> dict[int, str]:
        """Photographs that a layout does not place, by their place among those given, with the reason."""
        elsewhere = ((member, other) for other in self.layouts if other is not layout for member in other.members)
        apart = {
            self.sources[member].index: f"{self.sources[member].name}: in another group of "
            f"{len(other.members)} photographs, which nothing links to this one"
            for member, other in elsewhere
        }
        return dict(sorted((self.left_out | apart).items()))


class Surveyor:
    """Makes views and links, each once: what the cache has is not computed again.

    Parameters
    ----------
    settings : Settings
    estimator : PairEstimator
    workers : Workers
        Who computes.
    cache : ResultCache
    """

    def __init__(self, settings: Settings, estimator: PairEstimator, workers: Workers, cache: ResultCache) -> None:
        self._settings = settings
        self._estimator = estimator
        self._workers = workers
        self._cache = cache

    def describe(self, sources: Sequence[Source]) -> list[View | str]:
        """The view of each source, or why there is none."""
        found: dict[int, View | str] = {}
        for place, source in enumerate(sources):
            key = self._settings.key(source)
            if arrays := self._cache.load(key):
                found[place] = flight_view.unpacked(arrays, source.name, key)
        missing = [place for place in range(len(sources)) if place not in found]
        calls = [(sources[place], self._settings) for place in missing]
        for place, view in zip(missing, self._workers.run("features", _describe, calls), strict=True):
            found[place] = view
            if isinstance(view, View):
                self._cache.save(view.key, view.packed())
        return [found[place] for place in range(len(sources))]

    def link(self, of: Sequence[View] | Mapping[int, View], pairs: Iterable[Candidate]) -> dict[Candidate, Link]:
        """The link of each pair, held or not."""
        keys = {pair: self._pair_key(of[pair[0]], of[pair[1]]) for pair in sorted(pairs)}
        found: dict[Candidate, Link] = {}
        for pair, key in keys.items():
            if arrays := self._cache.load(key):
                found[pair] = pair_links.unpacked(arrays, *pair)
        missing = [pair for pair in keys if pair not in found]
        calls = [(self._estimator, pair, *(of[side].features for side in pair)) for pair in missing]
        for pair, link in zip(missing, self._workers.run("pairs", verify, calls), strict=True):
            found[pair] = link
            self._cache.save(keys[pair], link.packed())
        return found

    def _pair_key(self, left: View, right: View) -> str:
        estimator = self._estimator
        return key_of("pair", left.key, right.key, estimator.config.matcher, estimator.seed, estimator.max_samples)


def _describe(source: Source, settings: Settings) -> View | str:
    """`describe`, with the reason in place of an error: one bad file does not end a flight."""
    try:
        return describe(source, settings)
    except InputError as error:
        return str(error)


def survey(sources: Sequence[Source], settings: Settings, seed: int, workers: Workers, cache: ResultCache) -> Flight:
    """Find out where each photograph of a flight lies.

    Parameters
    ----------
    sources : sequence of Source
        In any order; that of the flight helps.
    settings : Settings
    seed : int
        Of the robust estimator.
    workers : Workers
        Who computes features and pairs.
    cache : ResultCache
        Where they are kept for the next run.

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
    votes = _look_up(of, workers)
    links = surveyor.link(of, pair_links.first_candidates(of, votes))
    _explore(surveyor, of, links)
    if (further := settings.second_look()) is not None:
        estimator = PairEstimator(further.config, seed, SECOND_LOOK_SAMPLES)
        _look_again(Surveyor(further, estimator, workers, cache), tuple(seen), of, links, votes)
        _explore(surveyor, of, links)
    clock.lap("pairs")
    held = _held(links)
    parts = groups(len(of), held)
    layouts = tuple(lay_out(of, members, held) for members in parts if len(members) > 1)
    clock.lap("layout")
    alone = (members[0] for members in parts if len(members) == 1)
    left_out |= {tuple(seen)[view].index: _why_alone(view, of, links.values()) for view in alone}
    names = tuple(source.name for source in sources)
    return Flight(names, tuple(seen), of, tuple(links.values()), layouts, left_out, settings, clock.seconds)


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


def _look_up(of: Sequence[View], workers: Workers) -> NDArray[np.int64]:
    """How much alike the compact features of every two views are, (V, V)."""
    compacts = [pair_links.compact(view.features) for view in of]
    calls = [(one, compacts[place + 1 :]) for place, one in enumerate(compacts)]
    votes = np.zeros((len(of), len(of)), dtype=np.int64)
    for place, row in enumerate(workers.run("look-up", pair_links.votes, calls)):
        votes[place, place + 1 :] = votes[place + 1 :, place] = row
    return votes


def _held(links: Mapping[Candidate, Link]) -> list[Link]:
    return [link for link in links.values() if link.holds]


def _explore(surveyor: Surveyor, of: Sequence[View], links: dict[Candidate, Link]) -> None:
    """Add links that the layout so far predicts: loops that close, neighbours that nothing had proposed."""
    for _ in range(MAX_ROUNDS):
        held = _held(links)
        rough = [rough_transforms(of, part, held) for part in groups(len(of), held) if len(part) > 2]
        proposed = {pair for transforms in rough for pair in predicted(of, transforms, links.keys())}
        if not proposed:
            return
        links |= surveyor.link(of, proposed)


def _look_again(
    surveyor: Surveyor,
    sources: Sequence[Source],
    of: Sequence[View],
    links: dict[Candidate, Link],
    votes: NDArray[np.int64],
) -> None:
    """Try harder where a group has no link to the largest: its neighbours in order, and what looks most alike."""
    parts = groups(len(of), _held(links))
    pairs: set[Candidate] = set()
    for members in parts[1:]:
        outside = np.setdiff1d(np.arange(len(of)), members)
        for view in members:
            alike = outside[np.argsort(-votes[view, outside], kind="stable")[:SECOND_LOOK_PARTNERS]]
            before, after = outside[outside < view][-1:], outside[outside > view][:1]
            pairs |= {(min(view, other), max(view, other)) for other in np.concatenate([alike, before, after]).tolist()}
    involved = sorted({view for pair in pairs for view in pair})
    described = surveyor.describe([sources[view] for view in involved])
    closer = dict(zip(involved, (view for view in described if isinstance(view, View)), strict=True))
    links |= surveyor.link(closer, pairs)


def _why_alone(view: int, of: Sequence[View], links: Iterable[Link]) -> str:
    """Why nothing links a view to the others, with the best that was found."""
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
