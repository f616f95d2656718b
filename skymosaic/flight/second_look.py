"""Groups of photographs that nothing links to the largest group get a second attempt, in two ways.

With more features and longer descriptors, because too few may have agreed; and at the scale of thumbnails, because a
link takes one pass of the front end, which meets zooms up to about 2. In its thumbnail, a photograph that was taken
from nearer the ground looks as the others do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skymosaic.flight.layout.layout import groups
from skymosaic.flight.linking.links import Candidate, Link, holding
from skymosaic.flight.linking.surveyor import Surveyor
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply
from skymosaic.imagery.photographs import Source

PARTNERS = 2
"""Views outside its group that each view is matched with: those that resemble it most."""


def with_more_features(
    surveyor: Surveyor,
    sources: Sequence[Source],
    of: Sequence[View],
    links: Mapping[Candidate, Link],
    votes: NDArray[np.int64],
) -> dict[Candidate, Link]:
    """Links of groups apart with the rest: with the neighbours in order, and with the most similar views.

    Parameters
    ----------
    surveyor : Surveyor
        Of the more expensive features.
    sources, of : sequence of Source and of View
    links : mapping of (int, int) to Link
    votes : ndarray of int64, shape (V, V)
        From `Surveyor.votes`.
    """
    parts = groups(len(of), holding(links))
    pairs: set[Candidate] = set()
    for members in parts[1:]:
        outside = np.setdiff1d(np.arange(len(of)), members)
        for view in members:
            alike = outside[np.argsort(-votes[view, outside], kind="stable")[:PARTNERS]]
            before, after = outside[outside < view][-1:], outside[outside > view][:1]
            pairs |= {(min(view, other), max(view, other)) for other in np.concatenate([alike, before, after]).tolist()}
    involved = sorted({view for pair in pairs for view in pair})
    described = surveyor.describe([sources[view] for view in involved])
    closer = dict(zip(involved, (view for view in described if isinstance(view, View)), strict=True))
    return surveyor.link(closer, pairs)


def across_heights(surveyor: Surveyor, of: Sequence[View], links: Mapping[Candidate, Link]) -> dict[Candidate, Link]:
    """Links of groups apart with the largest group that hold where one of the two photographs is seen in its thumbnail.

    Arguments as of `with_more_features`.
    """
    largest, *apart = groups(len(of), holding(links))
    if not apart:
        return {}
    alone = np.concatenate(apart).tolist()
    small = surveyor.in_thumbnails(of)
    found: dict[Candidate, Link] = {}
    for reduced in (set(alone), set(largest)):
        views = [small[index] if index in reduced else view for index, view in enumerate(of)]
        votes = surveyor.votes(views, across=alone)[np.ix_(alone, largest)]
        best = np.argsort(-votes, axis=1, kind="stable")[:, :PARTNERS]
        pairs = {(view, largest[other]) for view, row in zip(alone, best.tolist(), strict=True) for other in row}
        for pair, link in surveyor.link(views, {(min(pair), max(pair)) for pair in pairs}).items():
            if link.holds and (pair not in found or link.ties > found[pair].ties):
                found[pair] = _in_working_px(link, views, of)
    return found


def _in_working_px(link: Link, views: Sequence[View], of: Sequence[View]) -> Link:
    """A link of ``views`` with its points in the working px of ``of``."""
    left, right = (
        apply(np.linalg.inv(of[index].to_original) @ views[index].to_original, points)
        for index, points in ((link.left, link.left_points), (link.right, link.right_points))
    )
    return replace(link, left_points=left, right_points=right)
