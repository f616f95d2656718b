"""Computes what a flight is laid out from, or takes it from the cache."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from skymosaic.errors import InputError
from skymosaic.flight.cache import ResultCache, key_of
from skymosaic.flight.linking import resemblance
from skymosaic.flight.linking.links import FIRST_LOOK_SAMPLES, Candidate, Link, link_views
from skymosaic.flight.linking.view import Settings, View, describe, describe_thumbnail
from skymosaic.flight.workers import Workers
from skymosaic.imagery.photographs import Source


@dataclass(frozen=True, eq=False)
class Surveyor:
    """Computes views and links, or takes them from the cache.

    Attributes
    ----------
    settings : Settings
    seed : int
        Seed of the robust estimator.
    workers : Workers
    cache : ResultCache
    max_samples : int
        Samples of the robust estimator per link, at most.
    """

    settings: Settings
    seed: int
    workers: Workers
    cache: ResultCache
    max_samples: int = FIRST_LOOK_SAMPLES

    def describe(self, sources: Sequence[Source]) -> list[View | str]:
        """Compute the view of each source, or say why there is none."""
        views: dict[int, View | str] = {}
        for index, source in enumerate(sources):
            key = self.settings.key(source)
            if arrays := self.cache.load(key):
                views[index] = View.unpack(arrays, source.name, key)
        missing = [index for index in range(len(sources)) if index not in views]
        calls = [(sources[index], self.settings) for index in missing]
        for index, call, described in zip(missing, calls, self.workers.run("features", _describe, calls), strict=True):
            # A worker that has joined meanwhile may not see the file.
            retried = isinstance(described, str) and self.workers.are_elsewhere
            view = views[index] = _describe(*call) if retried else described
            if isinstance(view, View):
                self.cache.save(view.key, view.pack())
        return [views[index] for index in range(len(sources))]

    def describe_thumbnails(self, views: Sequence[View]) -> list[View]:
        """Replace the features of the views by those of their thumbnails."""
        return list(self.workers.run("thumbnails", describe_thumbnail, [(view, self.settings) for view in views]))

    def count_votes(self, views: Sequence[View], across: Sequence[int] = ()) -> NDArray[np.int64]:
        """Count the votes for pairs of views that share words, (V, V), else 0; see `resemblance`.

        If there is an ``across``, only pairs of one of these views with one of the others are counted.
        """
        compacts = [resemblance.compact(view.features) for view in views]
        partners: dict[int, list[int]] = {view: [] for view in range(len(views))}
        inside = set(across)
        for one, other in resemblance.likely_pairs(compacts):
            if not inside or (one in inside) != (other in inside):
                partners[one].append(other)
        calls = [(compacts[one], [compacts[other] for other in others]) for one, others in partners.items()]
        votes = np.zeros((len(views), len(views)), dtype=np.int64)
        rows = self.workers.run("look-up", resemblance.count_votes, calls)
        for (one, others), row in zip(partners.items(), rows, strict=True):
            # Each pair is counted once, from its first view; the other direction differs by a vote or two.
            votes[one, others] = votes[others, one] = row
        return votes

    def link(self, views: Sequence[View] | Mapping[int, View], pairs: Iterable[Candidate]) -> dict[Candidate, Link]:
        """Link the views of each pair, in rising order of the pairs; some of the links may not hold."""
        matcher = self.settings.config.matcher
        keys = {
            (left, right): key_of("pair", views[left].key, views[right].key, matcher, self.seed, self.max_samples)
            for left, right in sorted(pairs)
        }
        links: dict[Candidate, Link] = {}
        for pair, key in keys.items():
            if arrays := self.cache.load(key):
                links[pair] = Link.unpack(arrays, *pair)
        missing = [pair for pair in keys if pair not in links]
        link_pair = partial(link_views, config=self.settings.config, seed=self.seed, max_samples=self.max_samples)
        calls = [(pair, *(views[side].features for side in pair)) for pair in missing]
        for pair, link in zip(missing, self.workers.run("pairs", link_pair, calls), strict=True):
            links[pair] = link
            self.cache.save(keys[pair], link.pack())
        # The sums of the adjustment depend on the order of the links, which must not depend on what was kept.
        return {pair: links[pair] for pair in keys}


def _describe(source: Source, settings: Settings) -> View | str:
    """`describe`, but returns the reason instead of raising: one bad file does not end a flight."""
    try:
        return describe(source, settings)
    except InputError as error:
        return str(error)
