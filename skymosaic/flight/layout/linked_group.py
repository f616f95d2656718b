"""Groups of linked views: their ties in common coordinates, and a first pose of each view on the ground."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property, lru_cache

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow, minimum_spanning_tree

from golden_model.arrays import Array
from skymosaic.compositing.mesh import Ties
from skymosaic.flight.layout.adjustment import WIDEST_SCALE_PX, Network
from skymosaic.flight.layout.expected_shape import are_possible
from skymosaic.flight.layout.motions import NO_DISTORTION
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import DegenerateError, apply, estimate_similarity

ROUGH_STEPS = 4
OPEN_LOOP = 0.1
"""How far apart the ends of a loop of three links lie that counts a quarter, in half diagonals of a view."""
ANNEALED_TIES_PER_LINK = 20
"""Enough to see which links hold together."""
MAX_TIES_PER_LINK = 200
"""More ties per link change a layout by less than it is off, but take longer."""
# Pairs are predicted, a lens is estimated and a layout is made from the start of the same group.
_collect = lru_cache(maxsize=1)(lambda sizes, links, row: LinkedGroup(dict(sizes), links, row))


def groups(count: int, links: Sequence[Link]) -> list[list[int]]:
    """Group the views that links join directly or through others, the largest group first."""
    _, label = connected_components(join(range(count), links, [1] * len(links)), directed=False)
    parts = [np.flatnonzero(label == group).tolist() for group in range(int(label.max()) + 1)]
    return sorted(parts, key=lambda members: (-len(members), members[0]))


def join(members: Sequence[int], links: Sequence[Link], strengths: Sequence[int]) -> csr_array:
    """Join members of a group by some of its links: how strongly each two, as a symmetric matrix; 0 without a link."""
    row = {member: index for index, member in enumerate(members)}
    pairs = np.array([(row[link.left], row[link.right]) for link in links], dtype=np.intp).reshape(-1, 2)
    joined = csr_array((np.array(strengths, dtype=np.int32), pairs.T), shape=(len(row),) * 2)
    return csr_array(joined + joined.T)


def separate(joined: csr_array, one: int, other: int) -> tuple[int, list[list[int]]]:
    """The strength of the weakest links between two rows of what `join` returns, and what each still reaches without.

    Parts behind one link, or behind one of several in a row, are those beyond the nearest of these.
    """
    flow = maximum_flow(joined, one, other)
    # What each end still reaches once the links carry all that they can.
    spare = csr_array(joined - flow.flow)
    spare.eliminate_zeros()
    ends = ((spare, one), (csr_array(spare.T), other))
    sides = [breadth_first_order(residual, end, return_predecessors=False).tolist() for residual, end in ends]
    return int(flow.flow_value), sides


class LinkedGroup:
    """Linked views, renumbered from 0, and their ties in normalised coordinates.

    Parameters
    ----------
    sizes : mapping of int to (int, int)
        Width and height of each view of the group, working px, by its index.
    links : sequence of Link
        Links that hold; those outside the group are ignored.
    reference : int or None
        Row of the view whose position, rotation and scale stay fixed; None: the most connected one.
    """

    def __init__(
        self, sizes: Mapping[int, tuple[int, int]], links: Sequence[Link], reference: int | None = None
    ) -> None:
        row = {member: index for index, member in enumerate(sizes)}
        self.links = [link for link in links if link.left in row and link.right in row]
        self.sizes = sizes
        self.members = tuple(sizes)
        self.normalisations = [normalisation(size) for size in sizes.values()]
        self.units_px = [1 / float(matrix[0, 0]) for matrix in self.normalisations]
        self._pairs = [(row[link.left], row[link.right]) for link in self.links]
        if reference is None:
            inliers = join(self.members, self.links, [link.inliers for link in self.links])
            reference = int(np.argmax(inliers.sum(axis=0)))
        self.reference = reference

    @cached_property
    def start(self) -> Array:
        """Similarities (V, 3, 3) chained from the reference along strong links that loops confirm, then annealed."""
        if not self.links:
            return np.tile(np.eye(3), (len(self.members), 1, 1))
        motions = np.tile(np.eye(3), (len(self.links), 1, 1))
        for motion, tie in zip(motions, self._ties(), strict=True):
            # Ties that coincide tell nothing of turn and size.
            with suppress(DegenerateError):
                motion[:] = estimate_similarity(tie.left_points, tie.right_points)
        motions[~are_possible(motions)] = np.eye(3)
        pairs = {pair: row for row, pair in enumerate(self._pairs)}
        # The spanning tree is that of the least cost: one false link in it would displace all that hangs on it.
        strength = np.array([link.inliers for link in self.links]) * trust_by_loops(pairs, motions)
        cost = csr_array((1 / strength, np.array(list(pairs)).T), shape=(len(self.members),) * 2)
        order, parents = breadth_first_order(minimum_spanning_tree(cost), self.reference, directed=False)
        transforms = np.tile(np.eye(3), (len(self.members), 1, 1))
        for view, parent in zip(order[1:], parents[order[1:]], strict=True):
            motion = motions[pairs[min(view, parent), max(view, parent)]]
            place = transforms[parent] @ (motion if view < parent else np.linalg.inv(motion))
            transforms[view] = place if are_possible(place[None]) else transforms[parent]
        network = self.network(slice(None), ANNEALED_TIES_PER_LINK)
        return network.adjust(transforms, "similarity", max_steps=ROUGH_STEPS, from_px=WIDEST_SCALE_PX)

    def network(
        self, chosen: slice, max_ties: int | None = MAX_TIES_PER_LINK, distortion: Array = NO_DISTORTION
    ) -> Network:
        """Build the network of every link's ties, or of some of them, with a distortion of the lens, see `Network`.

        Of each link, ``max_ties`` are considered, spread evenly (None: all), and those that are ``chosen`` are taken.
        """
        return Network(self._ties(chosen, max_ties), self.units_px, self.reference, distortion)

    def _ties(self, chosen: slice = slice(None), max_ties: int | None = None) -> Iterator[Ties]:
        """Normalise the ties of one link after the other: together, they would take as much memory as the links."""
        for link, (left, right) in zip(self.links, self._pairs, strict=True):
            rows = np.linspace(0, link.ties - 1, min(link.ties, max_ties or link.ties)).astype(np.intp)[chosen]
            left_points = apply(self.normalisations[left], link.left_points[rows])
            yield Ties(left, right, left_points, apply(self.normalisations[right], link.right_points[rows]))

    def to_ground(self, transforms: Array) -> dict[int, Array]:
        """Convert transformations (V, 3, 3) of normalised coordinates to those of pixels, by view."""
        to_pixels = np.linalg.inv(self.normalisations[self.reference])
        rows = zip(self.members, transforms, self.normalisations, strict=True)
        return {member: to_pixels @ transform @ normalised for member, transform, normalised in rows}

    def from_ground(self, transforms: Mapping[int, Array], reference: int) -> Array:
        """Convert what `to_ground` returned, of another reference maybe, to normalised coordinates (V, 3, 3)."""
        placed = np.array([transforms[member] for member in self.members]) @ np.linalg.inv(self.normalisations)
        placed = self.normalisations[self.reference] @ placed / placed[:, 2:, 2:]
        if reference == self.members[self.reference]:
            return np.asarray(placed)
        # Position, turn and size of the whole are those of the middle of the reference.
        tilted = placed[self.reference]
        (a, b), (c, d) = (tilted[:2, :2] - np.outer(tilted[:2, 2], tilted[2, :2])) / 2
        frame = np.array([[a + d, b - c, tilted[0, 2]], [c - b, a + d, tilted[1, 2]], [0, 0, 1]])
        return np.asarray(np.linalg.inv(frame) @ placed)


def trust_by_loops(pairs: Mapping[tuple[int, int], int], motions: Array) -> Array:
    """How far loops of three links confirm each of them: 0.01 for a link in no loop, 1.5 where two of two close, (L,).

    ``pairs`` are the rows of the links by their two views, the smaller first; ``motions`` (L, 3, 3) their similarities,
    left to right, in normalised coordinates.
    """
    neighbours: dict[int, set[int]] = {}
    for left, right in pairs:
        neighbours.setdefault(left, set()).add(right)
        neighbours.setdefault(right, set()).add(left)
    loops = [
        (row, pairs[right, third], pairs[left, third])
        for (left, right), row in pairs.items()
        for third in sorted(neighbours[left] & neighbours[right])
        if third > right
    ]
    closed, count = np.full(len(pairs), 0.1), np.ones(len(pairs))
    if loops:
        rows = np.array(loops)
        there, on, direct = (motions[rows[:, side]] for side in range(3))
        gap = np.linalg.inv(direct) @ on @ there - np.eye(3)
        offset = np.linalg.norm(gap[:, :2, :2], axis=(1, 2)) / 2 + np.linalg.norm(gap[:, :2, 2], axis=1)
        for side in range(3):
            np.add.at(closed, rows[:, side], 1 / (1 + (offset / OPEN_LOOP) ** 2) ** 2)
            np.add.at(count, rows[:, side], 1.0)
    # Few loops close by chance, so one that does says more than several that another false link keeps open.
    return np.asarray(closed**2 / count)


def linked_group(
    views: Sequence[View] | Mapping[int, View],
    members: Sequence[int],
    links: Sequence[Link],
    reference: int | None = None,
) -> LinkedGroup:
    """Collect the sizes and ties of some of the views of a flight; ``reference`` is the view that stays, None: any."""
    row = None if reference is None else list(members).index(reference)
    return _collect(tuple((member, views[member].working_size) for member in members), tuple(links), row)


def normalisation(size: tuple[int, int]) -> Array:
    """Pixels of an image of ``size`` to coordinates about its centre, in half diagonals, (3, 3)."""
    half_px = float(np.hypot(*size)) / 2
    x, y = (size[0] - 1) / 2, (size[1] - 1) / 2
    return np.array([[1 / half_px, 0, -x / half_px], [0, 1 / half_px, -y / half_px], [0, 0, 1]])
