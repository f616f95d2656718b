"""Computes what a flight is laid out from, or takes it from the cache."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skymosaic.errors import InputError
from skymosaic.flight.cache import ResultCache, key_of
from skymosaic.flight.linking import links as pair_links
from skymosaic.flight.linking import resemblance
from skymosaic.flight.linking import view as flight_view
from skymosaic.flight.linking.links import Candidate, Link, PairEstimator, verify
from skymosaic.flight.linking.view import Settings, View, describe, in_thumbnail
from skymosaic.flight.workers import Workers
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source


class Surveyor:
    """Computes views and links, or takes them from the cache.

    Parameters
    ----------
    settings : Settings
    estimator : PairEstimator
    workers : Workers
    cache : ResultCache
    """

    def __init__(self, settings: Settings, estimator: PairEstimator, workers: Workers, cache: ResultCache) -> None:
        self._settings = settings
        self._estimator = estimator
        self._workers = workers
        self.cache = cache

    def through(self, lens: Lens) -> Surveyor:
        """One whose views are of photographs that ``lens`` straightens."""
        return Surveyor(replace(self._settings, lens=lens), self._estimator, self._workers, self.cache)

    def describe(self, sources: Sequence[Source]) -> list[View | str]:
        """The view of each source, or why there is none."""
        found: dict[int, View | str] = {}
        for index, source in enumerate(sources):
            key = self._settings.key(source)
            if arrays := self.cache.load(key):
                found[index] = flight_view.unpacked(arrays, source.name, key)
        missing = [index for index in range(len(sources)) if index not in found]
        calls = [(sources[index], self._settings) for index in missing]
        for index, view in zip(missing, self._workers.run("features", _describe, calls), strict=True):
            found[index] = view
            if isinstance(view, View):
                self.cache.save(view.key, view.packed())
        return [found[index] for index in range(len(sources))]

    def in_thumbnails(self, of: Sequence[View]) -> list[View]:
        """The views with the features of their thumbnails; without any where the front end cannot take one."""
        return list(self._workers.run("thumbnails", _in_thumbnail, [(view, self._settings) for view in of]))

    def votes(self, of: Sequence[View], across: Sequence[int] = ()) -> NDArray[np.int64]:
        """Votes for pairs of views that share words, (V, V), else 0; see `skymosaic.flight.linking.resemblance`.

        Where there is an ``across``, only for pairs of one of these views with one of the others.
        """
        compacts = [resemblance.compact(view.features) for view in of]
        partners: dict[int, list[int]] = {view: [] for view in range(len(of))}
        inside = set(across)
        for one, other in resemblance.likely_pairs(compacts):
            if not inside or (one in inside) != (other in inside):
                partners[one].append(other)
        calls = [(compacts[one], [compacts[other] for other in others]) for one, others in partners.items()]
        votes = np.zeros((len(of), len(of)), dtype=np.int64)
        rows = self._workers.run("look-up", resemblance.votes, calls)
        for (one, others), row in zip(partners.items(), rows, strict=True):
            votes[one, others] = votes[others, one] = row
        return votes

    def link(self, of: Sequence[View] | Mapping[int, View], pairs: Iterable[Candidate]) -> dict[Candidate, Link]:
        """The link of each pair, whether it holds or not."""
        keys = {pair: self._pair_key(of[pair[0]], of[pair[1]]) for pair in sorted(pairs)}
        found: dict[Candidate, Link] = {}
        for pair, key in keys.items():
            if arrays := self.cache.load(key):
                found[pair] = pair_links.unpacked(arrays, *pair)
        missing = [pair for pair in keys if pair not in found]
        calls = [(self._estimator, pair, *(of[side].features for side in pair)) for pair in missing]
        for pair, link in zip(missing, self._workers.run("pairs", verify, calls), strict=True):
            found[pair] = link
            self.cache.save(keys[pair], link.packed())
        return found

    def _pair_key(self, left: View, right: View) -> str:
        estimator = self._estimator
        return key_of("pair", left.key, right.key, estimator.config.matcher, estimator.seed, estimator.max_samples)


def _describe(source: Source, settings: Settings) -> View | str:
    """`describe`, but returns the reason instead of raising: one bad file does not end a flight."""
    try:
        return describe(source, settings)
    except InputError as error:
        return str(error)


def _in_thumbnail(view: View, settings: Settings) -> View:
    try:
        return in_thumbnail(view, settings)
    except InputError:
        return replace(view, features=view.features[:0])
