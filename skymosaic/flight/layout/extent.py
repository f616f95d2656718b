"""What the views of a layout show of the ground, and which of them cannot lie where the layout puts them."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from scipy.spatial import KDTree

from golden_model.arrays import Array
from skymosaic.compositing import warp
from skymosaic.compositing.warp import Canvas, nearest_corner, nearness
from skymosaic.flight.layout.linked_group import groups
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply

REMOTE_PERCENTILE = 5
"""Percentile of the nearness of a photograph's ties that counts as its farthest; single ones may be false."""
BEYOND_TIES = 0.63
"""Ground is shown if it is at least this near, relative to the farthest ties: there, pixels are twice as large."""
MAX_STRETCH = 3.0
"""Nor is ground shown where a photograph's pixels become this many times as large as those in its middle."""
MAX_SLANT = 3.0
"""A middle whose pixels are longer than this many times their width is far ground, as that of a camera that leans
by more than 70 degrees. Then the measure is the place where they are this long."""
AT_HORIZON = 0.05
"""Nearness at which the outline of a view that looks to the horizon ends: a pixel there covers 8,000 times as much."""
LOST_PX = 30.0
"""A link that alone joins two parts can be met exactly. If its ties stay this far apart, no plane explains them."""
MAX_AREA_RATIO = 100.0
"""A view shows at most so much more or less ground than those it is linked with: from a kite 4, towards the horizon 18.
"""


def outline(view: View, transform: Array) -> Array:
    """Corners (N, 2) of a view under a transformation of its working pixels; four, unless it looks to the horizon."""
    size = view.working_size
    whole = nearness(size, transform, Canvas(0, 0, *size).corners).min() > 0
    return apply(transform, warp.outline(size, transform, 0.0 if whole else AT_HORIZON))


def overlap(one: Array, other: Array) -> float:
    """Common area of two convex outlines (N, 2), as a share of the smaller."""
    one, other = one.astype(np.float32), other.astype(np.float32)
    area, _ = cv2.intersectConvexConvex(one, other)
    return float(area) / max(min(cv2.contourArea(one), cv2.contourArea(other)), 1.0)


def common_ground(one: Array, other: Array) -> Array:
    """Outline (N, 2) of what two convex outlines (N, 2) have in common; without corners if there is nothing."""
    _, corners = cv2.intersectConvexConvex(one.astype(np.float32), other.astype(np.float32))
    return np.zeros((0, 2)) if corners is None else corners[:, 0].astype(np.float64)


def overlaps(views: Sequence[View], transforms: Mapping[int, Array]) -> dict[Candidate, float]:
    """Overlap of all pairs that are close enough for one, as a share of the smaller view."""
    outlines = {member: outline(views[member], transform) for member, transform in transforms.items()}
    centres = np.array([corners.mean(axis=0) for corners in outlines.values()])
    radii = [np.linalg.norm(o - c, axis=1).max() for o, c in zip(outlines.values(), centres, strict=True)]
    near = KDTree(centres).query_pairs(2 * max(radii), output_type="ndarray")
    pairs = np.sort(np.array(list(transforms))[near], axis=1).tolist()
    return {(left, right): overlap(outlines[left], outlines[right]) for left, right in pairs}


def least_nearness(
    views: Sequence[View], transforms: Mapping[int, Array], links: Sequence[Link], scale: float = 1.0
) -> dict[int, float]:
    """How near ground has to be that each view of a layout shows, see `skymosaic.compositing.warp.nearness`.

    A photograph that looks to the horizon would cover a village with what it shows of the fields behind. Far beyond
    its ties it is coarse, and nothing says whether the ground there is where the layout puts it. Where all photographs
    look ahead there are ties far away too, and most of the canvas would be their stretched pixels: on one of a smaller
    ``scale`` they are stretched less, so that it shows more of the far field.
    """
    tied: dict[int, list[Array]] = {member: [] for member in transforms}
    for link in links:
        tied[link.left].append(link.left_points)
        tied[link.right].append(link.right_points)
    least = dict.fromkeys(transforms, 0.0)
    for member, parts in tied.items():
        # A pair that was fitted again to dense flow may have no matches on its plane.
        points = np.concatenate([np.zeros((0, 2)), *parts])
        if not len(points):
            continue
        size, transform = views[member].working_size, transforms[member]
        tied_from = float(np.percentile(nearness(size, transform, points), REMOTE_PERCENTILE))
        corners = nearness(size, transform, Canvas(0, 0, *size).corners)
        # It is linear, so the corners' mean is that of the middle; the area of a pixel grows with its third power.
        measure = max(float(corners.mean()), min(_nearness_of_slant(size, transform, MAX_SLANT), 1.0))
        limit = max(BEYOND_TIES * tied_from, measure * (scale / MAX_STRETCH) ** (2 / 3))
        least[member] = 0.0 if corners.min() >= limit else limit
    return least


def _nearness_of_slant(size: tuple[int, int], transform: Array, slant: float) -> float:
    """The nearness at which pixels are ``slant`` times as long as wide, from the middle of a view to the horizon.

    Over flat ground, nearness times length by width is the same all along that line, and finite where the middle lies
    at the horizon or above.
    """
    matrix = transform / nearest_corner(size, transform)
    x, y, depth = matrix @ [(size[0] - 1) / 2, (size[1] - 1) / 2, 1]
    # That of the transformation times the square of the depth, so that its determinant is the matrix's times the depth.
    derivative = depth * matrix[:2, :2] - np.outer((x, y), matrix[2, :2])
    return float(np.linalg.norm(derivative, 2) ** 2 / abs(np.linalg.det(matrix))) / slant


def find_misplaced(
    views: Sequence[View], transforms: Mapping[int, Array], links: Sequence[Link], errors_px: Sequence[Array]
) -> dict[int, str]:
    """Views that cannot lie where a layout puts them, with the reason; never all of them.

    Parameters are as in `skymosaic.flight.layout.layout.Layout`. A view that fails harms what is linked with it, so of
    several that do only the worst is returned, until it is laid out without them.
    """
    return (
        _find_apart(views, transforms, links, errors_px)
        or _find_behind(views, transforms, links)
        or _find_out_of_scale(views, transforms, links)
    )


def _find_apart(
    views: Sequence[View], transforms: Mapping[int, Array], links: Sequence[Link], errors_px: Sequence[Array]
) -> dict[int, str]:
    """Views of all parts but the largest, where the links between the parts do not hold."""
    apart_px = [float(np.median(error)) for error in errors_px]
    kept = [link for link, off_px in zip(links, apart_px, strict=True) if off_px <= LOST_PX]
    if len(kept) == len(links):
        return {}
    together = next(part for part in groups(len(views), kept) if transforms.keys() >= set(part))
    worst = int(np.argmax(apart_px))
    names = f"{views[links[worst].left].name} and {views[links[worst].right].name}"
    reason = f"no plane explains the {links[worst].ties} matches of {names}: they stay {apart_px[worst]:.0f} px apart"
    return {member: reason for member in transforms if member not in together}


def _find_behind(views: Sequence[View], transforms: Mapping[int, Array], links: Sequence[Link]) -> dict[int, str]:
    """The view with the matches that are farthest behind it."""
    least: dict[int, float] = {}
    for link in links:
        for member, points in ((link.left, link.left_points), (link.right, link.right_points)):
            near = float(nearness(views[member].working_size, transforms[member], points).min())
            least[member] = min(near, least.get(member, 1.0))
    worst = min(least, key=least.__getitem__)
    return {} if least[worst] > 0 else {worst: "some of its matches would lie behind the camera"}


def _find_out_of_scale(views: Sequence[View], transforms: Mapping[int, Array], links: Sequence[Link]) -> dict[int, str]:
    """The view whose ground differs most in size from that of its neighbours, if too much."""
    least = least_nearness(views, transforms, links)
    area = {member: _shown_area(views[member], transforms[member], least[member]) for member in transforms}
    around: dict[int, list[float]] = {member: [] for member in transforms}
    for link in links:
        around[link.left].append(area[link.right])
        around[link.right].append(area[link.left])
    # Of two neighbours, the mean of their areas would be that of the larger one.
    ratios = {member: area[member] / float(np.exp(np.median(np.log(areas)))) for member, areas in around.items()}
    worst = max(ratios, key=lambda member: max(ratios[member], 1 / ratios[member]))
    if 1 / MAX_AREA_RATIO <= ratios[worst] <= MAX_AREA_RATIO:
        return {}
    return {worst: f"it would show {ratios[worst]:.3g} times as much ground as the photographs that it is linked with"}


def _shown_area(view: View, transform: Array, least: float) -> float:
    """Ground (px²) that a view shows, at least 1e-9."""
    shown = apply(transform, warp.outline(view.working_size, transform, least))
    return max(float(cv2.contourArea(shown.astype(np.float32))), 1e-9)
