"""Which pairs of a flight are worth matching: before a layout exists, and as soon as a layout predicts overlaps.

Matching every pair that overlaps would take a time that grows with the square of the overlap, and links beyond about
ten per photograph hardly improve the layout. So each round asks what the network lacks. Taken as resistors, whose
conductance is the number of common points, the links leave a resistance R between two photographs: their relative
position is that uncertain. A new link with w common points removes a share w R / (1 + w R) of it. Neighbours within
a strip that is well linked have a small w R; strips that meet, and loops that close, have a large one. Over all
links, w R adds up to the number of photographs less one (Foster 1949), which is 0.2 per link with ten links each.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from golden_model.arrays import Array
from skymosaic.compositing.warp import magnification
from skymosaic.flight.layout.extent import overlaps
from skymosaic.flight.layout.normal_equations import factor_symmetric
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.resemblance import COMPACT_FEATURES
from skymosaic.flight.linking.view import View

NEXT_IN_ORDER, NEAREST_BY_GPS, MOST_SIMILAR = 2, 4, 4
"""Partners that each view proposes by order, by GPS, and by votes."""
MIN_VOTES = 9
"""Views without common ground get 2 to 11 votes (measured): a false candidate costs a match, a missed one a link."""
SAME_VOTES = COMPACT_FEATURES // 2
"""Votes of photographs that show nearly the same: of frames above one place 150 and more; the fourth most similar one
of a survey has fewer than 106 in 95 % of all cases. Of those that are not next in order, each proposes one: what two of
them show, others tie as well."""
MAX_PREDICTED = 2
"""Partners that each view proposes per round; the next round sees what these links have changed."""
MIN_OVERLAP, MIN_GAIN = 0.1, 0.2
"""Smallest overlap and w R of a predicted pair; 0.2 is the mean w R of a network with ten links per photograph."""
SAME_OVERLAP, MIN_GAIN_OF_SAME = 0.7, 1.0
"""Photographs that share more, of the larger one too, are only tied where others tie them no better than their own link
would: a third one that is tied to both tells as much of what is around them. Were it the share of the smaller one, a
kite's flight would lose 20 links that it needs."""
COLUMNS_AT_ONCE = 8
"""Columns of an inverse that are computed together: more take longer, because they leave the processor's cache."""


def first_candidates(views: Sequence[View], votes: NDArray[np.int16]) -> set[Candidate]:
    """Pairs to try before a layout exists: by order, by GPS, and by votes (V, V)."""
    pairs = [(i, i + step) for step in range(1, NEXT_IN_ORDER + 1) for i in range(len(views) - step)]
    pairs += _nearest_by_gps(views)
    for i, row in enumerate(votes):
        similar = [int(j) for j in np.argsort(-row, kind="stable")[:MOST_SIMILAR] if row[j] >= MIN_VOTES]
        same = [j for j in similar if row[j] >= SAME_VOTES and abs(j - i) > NEXT_IN_ORDER]
        pairs += [(i, j) for j in similar if j not in same[1:]]
    return {(min(pair), max(pair)) for pair in pairs}


def _nearest_by_gps(views: Sequence[View]) -> list[Candidate]:
    known = [(i, view.gps) for i, view in enumerate(views) if view.gps is not None]
    if len(known) < 2:
        return []
    metres = np.array([gps.metres_from(known[0][1]) for _, gps in known])
    _, nearest = KDTree(metres).query(metres, k=min(NEAREST_BY_GPS + 1, len(known)))
    return [(known[row][0], known[other][0]) for row, others in enumerate(nearest) for other in others if other != row]


def predicted(
    views: Sequence[View], transforms: Mapping[int, Array], links: Mapping[Candidate, Link]
) -> set[Candidate]:
    """Pairs without a link that overlap according to the layout of one group of linked views, and would fix it most.

    ``transforms`` are as in `Layout`; pairs with a link are not proposed, whether it holds or not.
    """
    shares = overlaps(views, transforms)
    valid = {pair: link for pair, link in links.items() if link.holds and pair[0] in transforms}
    full_overlap_ties = float(np.median([link.ties / max(shares.get(p, 0), MIN_OVERLAP) for p, link in valid.items()]))
    pairs = [pair for pair, share in shares.items() if share >= MIN_OVERLAP and pair not in links]
    sizes = {member: views[member].working_size for member in transforms}
    area = {m: math.prod(size) * magnification(size, transforms[m]) ** 2 for m, size in sizes.items()}
    proposals: dict[int, list[tuple[float, Candidate]]] = {member: [] for member in transforms}
    for pair, resistance in zip(pairs, _resistances(list(transforms), valid, pairs), strict=True):
        gain = float(shares[pair] * full_overlap_ties * resistance)
        smaller, larger = sorted(area[member] for member in pair)
        same = shares[pair] * smaller > SAME_OVERLAP * larger
        if gain >= (MIN_GAIN_OF_SAME if same else MIN_GAIN):
            for member in pair:
                proposals[member].append((gain, pair))
    return {pair for offers in proposals.values() for _, pair in sorted(offers, reverse=True)[:MAX_PREDICTED]}


def _resistances(members: Sequence[int], links: Mapping[Candidate, Link], pairs: Sequence[Candidate]) -> Array:
    """Resistance between the members of each pair, (P,), in a connected network of links.

    Few photographs are linked with each, so the network's matrix is factored as a sparse one, and its inverse is
    computed some columns at a time: memory grows with the photographs, not with their square.
    """
    row = {member: index for index, member in enumerate(members)}
    ends = np.array([[row[left], row[right]] for left, right in links]).T
    ties = [float(link.ties) for link in links.values()]
    conductance = sparse.coo_array((ties, ends), shape=(len(row), len(row))).tocsr()
    conductance += conductance.T
    laplacian = sparse.diags_array(conductance.sum(axis=0)) - conductance
    # The potentials are free by a constant: that of the first member is 0.
    factors = factor_symmetric(laplacian.tocsc()[1:, 1:])
    left, right = np.array([[row[one], row[other]] for one, other in pairs], dtype=np.intp).reshape(-1, 2).T
    own, mutual = np.zeros(len(row)), np.zeros(len(left))
    for start in range(1, len(row), COLUMNS_AT_ONCE):
        current = np.eye(len(row) - 1, min(COLUMNS_AT_ONCE, len(row) - start), 1 - start)
        potential = np.vstack((np.zeros(current.shape[1]), factors.solve(current)))
        own[start : start + COLUMNS_AT_ONCE] = potential[start:].diagonal()
        here = (left >= start) & (left < start + COLUMNS_AT_ONCE)
        mutual[here] = potential[right[here], left[here] - start]
    return own[left] + own[right] - 2 * mutual
