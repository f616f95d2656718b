"""Whether the ground agrees where photographs lie on each other in a layout, linked or not.

Links are what matched. Ground that lies on other ground and differs has none, so it takes a look to tell a layout that
is false from one that is right. Crowns of trees, water, walls and displays differ in any two photographs. So a patch of
a photograph counts only if it is recognised: if it looks the same in any of those that the layout lays over it.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree

from golden_model.arrays import Array, Float32, Points
from golden_model.pixel.gray import to_gray
from skymosaic.flight.layout.extent import overlaps
from skymosaic.flight.layout.linked_group import groups, join
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.ground import band_pass
from skymosaic.geometry.homography import apply

MIN_OVERLAP = 0.5
"""Photographs that share less, as a share of the smaller, have too few patches in common to be compared."""
MAX_COMPARED = 16
"""Later photographs that each one is compared with. Where more lie on it, they show one place, and at most half as many
are compared, spread over all of them."""
PATCH_PX, STEP_PX, REACH_PX = 48, 40, 12
"""Side of a patch of a thumbnail, distance to the next one, and how far relief may move it."""
LIGHT_PX, OUTSIDE = 8.0, 1e4
"""Sigma of the band-pass: coarser differences are those of light. A value that it never has marks what is not shown."""
MIN_CONTRAST, SAME, DIFFERENT = 1.5, 0.6, 0.25
"""Gray levels (standard deviation) of a patch with texture, and correlation of patches that show the same, or what has
nothing in common: the best place near a wrong one reaches 0.2 in the middle, on all public flights."""
MIN_RECOGNISED, MIN_SAME = 4, 0.2
"""Patches of two photographs that are recognised, without which they cannot tell, and the share of these that must be
the same: under a kite over buildings 0.3 at least, in a false layout mostly none."""
FALSE_JOINT, WITHIN = 0.08, 4
"""A joint is false where a larger share of the recognised patches is different across it, and so many times the share
within its sides (text on a display, cars) more than that: 0.05 for the worst of a kite's true joints over buildings;
false ones by a twin of 0.6 of a photograph 0.15 at least, of 0.7 mostly 0.12."""
REPEATED = 0.9
"""Correlation of the middle of a thumbnail with its best other place above which the ground repeats itself: façades of
equal windows have 0.94 in the middle, 0.86 at least; of public flights one of crop rows, with 0.62 in the middle."""


@dataclass(frozen=True)
class GroundOfPair:
    """What two photographs that lie on each other have in common."""

    same: int
    recognised: int
    """Patches of either that are the same in the other one, of those that are recognised."""
    off_px: float
    """How far these are from where the layout puts them, median, working px of the right view."""
    different: int
    """Recognised patches that have nothing in common with the other one, beyond the ties of both."""
    repeats: bool = False
    """Whether each of both looks the same a step aside, so that what is the same tells nothing."""

    @property
    def agrees(self) -> bool | None:
        """Whether the ground agrees; None if too little of it can tell."""
        same = self.same >= MIN_SAME * self.recognised
        return None if self.recognised < MIN_RECOGNISED or (same and self.repeats) else same


UNKNOWN = GroundOfPair(0, 0, np.inf, 0)


@dataclass(frozen=True, eq=False)
class Agreement:
    """The pairs of photographs of a layout that lie on each other."""

    pairs: dict[Candidate, GroundOfPair] = field(default_factory=dict)

    def of(self, agrees: bool | None) -> list[Candidate]:
        """The pairs that agree, that do not, or that cannot tell."""
        return [pair for pair, ground in self.pairs.items() if ground.agrees is agrees]

    @property
    def repeated(self) -> list[Candidate]:
        """The pairs that would agree as well if they lay elsewhere."""
        grounds = self.pairs
        return [pair for pair in self.of(None) if grounds[pair].repeats and grounds[pair].recognised >= MIN_RECOGNISED]

    def without(self, absent: Collection[int]) -> "Agreement":
        """The same without some of the views."""
        return Agreement({pair: ground for pair, ground in self.pairs.items() if not set(pair) & set(absent)})

    @property
    def numbers(self) -> dict[str, float | None]:
        """How many pairs agree or not, and how far nine in ten that tell are off, px; None where more disagree."""
        agree, disagree, unknown = (self.of(agrees) for agrees in (True, False, None))
        off_px = [self.pairs[pair].off_px for pair in agree] + [np.inf] * len(disagree)
        ninety_px = float(np.percentile(off_px, 90, method="higher")) if off_px else np.inf
        counts = {"agree": len(agree), "disagree": len(disagree), "cannot_tell": len(unknown)}
        return {**counts, "ninety_px": round(ninety_px, 2) if np.isfinite(ninety_px) else None}

    @property
    def description(self) -> str:
        """The numbers in one line."""
        agree, told = len(self.of(True)), len(self.pairs) - len(self.of(None))
        share = f" ({agree / told:.0%})" if told else ""
        ninety_px = self.numbers["ninety_px"]
        within = "" if ninety_px is None else f", nine in ten within {max(ninety_px, 1):.0f} px"
        return f"{agree} of {told} pairs that overlap by half agree{share}{within}; {len(self.of(None))} cannot tell"


def measure_agreement(views: Sequence[View], transforms: Mapping[int, Array], links: Sequence[Link] = ()) -> Agreement:
    """Compare the thumbnails of photographs where a layout by some links lays them on each other."""
    pairs = _choose_pairs(views, transforms)
    look = lru_cache(4 * MAX_COMPARED)(lambda member: band_pass(to_gray(views[member].thumbnail), LIGHT_PX))
    repeats = lru_cache(None)(lambda member: _repeats_itself(look(member)))
    fits, recognised = dict[Candidate, Array](), dict[int, NDArray[np.bool_]]()
    for one, other in (each for pair in pairs for each in (pair, pair[::-1])):
        to_ground = transforms[one] @ np.linalg.inv(views[one].to_thumbnail)
        moved = views[other].to_thumbnail @ np.linalg.inv(transforms[other]) @ to_ground
        fits[one, other] = fit = _fit_patches(look(one), look(other), moved)
        recognised[other] = recognised.get(other, np.False_) | (fit[..., 0] > SAME)
    grounds = {}
    ties = {(link.left, link.right): link.left_points for link in links}
    ties |= {(link.right, link.left): link.right_points for link in links}
    for left, right in pairs:
        known, different = list[Array](), 0
        for one, other in ((left, right), (right, left)):
            fit, of_any, none = fits[one, other], recognised[other], np.zeros((0, 2))
            known.append(fit[of_any & np.isfinite(fit[..., 0])])
            there = apply(views[other].to_thumbnail, ties.get((other, one), none))
            different += _count_different(fit[..., 0], of_any, there)
        told = np.concatenate(known)
        off_px = told[told[:, 0] > SAME, 1] / views[right].to_thumbnail[0, 0]
        median_px = float(np.median(off_px)) if len(off_px) else np.inf
        repeated = repeats(left) and repeats(right)
        grounds[left, right] = GroundOfPair(len(off_px), len(told), median_px, different, repeated)
    return Agreement(grounds)


def _choose_pairs(views: Sequence[View], transforms: Mapping[int, Array]) -> list[Candidate]:
    """The pairs of photographs that are compared."""
    over: dict[int, list[int]] = {}
    for (left, right), share in sorted(overlaps(views, transforms).items()):
        if share >= MIN_OVERLAP:
            over.setdefault(left, []).append(right)
    pairs = list[Candidate]()
    for left, each in over.items():
        step = 1 if len(each) <= MAX_COMPARED else math.ceil(2 * len(each) / MAX_COMPARED)
        pairs += [(left, right) for right in each[::step]]
    return pairs


def _fit_patches(one: Float32, other: Float32, moved: Array) -> Array:
    """Correlation of each patch of a thumbnail with another one, NaN where it cannot tell, and how far it is off, px.

    The patches (rows, columns, 2) are those of the other thumbnail, onto which ``moved`` brings the one.
    """
    height, width = other.shape
    warped = cv2.warpPerspective(one, moved, (width, height), borderValue=OUTSIDE)
    around_px = PATCH_PX + 2 * REACH_PX
    tops, lefts = (range(0, max(side - around_px + 1, 0), STEP_PX) for side in (height, width))
    fits = np.full((len(tops), len(lefts), 2), np.nan)
    for (row, top), (column, left) in product(enumerate(tops), enumerate(lefts)):
        around = np.s_[top : top + around_px, left : left + around_px]
        patch = warped[around][REACH_PX:-REACH_PX, REACH_PX:-REACH_PX]
        # NumPy's own take as long as the search.
        if cv2.norm(patch, cv2.NORM_INF) < 256 and cv2.meanStdDev(patch)[1][0, 0] >= MIN_CONTRAST:
            _, best, _, place = cv2.minMaxLoc(cv2.matchTemplate(other[around], patch, cv2.TM_CCOEFF_NORMED))
            fits[row, column] = best, np.hypot(place[0] - REACH_PX, place[1] - REACH_PX)
    return fits


def _count_different(fits: Array, recognised: NDArray[np.bool_], ties: Points) -> int:
    """Recognised patches with nothing in common, but for those amid the ties (N, 2): there, the ground has changed."""
    rows, columns = np.nonzero((fits < DIFFERENT) & recognised)
    if not len(ties):
        return len(rows)
    hull = cv2.convexHull(((ties - PATCH_PX / 2 - REACH_PX) / STEP_PX).astype(np.float32))
    places = zip(columns.tolist(), rows.tolist(), strict=True)
    return sum(cv2.pointPolygonTest(hull, place, measureDist=False) < 0 for place in places)


def _repeats_itself(thumbnail: Float32) -> bool:
    """Whether a band-passed thumbnail looks the same up to a third of itself aside.

    What looks the same all the way there, as along a road, does not repeat.
    """
    height, width = (side // 3 for side in thumbnail.shape)
    middle = thumbnail[height:-height, width:-width]
    if min(height, width) < REACH_PX or middle.std() < MIN_CONTRAST:
        return False
    fits = cv2.matchTemplate(thumbnail, middle, cv2.TM_CCOEFF_NORMED)
    _, alike = cv2.connectedComponents((fits > SAME).astype(np.uint8))
    return bool(fits[alike != alike[height, width]].max(initial=0) > REPEATED)


def compare_sharpness(
    views: Sequence[View], transforms: Mapping[int, Array], pairs: Collection[Candidate]
) -> dict[int, float]:
    """Sharpness of views over that of others of the same ground in ``pairs``, medians over blocks.

    Of several that show a block, the second sharpest counts, because noise looks like detail.
    """
    least = dict[int, Array]()
    for one, other in (each for pair in pairs for each in (pair, pair[::-1])):
        ours, theirs = views[one].sharpness, views[other].sharpness
        block, block_there = (np.array(views[each].working_size) / ours.shape[::-1] for each in (one, other))
        middles = np.stack(np.meshgrid(*map(np.arange, ours.shape[::-1])), axis=-1) + 0.5
        moved = np.linalg.inv(transforms[other]) @ transforms[one]
        at = (apply(moved, middles * block - 0.5) + 0.5) / block_there
        inside = ((at > 0) & (at < theirs.shape[::-1])).all(axis=-1)
        at = np.clip(np.nan_to_num(at), 0, theirs.shape[::-1]) - 0.5
        there = cv2.remap(theirs, at.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        over = np.where(inside, ours - there, np.inf)
        known = least.get(one, np.full((2, *over.shape), np.inf))
        least[one] = np.sort(np.concatenate((known, over[None])), axis=0)[:2]
    seconds = {view: np.where(np.isfinite(second), second, first) for view, (first, second) in least.items()}
    shown = {view: each[np.isfinite(each)] for view, each in seconds.items()}
    return {view: float(np.exp(np.median(each))) for view, each in shown.items() if len(each)}


def find_false_joint(
    agreement: Agreement, members: Sequence[int], links: Sequence[Link], tried: Mapping[Candidate, Link]
) -> tuple[list[int], str] | None:
    """The smaller of two parts of a layout, and what is said of the links that join them falsely; None without such.

    A joint is judged as a whole, by the recognised patches of all pairs across it: single pairs agree by chance. The
    parts are those into which the tree of the surest links falls without one of them, the least sure first; ``tried``
    are all links. Where false links are surer than true ones, as by a twin of 0.8, the part may be a wrong one.
    """
    pairs = np.array([*agreement.pairs])
    counts = np.array([(ground.different, ground.recognised) for ground in agreement.pairs.values()])
    # The share of a joint is not above that of the worst pair across it.
    if all(different <= FALSE_JOINT * known for different, known in counts):
        return None
    tree = _surest_tree(agreement, members, links)
    for cut in tree:
        sides = groups(members[-1] + 1, [link for link in tree if link is not cut])
        part = min((side for side in sides if cut.left in side or cut.right in side), key=len)
        across = np.isin(pairs, part).sum(axis=1) == 1
        (different, known), (different_within, known_within) = (counts[each].sum(axis=0) for each in (across, ~across))
        allowed = FALSE_JOINT + WITHIN * different_within / max(known_within, 1)
        if different >= MIN_RECOGNISED and different > allowed * known:
            break
    else:
        return None
    between, share = pairs[across].tolist(), different / known
    held = [tried[left, right].holds for left, right in between if (left, right) in tried]
    where = np.count_nonzero(counts[across, 0])
    return part, (
        f"the ground contradicts: across them {share:.0%} of what photographs recognise is not there, in {where} of "
        f"{len(between)} pairs that overlap by half, and {held.count(False)} of {len(held)} tried do not hold"
    )


def _surest_tree(agreement: Agreement, members: Sequence[int], links: Sequence[Link]) -> list[Link]:
    """The links that join all members and are surest by their inliers and by the ground, the least sure first."""
    costs = dict[Candidate, int]()
    for link in links:
        ground = agreement.pairs.get((link.left, link.right), UNKNOWN)
        doubt = (ground.recognised - ground.same + 1) / (ground.recognised + 2)
        costs[link.left, link.right] = 1 + round(1e6 * doubt / link.inliers)
    joined = minimum_spanning_tree(join(members, links, list(costs.values()))).nonzero()
    ends = {(min(pair), max(pair)) for pair in np.array(members)[np.array(joined)].T.tolist()}
    tree = [link for link in links if (link.left, link.right) in ends]
    return sorted(tree, key=lambda link: -costs[link.left, link.right])
