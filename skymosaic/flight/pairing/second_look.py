"""Groups of photographs that nothing links to the largest group get a second attempt, in three ways.

With more features and longer descriptors, because too few may have agreed; at the scale of thumbnails, because a link
takes one pass of the front end, which meets zooms up to about 2: in its thumbnail, a photograph that was taken from
nearer the ground looks as the others do; and by thumbnails of even contrast on both sides, because soft, murky or
unevenly lit ground has no corners at full size. Where something moves with the camera, what all have in common at the
same pixels is subtracted from these.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from skymosaic.features.contrast import find_pattern
from skymosaic.flight.layout.linked_group import groups
from skymosaic.flight.linking.links import Candidate, Link, valid_links
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply
from skymosaic.imagery.photographs import Source

PARTNERS = 2
"""Views outside its group that each view is matched with: those that resemble it most."""
MAX_SAMPLES = 20_000
"""Samples per link: few of the matches that the first look left over are right."""


def link_by_more_features(
    surveyor: Surveyor,
    sources: Sequence[Source],
    views: Sequence[View],
    links: Mapping[Candidate, Link],
    votes: NDArray[np.int16],
) -> dict[Candidate, Link]:
    """Links that reconnect isolated groups: with the neighbours in order, and with the most similar views.

    ``votes`` (V, V) are from `Surveyor.count_votes`. Nothing is linked if the preset cannot have more features.
    """
    settings = surveyor.settings.with_more_features()
    if settings is None:
        return {}
    pairs = _pairs_between_groups(links, votes)
    involved = sorted({view for pair in pairs for view in pair})
    surveyor = replace(surveyor, settings=settings, max_samples=MAX_SAMPLES)
    closer = dict(zip(involved, surveyor.describe_all([sources[view] for view in involved]), strict=True))
    return surveyor.link(closer, pairs)


def link_across_heights(
    surveyor: Surveyor, views: Sequence[View], links: Mapping[Candidate, Link]
) -> dict[Candidate, Link]:
    """Links that hold and reconnect isolated groups with the largest, by the thumbnail of one of two photographs."""
    largest, *others = groups(len(views), valid_links(links))
    if not others:
        return {}
    isolated = np.concatenate(others).tolist()
    thumbnails = surveyor.describe_thumbnails(views)
    best_links: dict[Candidate, Link] = {}
    for reduced in (set(isolated), set(largest)):
        mixed = [thumbnails[index] if index in reduced else view for index, view in enumerate(views)]
        votes = surveyor.count_votes(mixed, across=isolated)[np.ix_(isolated, largest)]
        alike = np.argsort(-votes, axis=1, kind="stable")[:, :PARTNERS]
        pairs = {(view, largest[other]) for view, row in zip(isolated, alike.tolist(), strict=True) for other in row}
        for pair, link in surveyor.link(mixed, {(min(pair), max(pair)) for pair in pairs}).items():
            if link.holds and (pair not in best_links or link.ties > best_links[pair].ties):
                best_links[pair] = _in_working_px(link, mixed, views)
    return best_links


def link_by_coarse_detail(
    surveyor: Surveyor, views: Sequence[View], links: Mapping[Candidate, Link]
) -> dict[Candidate, Link]:
    """Links that hold and reconnect isolated groups, by thumbnails of even contrast of both photographs."""
    isolated = groups(len(views), valid_links(links))[1:]
    if not isolated:
        return {}
    settings = surveyor.settings.with_more_features() or surveyor.settings
    surveyor = replace(surveyor, settings=settings, max_samples=MAX_SAMPLES)
    pattern = None
    if any(link.moves_with_camera for link in links.values()):
        pictures = [view.thumbnail for view in surveyor.fetch_thumbnails(views)]
        pattern = find_pattern(pictures) if len({picture.shape[:2] for picture in pictures}) == 1 else None
    thumbnails = surveyor.describe_thumbnails(views, even=True, pattern=pattern)
    votes = surveyor.count_votes(thumbnails, across=np.concatenate(isolated).tolist())
    tried = surveyor.link(thumbnails, _pairs_between_groups(links, votes))
    return {pair: _in_working_px(link, thumbnails, views) for pair, link in tried.items() if link.holds}


def _pairs_between_groups(links: Mapping[Candidate, Link], votes: NDArray[np.int16]) -> set[Candidate]:
    """Pairs of each view of an isolated group, with its neighbours outside it and with what resembles it most."""
    pairs: set[Candidate] = set()
    for members in groups(len(votes), valid_links(links))[1:]:
        outside = np.setdiff1d(np.arange(len(votes)), members)
        for view in members:
            alike = outside[np.argsort(-votes[view, outside], kind="stable")[:PARTNERS]]
            before, after = outside[outside < view][-1:], outside[outside > view][:1]
            pairs |= {(min(view, other), max(view, other)) for other in np.concatenate([alike, before, after]).tolist()}
    return pairs


def _in_working_px(link: Link, mixed: Sequence[View], views: Sequence[View]) -> Link:
    """Convert the points of a link from working px of the ``mixed`` views to those of ``views``."""
    ends = link.left, link.right
    to_views = {end: np.linalg.inv(views[end].to_original) @ mixed[end].to_original for end in ends}
    return link.move({end: partial(apply, matrix) for end, matrix in to_views.items()})
