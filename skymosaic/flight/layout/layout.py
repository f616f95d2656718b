"""Layout of a flight: the pose of each view on the ground, by the links, and which of both contradict it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse.csgraph import connected_components

from golden_model.arrays import Array, Points
from skymosaic.compositing.mesh import Judged, Mesh
from skymosaic.flight.layout.accuracy import Accuracy, measure_accuracy
from skymosaic.flight.layout.adjustment import MODELS, WIDEST_SCALE_PX, Network
from skymosaic.flight.layout.agreement import Agreement
from skymosaic.flight.layout.extent import find_misplaced
from skymosaic.flight.layout.linked_group import LinkedGroup, groups, join, linked_group, separate
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply

GOOD_ENOUGH = 1.05
"""A simpler model is taken if its error is at most this many times that of the best model."""
FALSE_LINK_PX = 10.0
"""A link whose median error stays above this contradicts the others."""
SURER = 2
"""A link is not put in doubt by one that it has so many times the inliers of: a dozen agree by chance."""
MAX_FALSE_SHARE = 0.1
"""Share of contradicting links above which no ground explains a layout that is also `FALSE_LINK_PX` off: real flights
over relief have 3 %, rows of solar panels that all look the same 25 %."""
MAX_RELIEF = 1 / 3
"""Share of the matches off the plane above which the scene is none: flights over villages have up to a quarter."""
TILTED_SCALE_PX = 25.0
"""Scale from which homographies are annealed: the simpler models leave so much of a tilt."""


@dataclass(frozen=True, eq=False)
class Layout:
    """One group of linked views and their transformations to the ground."""

    members: tuple[int, ...]
    """Indices of the views, rising."""
    reference: int
    """Index of the most connected view. The ground's frame is that of this view without its tilt; for two photographs,
    that of the right one."""
    transforms: dict[int, Array]
    """(3, 3) each: working pixels of a member to ground pixels, which are the reference's working pixels."""
    links: tuple[Link, ...] = ()
    """Links among the members that agree with the layout."""
    contradicting: tuple[Link, ...] = ()
    """Links among the members that disagree with it."""
    errors_px: tuple[Array, ...] = ()
    """Reprojection error of each tie of each of ``links``, in working pixels of the right view."""
    model: str = "similarity"
    """A key of `skymosaic.flight.layout.adjustment.MODELS`."""
    reason: str = "a single view"
    """Why that model."""
    misplaced: dict[int, str] = field(default_factory=dict)
    """Views of the group that cannot lie where a layout puts them, with the reason."""
    bent: tuple[float, float] | None = None
    """Where photographs are warped by meshes: the share of held-out matches within 2 px without and with them."""
    meshes: dict[int, Mesh] = field(default_factory=dict)
    """By member, what warps its photograph before ``transforms`` apply; none where it keeps its shape."""
    agreement: Agreement = field(default_factory=Agreement)
    """Whether the ground of its views agrees where they lie on each other."""
    apart: str = ""
    """Why links to another group are false, if the ground contradicts them; else empty."""

    def without(self, absent: Collection[int]) -> "Layout":
        """The same places without some of the views."""
        members = tuple(member for member in self.members if member not in absent)
        rows = [row for row, link in enumerate(self.links) if {link.left, link.right}.isdisjoint(absent)]
        return replace(
            self,
            members=members,
            reference=self.reference if self.reference in members else next(iter(members), self.reference),
            transforms={member: self.transforms[member] for member in members},
            meshes={member: mesh for member, mesh in self.meshes.items() if member in members},
            links=tuple(self.links[row] for row in rows),
            contradicting=tuple(link for link in self.contradicting if {link.left, link.right}.isdisjoint(absent)),
            errors_px=tuple(self.errors_px[row] for row in rows),
            agreement=self.agreement.without(absent),
        )

    @cached_property
    def accuracy(self) -> Accuracy | None:
        """Errors of the matches that the layout did not use; None where none were kept aside, as of a pair."""
        return measure_accuracy(self.transforms, (*self.links, *self.contradicting))

    @property
    def fault(self) -> str:
        """Why the views do not show one ground; empty if they may."""
        false, count = len(self.contradicting), len(self.links) + len(self.contradicting)
        # Rarely so many, and only then what measuring costs.
        if false <= MAX_FALSE_SHARE * count or self.accuracy is None:
            return ""
        off_px = self.accuracy.whole.median_px
        if off_px <= FALSE_LINK_PX:
            return ""
        return (
            f"{false} of {count} links contradict the layout, and matches that it did not use are {off_px:.0f} px off "
            "in the median: things that look the same are taken for one, or there are several places; give those of one"
        )

    @property
    def median_error_px(self) -> float:
        """Median error of all ties, which says how well the layout fits them; 0 for a single view."""
        return float(np.median(np.concatenate(self.errors_px))) if self.errors_px else 0.0

    def to_reference(self, views: Sequence[View]) -> dict[int, Array]:
        """Original pixels of each member to original pixels of the reference, (3, 3) each."""
        frame = views[self.reference].to_original
        return {m: frame @ self.transforms[m] @ np.linalg.inv(views[m].to_original) for m in self.members}

    def with_meshes(self, meshes: dict[int, Mesh], judged: Judged) -> "Layout":
        """The same layout with meshes, and with what is gained by them; as it is without meshes."""
        if not meshes:
            return self
        return replace(self, bent=(judged.plain / judged.matches, judged.warped / judged.matches), meshes=meshes)

    def bend(self, member: int, view: View, points: Points) -> Points:
        """Where the photograph of a member, warped by its mesh, shows points (N, 2) of it; original px."""
        if member not in self.meshes:
            return points
        to_working = np.asarray(np.linalg.inv(view.to_original))
        return apply(view.to_original, self.meshes[member].find(apply(to_working, points)))

    @property
    def relief(self) -> float:
        """Share of the matches near the links' homographies that lie 3 to 12 px off the plane, 0..1; 0 is flat."""
        near = sum(link.near for link in self.links)
        return 1 - sum(link.ties for link in self.links) / near if near else 0.0


def lay_out(
    views: Sequence[View], members: Sequence[int], links: Sequence[Link], before: Layout | None = None
) -> Layout:
    """Lay out one group of linked views; the model is chosen by its error on held-out ties.

    Views that a single link joins to the others while another link contradicts it are left out: either may be false,
    unless one is far surer. So are views that cannot lie where the layout puts them. ``members`` are the group, rising;
    ``links`` are those that hold, of which those outside the group are ignored. ``before`` is a layout of all members
    by other links, from which this one starts.
    """
    misplaced: dict[int, str] = {}
    overruled: list[Link] = []
    while len(members) > 1:
        layout = _lay_out_together(views, members, links, overruled, before)
        absent, weaker = _doubtful_part(layout)
        if weaker:
            # It fell for that one, so it is no place to go on from.
            before = None
            overruled.append(weaker)
            links = [link for link in links if link is not weaker]
            continue
        if not absent:
            found = find_misplaced(views, layout.transforms, layout.links, layout.errors_px)
            if not found:
                return replace(layout, misplaced=misplaced)
            misplaced |= found
            absent = set(found)
        # With all links: what contradicts may put another part in doubt.
        rest = set(members) - absent
        inside = [link for link in links if rest.issuperset((link.left, link.right))]
        members = next(part for part in groups(len(views), inside) if rest.issuperset(part))
        before = layout
    alone = members[0]
    return Layout((alone,), alone, {alone: np.eye(3)}, misplaced=misplaced)


def _lay_out_together(
    views: Sequence[View],
    members: Sequence[int],
    links: Sequence[Link],
    overruled: Sequence[Link],
    before: Layout | None = None,
) -> Layout:
    """Lay out a group as a whole; links that contradict the others have no part in it, nor have those overruled."""
    group = linked_group(views, members, links)
    network = group.network(slice(None))
    if before is not None:
        model, reason = before.model, before.reason
        refined = network.adjust(group.from_ground(before.transforms, before.reference), model)
    # Models and scales from far away are tried again only where more links contradict than did before.
    if before is None or _count_false(network, refined) > len(before.contradicting):
        model, reason, start = _choose_model(group)
        model, refined = _refine(network, model, start, group.start)
    false = [link for link in overruled if {link.left, link.right} <= set(members)]
    while contradicting := _contradicting(group, network.errors_px(refined)):
        false += contradicting
        kept = [link for link in group.links if link not in contradicting]
        group = LinkedGroup(group.sizes, kept, group.reference)
        network = group.network(slice(None))
        # What contradicts weighed next to nothing, so this goes on from where it is.
        refined = network.adjust(refined, model)
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


def _refine(network: Network, model: str, start: Array, similarities: Array) -> tuple[str, Array]:
    """Fit a model to all ties from where it is; if links contradict that, homographies once more from farther away.

    Where cameras lean much, the simpler models are so far off that links which do hold weigh nothing. Copies of a
    photograph, which any model explains, may even have chosen one of these.
    """
    fits = [(model, network.adjust(start, model))]
    if not _count_false(network, fits[0][1]):
        return fits[0]
    for far in (similarities, fits[0][1]):
        fits.append(("homography", network.adjust(far, "homography", from_px=WIDEST_SCALE_PX)))
    return min(fits, key=lambda fit: (_count_false(network, fit[1]), network.cost(*fit)))


def _count_false(network: Network, transforms: Array) -> int:
    return sum(not float(np.median(error)) <= FALSE_LINK_PX for error in network.errors_px(transforms))


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
    _, part = connected_components(join(group.members, kept, [1] * len(kept)), directed=False)
    false = []
    # Where parts would fall apart, the least wrong links between them stay.
    for link in sorted(group.links, key=middle_px.__getitem__)[len(kept) :]:
        one, other = part[row[link.left]], part[row[link.right]]
        if one == other:
            false.append(link)
        part[part == other] = one
    return false


def _doubtful_part(layout: Layout) -> tuple[set[int], Link | None]:
    """The smaller one of two parts that a single link joins and another contradicts; empty without such.

    A link that is far surer than the one that contradicts it joins them as well as two do. Where it is the one that
    contradicts, the layout fell for the weaker one, which is returned as well.
    """
    row = {member: index for index, member in enumerate(layout.members)}
    for link in sorted(layout.contradicting, key=lambda each: -each.inliers):
        joined = join(layout.members, layout.links, [1 + (e.inliers >= SURER * link.inliers) for e in layout.links])
        strength, sides = separate(joined, row[link.left], row[link.right])
        if strength > 1:
            continue
        part = {layout.members[index] for index in min(sides, key=len)}
        joint = next(each for each in layout.links if (each.left in part) != (each.right in part))
        return part, joint if link.inliers >= SURER * joint.inliers else None
    return set(), None
