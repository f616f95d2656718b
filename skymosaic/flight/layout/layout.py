"""Layout of a flight: groups of linked views, a first pose of each view on the ground, and its refinement."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow, minimum_spanning_tree

from golden_model.arrays import Array
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.layout.accuracy import Accuracy, measure_accuracy
from skymosaic.flight.layout.adjustment import MODELS, WIDEST_SCALE_PX, Network, Ties
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply, estimate

GOOD_ENOUGH = 1.05
"""A simpler model is taken if its error is at most this many times that of the best model."""
FALSE_LINK_PX = 10.0
"""A link whose median error stays above this contradicts the others."""
ROUGH_STEPS = 4
OPEN_LOOP = 0.1
"""How far apart the ends of a loop of three links lie that counts a quarter, in half diagonals of a view."""
TILTED_SCALE_PX = 25.0
"""Scale from which homographies are annealed: the simpler models leave so much of a tilt."""
ANNEALED_TIES_PER_LINK = 20
"""Enough to see which links hold together."""
MAX_TIES_PER_LINK = 200
"""More ties per link change a layout by less than it is off, but take longer."""


@dataclass(frozen=True, eq=False)
class Layout:
    """One group of linked views and their transformations to the ground.

    Attributes
    ----------
    members : tuple of int
        Indices of the views, rising.
    reference : int
        Index of the most connected view. The ground's frame is that of this view without its tilt; for two
        photographs, that of the right one.
    transforms : dict of int to ndarray, shape (3, 3)
        Working pixels of each member to ground pixels, which are the reference's working pixels.
    links : tuple of Link
        Links among the members that agree with the layout.
    contradicting : tuple of Link
        Links among the members that disagree with it.
    errors_px : tuple of ndarray
        Reprojection error of each tie of each of ``links``, in working pixels of the right view.
    model : str
        A key of `skymosaic.flight.layout.adjustment.MODELS`.
    reason : str
        Why that model.
    """

    members: tuple[int, ...]
    reference: int
    transforms: dict[int, Array]
    links: tuple[Link, ...] = ()
    contradicting: tuple[Link, ...] = ()
    errors_px: tuple[Array, ...] = ()
    model: str = "similarity"
    reason: str = "a single view"

    @cached_property
    def accuracy(self) -> Accuracy | None:
        """Errors of the matches that the layout did not use; None where none were kept aside, as of a pair."""
        return measure_accuracy(self.transforms, (*self.links, *self.contradicting))

    @property
    def median_error_px(self) -> float:
        """Median error of all ties, which says how well the layout fits them; 0 for a single view."""
        return float(np.median(np.concatenate(self.errors_px))) if self.errors_px else 0.0

    def to_reference(self, views: Sequence[View]) -> dict[int, Array]:
        """Original pixels of each member to original pixels of the reference, (3, 3) each."""
        frame = views[self.reference].to_original
        return {m: frame @ self.transforms[m] @ np.linalg.inv(views[m].to_original) for m in self.members}

    @property
    def relief(self) -> float:
        """Share of the matches near the links' homographies that lie 3 to 12 px off the plane, 0..1; 0 is flat."""
        near = sum(link.near for link in self.links)
        return 1 - sum(link.ties for link in self.links) / near if near else 0.0


def groups(count: int, links: Sequence[Link]) -> list[list[int]]:
    """Group the views that links join directly or through others, the largest group first."""
    inliers = _inlier_matrix(count, [(link.left, link.right) for link in links], links)
    _, label = connected_components(inliers, directed=False)
    parts = [np.flatnonzero(label == group).tolist() for group in range(int(label.max()) + 1)]
    return sorted(parts, key=lambda members: (-len(members), members[0]))


def lay_out(views: Sequence[View], members: Sequence[int], links: Sequence[Link]) -> Layout:
    """Lay out one group of linked views; the model is chosen by its error on held-out ties.

    Views that a single link joins to the others while another link contradicts it are left out: either may be false.

    Parameters
    ----------
    views : sequence of View
        All views of the flight.
    members : sequence of int
        The group, rising.
    links : sequence of Link
        Links that hold; those outside the group are ignored.
    """
    if len(members) == 1:
        return Layout(tuple(members), members[0], {members[0]: np.eye(3)})
    group = linked_group(views, members, links)
    model, reason, start = _choose_model(group)
    network = group.network(slice(None))
    refined = network.adjust(start, model)
    false: list[Link] = []
    while contradicting := _contradicting(group, network.errors_px(refined)):
        false += contradicting
        kept = [link for link in group.links if link not in contradicting]
        group = LinkedGroup(group.sizes, kept, group.reference)
        network = group.network(slice(None))
        # What contradicts weighed next to nothing, so this goes on from where it is.
        refined = network.adjust(refined, model)
    if doubtful := _doubtful_part(group, false):
        # With all links: what contradicts may put another part in doubt.
        return lay_out(views, [member for member in members if member not in doubtful], links)
    return Layout(
        members=tuple(members),
        reference=members[group.reference],
        transforms=group.to_ground(refined),
        links=tuple(group.links),
        contradicting=tuple(false),
        errors_px=tuple(network.errors_px(refined)),
        model=model,
        reason=reason,
    )


def rough_transforms(views: Sequence[View], members: Sequence[int], links: Sequence[Link]) -> dict[int, Array]:
    """Similarities, as `Layout.transforms`, exact enough to predict which views overlap."""
    group = linked_group(views, members, links)
    return group.to_ground(group.start)


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
            weights = _inlier_matrix(len(sizes), self._pairs, self.links)
            reference = int(np.argmax((weights + weights.T).sum(axis=0)))
        self.reference = reference

    @cached_property
    def start(self) -> Array:
        """Similarities (V, 3, 3) chained from the reference along strong links that loops confirm, then annealed."""
        if not self.links:
            return np.tile(np.eye(3), (len(self.members), 1, 1))
        motions = [estimate(tie.left_points, tie.right_points, model="similarity") for tie in self._ties()]
        pairs = {pair: row for row, pair in enumerate(self._pairs)}
        # The spanning tree is that of the least cost: one false link in it would displace all that hangs on it.
        strength = np.array([link.inliers for link in self.links]) * trust_by_loops(pairs, motions)
        cost = csr_array((1 / strength, np.array(list(pairs)).T), shape=(len(self.members),) * 2)
        order, parents = breadth_first_order(minimum_spanning_tree(cost), self.reference, directed=False)
        transforms = np.tile(np.eye(3), (len(self.members), 1, 1))
        for view, parent in zip(order[1:], parents[order[1:]], strict=True):
            motion = motions[pairs[min(view, parent), max(view, parent)]]
            transforms[view] = transforms[parent] @ (motion if view < parent else np.linalg.inv(motion))
        network = self.network(slice(None), ANNEALED_TIES_PER_LINK)
        return network.adjust(transforms, "similarity", max_steps=ROUGH_STEPS, from_px=WIDEST_SCALE_PX)

    def network(self, chosen: slice, max_ties: int | None = MAX_TIES_PER_LINK, distortion: float = 0.0) -> Network:
        """Build the network of every link's ties, or of some of them.

        Parameters
        ----------
        chosen : slice
            Which of the considered ties are taken.
        max_ties : int or None
            Ties per link that are considered, spread evenly; None: all.
        distortion : float
            Distortion of the lens, see `skymosaic.flight.layout.motions.straighten`.
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


def trust_by_loops(pairs: Mapping[tuple[int, int], int], motions: Sequence[Array]) -> Array:
    """How far loops of three links confirm each of them: 0.01 for a link in no loop, 1.5 where two of two close, (L,).

    Parameters
    ----------
    pairs : mapping of (int, int) to int
        Rows of the links by their two views, the smaller first.
    motions : sequence of ndarray, shape (3, 3)
        The similarity of each link, left to right, normalised coordinates.
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
        there, on, direct = (np.stack(motions)[rows[:, side]] for side in range(3))
        gap = np.linalg.inv(direct) @ on @ there - np.eye(3)
        offset = np.linalg.norm(gap[:, :2, :2], axis=(1, 2)) / 2 + np.linalg.norm(gap[:, :2, 2], axis=1)
        for side in range(3):
            np.add.at(closed, rows[:, side], 1 / (1 + (offset / OPEN_LOOP) ** 2) ** 2)
            np.add.at(count, rows[:, side], 1.0)
    # Few loops close by chance, so one that does says more than several that another false link keeps open.
    return np.asarray(closed**2 / count)


def linked_group(
    views: Sequence[View], members: Sequence[int], links: Sequence[Link], reference: int | None = None
) -> LinkedGroup:
    """Collect the sizes and ties of some of the views of a flight; ``reference`` is the view that stays, None: any."""
    row = None if reference is None else list(members).index(reference)
    return LinkedGroup({member: views[member].working_size for member in members}, links, row)


def outline(view: View, transform: Array) -> Array:
    """Corners (4, 2) of a view under a transformation of its working pixels."""
    return apply(transform, Canvas(0, 0, *view.working_size).corners)


def overlap(one: Array, other: Array) -> float:
    """Common area of two convex outlines (4, 2), as a share of the smaller."""
    one, other = one.astype(np.float32), other.astype(np.float32)
    area, _ = cv2.intersectConvexConvex(one, other)
    return float(area) / max(min(cv2.contourArea(one), cv2.contourArea(other)), 1.0)


def _inlier_matrix(count: int, pairs: Sequence[tuple[int, int]], links: Sequence[Link]) -> csr_array:
    """Inliers of the link of each pair, as a (count, count) matrix, upper triangle."""
    rows, columns = [left for left, _ in pairs], [right for _, right in pairs]
    return csr_array(([float(link.inliers) for link in links], (rows, columns)), shape=(count, count))


def normalisation(size: tuple[int, int]) -> Array:
    """Pixels of an image of ``size`` to coordinates about its centre, in half diagonals, (3, 3)."""
    half_px = float(np.hypot(*size)) / 2
    x, y = (size[0] - 1) / 2, (size[1] - 1) / 2
    return np.array([[1 / half_px, 0, -x / half_px], [0, 1 / half_px, -y / half_px], [0, 0, 1]])


def _choose_model(group: LinkedGroup) -> tuple[str, str, Array]:
    """The simplest model that is about as good as the best, the reason, and its transformations.

    Every second tie is fitted; the error is measured on the others.
    """
    fitted, held_out = group.network(slice(0, None, 2)), group.network(slice(1, None, 2))
    transforms, errors, fits = group.start, {}, {}
    # Each model starts from the simpler one's result, which lies nearer than the chain of similarities.
    for model in MODELS:
        from_px = TILTED_SCALE_PX if model == "homography" else 0.0
        transforms = fits[model] = fitted.adjust(transforms, model, from_px=from_px)
        errors[model] = float(np.median(np.concatenate(held_out.errors_px(transforms))))
    chosen = next(model for model in MODELS if errors[model] <= GOOD_ENOUGH * min(errors.values()))
    measured = ", ".join(f"{model} {error:.2f} px" for model, error in errors.items())
    return chosen, f"median error of held-out ties: {measured}", fits[chosen]


def _contradicting(group: LinkedGroup, errors_px: Sequence[Array]) -> list[Link]:
    """The links that the layout does not explain, without those that alone join parts of the group."""
    middle_px = {link: float(np.median(error)) for link, error in zip(group.links, errors_px, strict=True)}
    row = {member: index for index, member in enumerate(group.members)}
    kept = [link for link in group.links if middle_px[link] <= FALSE_LINK_PX]
    _, part = connected_components(_joined(group, kept), directed=False)
    false = []
    # Where parts would fall apart, the least wrong links between them stay.
    for link in sorted(group.links, key=middle_px.__getitem__)[len(kept) :]:
        one, other = part[row[link.left]], part[row[link.right]]
        if one == other:
            false.append(link)
        part[part == other] = one
    return false


def _doubtful_part(group: LinkedGroup, false: Sequence[Link]) -> set[int]:
    """The smaller one of two parts of a group that a single link joins and another contradicts; empty without such."""
    row = {member: index for index, member in enumerate(group.members)}
    joined = _joined(group, group.links)
    for link in false:
        flow = maximum_flow(joined, row[link.left], row[link.right])
        if flow.flow_value > 1:
            continue
        # What each end still reaches once the one link, or one of several in a row, carries all that it can.
        spare = csr_array(joined - flow.flow)
        spare.eliminate_zeros()
        sides = [
            breadth_first_order(residual, row[end], return_predecessors=False)
            for residual, end in ((spare, link.left), (csr_array(spare.T), link.right))
        ]
        return {group.members[index] for index in min(sides, key=len).tolist()}
    return set()


def _joined(group: LinkedGroup, links: Sequence[Link]) -> csr_array:
    """Which members of a group some of its links join, as a symmetric matrix of 0 and 1."""
    row = {member: index for index, member in enumerate(group.members)}
    pairs = np.array([(row[link.left], row[link.right]) for link in links], dtype=np.intp).reshape(-1, 2)
    joined = csr_array((np.ones(len(pairs), dtype=np.int32), pairs.T), shape=(len(row),) * 2)
    return csr_array(joined + joined.T)
