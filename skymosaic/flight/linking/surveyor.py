"""Computes what a flight is laid out from, or takes it from the cache."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Float32, Matrix, Pixels, Records
from golden_model.cache import Cache
from skymosaic.common.errors import InputError
from skymosaic.features.given_matches import GivenMatches
from skymosaic.features.positions import are_on_ground, match_points
from skymosaic.flight.linking import resemblance
from skymosaic.flight.linking.links import FIRST_LOOK_SAMPLES, Candidate, Link, link_views
from skymosaic.flight.linking.view import HEAVY, Settings, View, describe, describe_thumbnail, straighten
from skymosaic.geometry.ground import Sight
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.parcel import Parcel
from skymosaic.imagery.photographs import Source
from skymosaic.running.cache import key_of
from skymosaic.running.workers import Workers

_LINKED_BY = attrgetter("features", "thumbnail", "to_thumbnail", "visible", "orientation")
LOOKED_UP_AT_ONCE = 16
"""Views in one call: neighbours share most of the photographs that they are compared with."""


@dataclass(frozen=True, eq=False)
class Surveyor:
    """Computes views and links, or takes them from the cache."""

    settings: Settings
    seed: int
    """Seed of the robust estimator."""
    workers: Workers
    cache: Cache
    max_samples: int = FIRST_LOOK_SAMPLES
    """Samples of the robust estimator per link, at most."""
    given: Mapping[Candidate, GivenMatches] = field(default_factory=dict)
    """Matches of the user's, by which these pairs of views are linked, whatever their features are."""

    def describe(self, sources: Sequence[Source]) -> list[View | str]:
        """Compute the view of each source, or say why there is none."""
        calls = [(source, self.settings, self.cache) for source in sources]
        described = self.workers.run("features", _describe, calls, kept=HEAVY)
        # A worker that has joined meanwhile may not see the file.
        return [
            _describe(*call) if isinstance(view, str) and self.workers.are_elsewhere else view
            for call, view in zip(calls, described, strict=True)
        ]

    def describe_all(self, sources: Sequence[Source]) -> list[View]:
        """Compute the view of each source that could be used before.

        Raises
        ------
        InputError
            If one of them no longer can.
        """
        views: list[View] = []
        for view in self.describe(sources):
            if isinstance(view, str):
                raise InputError(view)
            views.append(view)
        return views

    def fetch_thumbnails(self, views: Sequence[View]) -> tuple[View, ...]:
        """Bring the thumbnails to this process; the features are dropped, because linked views do not need them."""
        parcels = self.workers.run("thumbnails", Parcel, [(view.thumbnail,) for view in views])
        return tuple(replace(view.light, thumbnail=parcel.pixels) for view, parcel in zip(views, parcels, strict=True))

    def describe_thumbnails(
        self, views: Sequence[View], *, even: bool = False, pattern: Float32 | None = None
    ) -> list[View]:
        """Replace the features of the views by those of their thumbnails, or of thumbnails of even contrast."""
        calls = [(view.thumbnail, view.light, self.settings, even, pattern) for view in views]
        return list(self.workers.run("thumbnails", describe_thumbnail, calls, kept=HEAVY))

    def straighten(self, views: Sequence[View]) -> tuple[View, ...]:
        """The views as if the photographs had been taken without the lens's distortion, see `straighten`."""
        return tuple(self.workers.run("lens", straighten, [(view, self.settings.lens) for view in views], kept=HEAVY))

    def count_votes(self, views: Sequence[View], across: Sequence[int] = ()) -> NDArray[np.int16]:
        """Count the votes for pairs of views that share words, (V, V), else 0; see `resemblance`.

        If there is an ``across``, only pairs of one of these views with one of the others are counted.
        """
        compacts = [view.strongest for view in views]
        partners: dict[int, list[int]] = {view: [] for view in range(len(views))}
        inside = set(across)
        for one, other in resemblance.likely_pairs(compacts):
            if not inside or (one in inside) != (other in inside):
                partners[one].append(other)
        calls = []
        for start in range(0, len(views), LOOKED_UP_AT_ONCE):
            block = {one: partners[one] for one in range(start, min(start + LOOKED_UP_AT_ONCE, len(views)))}
            calls.append((block, {view: compacts[view] for one, others in block.items() for view in (one, *others)}))
        votes = np.zeros((len(views), len(views)), dtype=np.int16)
        for (block, _), rows in zip(calls, self.workers.run("look-up", _count_votes, calls), strict=True):
            for (one, others), row in zip(block.items(), rows, strict=True):
                # Each pair is counted once, from its first view; the other direction differs by a vote or two.
                votes[one, others] = votes[others, one] = row
        return votes

    def link(self, views: Sequence[View] | Mapping[int, View], pairs: Iterable[Candidate]) -> dict[Candidate, Link]:
        """Link the views of each pair, in rising order of the pairs; some of the links may not hold."""
        return self.link_nearby(views, dict.fromkeys(pairs))

    def link_nearby(
        self, views: Sequence[View] | Mapping[int, View], predicted: Mapping[Candidate, Matrix | None]
    ) -> dict[Candidate, Link]:
        """Link pairs like `link`, each near its predicted homography if it has one, see `link_views`."""
        how = self.settings.config.matcher, self.seed, self.max_samples
        calls = []
        for pair, homography in sorted(predicted.items(), key=lambda item: item[0]):
            left, right = (views[side] for side in pair)
            matches = self._match_as_given(pair, left, right)
            predictions = [None if each is None else each.tolist() for each in (homography, matches)]
            key = key_of(link_views, left.key, right.key, *how, *predictions)
            calls.append((pair, homography, matches, key, *_LINKED_BY(left), *_LINKED_BY(right)))
        link_pair = partial(link_views, config=self.settings.config, seed=self.seed, max_samples=self.max_samples)
        links = self.workers.run(
            "pairs", partial(_link, compute=link_pair, lens=self.settings.lens, cache=self.cache), calls
        )
        return dict(zip((pair for pair, *_ in calls), links, strict=True))

    def _match_as_given(self, pair: Candidate, left: View, right: View) -> Records | None:
        """Match records of what the user has given for a pair, but for what a mask hides; None where it is nothing."""
        if pair not in self.given:
            return None
        lenses = [self.settings.lens.turned(view.orientation) for view in (left, right)]
        sides = [(view.size, view.to_original, lens) for view, lens in zip((left, right), lenses, strict=True)]
        _, matches = self.given[pair].records(self.settings.config.front_end.pattern.record.dtype, sides)
        for view, lens, points in zip((left, right), lenses, match_points(matches), strict=True):
            matches["verdict"] &= are_on_ground(points, lens.visible_mask(view.working_size, view.visible))
        return matches


def _describe(source: Source, settings: Settings, cache: Cache) -> View | str:
    """Load or compute a view; returns the reason instead of raising: one bad file does not end a flight."""
    try:
        key = settings.key(source)
        if arrays := cache.load(key):
            return View.unpack(arrays, source.name, key)
        view = describe(source, settings)
    except InputError as error:
        return str(error)
    cache.save(key, view.pack())
    return view


def _link(
    pair: Candidate,
    predicted: Matrix | None,
    matches: Records | None,
    key: str,
    *sides: Any,
    compute: Callable[..., Link],
    lens: Lens,
    cache: Cache,
) -> Link:
    """Load or compute a link; ``sides`` are `_LINKED_BY` of the left, then of the right view."""
    if arrays := cache.load(key):
        return Link.unpack(arrays, *pair)
    (left, *left_picture), (right, *right_picture) = sides[:5], sides[5:]
    sights = _see(lens, *left_picture), _see(lens, *right_picture)
    link = compute(pair, left, right, sights=sights, predicted=predicted, matches=matches)
    cache.save(key, link.pack())
    return link


def _see(lens: Lens, thumbnail: Pixels, to_thumbnail: Matrix, own: Pixels | None, orientation: int) -> Sight:
    visible = lens.turned(orientation).visible_mask((thumbnail.shape[1], thumbnail.shape[0]), own)
    return Sight(thumbnail, visible, np.linalg.inv(to_thumbnail).astype(np.float64))


def _count_votes(partners: Mapping[int, Sequence[int]], compacts: Mapping[int, Records]) -> list[list[int]]:
    """Votes of each view for its partners."""
    return [
        resemblance.count_votes(compacts[one], [compacts[other] for other in others])
        for one, others in partners.items()
    ]
