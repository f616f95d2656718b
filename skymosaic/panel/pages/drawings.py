"""SVG of corners, matches and outlines.

The markup contains numbers and the panel's own words only, never file names: the page inserts it without escaping.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from golden_model.arrays import Array, Records
from golden_model.feature.orientation import SECTORS
from golden_model.formats import POSITION
from skymosaic.features.positions import match_points

MAX_LINK_INLIERS = 200
"""Links with this many inliers or more are drawn as the strongest."""
_TICK_PX = 7.0


def draw_corners(features: Records, offset_px: float) -> str:
    """Draw a dot and a tick along the orientation for each feature; one path per level, so that thousands draw fast."""
    x, y = features["x"] / POSITION.one + offset_px, features["y"] / POSITION.one
    angle = features["sector"] * (2 * math.pi / SECTORS)
    parts = []
    for level in (0, 1):
        chosen = features["level"] == level
        reach = _TICK_PX * (level + 1)
        points = np.stack((x[chosen], y[chosen]), axis=1)
        reaches = reach * np.stack((np.cos(angle[chosen]), np.sin(angle[chosen])), axis=1)
        ticks = _repeat("M%.1f %.1fl%.1f %.1f", np.hstack((points, reaches)))
        dots = _repeat("M%.1f %.1fh0", points)
        parts.append(f'<path class="tick level-{level}" d="{ticks}"/><path class="dot level-{level}" d="{dots}"/>')
    return "".join(parts)


def _repeat(form: str, numbers: Array) -> str:
    """Fill ``form`` with each row of ``numbers``, (N, M); a single formatting takes half the time of N."""
    return form * len(numbers) % tuple(numbers.ravel().tolist())


def locate_matches(matches: Records, offset_px: float) -> Array:
    """End points of matches, (M, 4): left x, y, right x, y; the right picture begins at ``offset_px``."""
    left, right = match_points(matches)
    return np.hstack((left, right + np.array([offset_px, 0])))


def draw_matches(lines: Array, verdicts: Sequence[str], shown: Sequence[int]) -> str:
    """Draw the matches with the indices in ``shown``, rejected ones first.

    Each is a path of its own: browsers skip those that are out of view, and dash a single line many times faster.
    """
    parts = []
    for verdict in ("rejected", "outlier", "inlier"):
        drawn = lines[[index for index in shown if verdicts[index] == verdict]]
        parts.append(_repeat(f'<path class="match {verdict}" d="M%.1f %.1fL%.1f %.1f"/>', drawn))
    return "".join(parts)


def draw_chosen_match(line: Array, verdict: str) -> str:
    """Draw one match highlighted, over the others."""
    x0, y0, x1, y1 = (f"{value:.1f}" for value in line)
    return (
        f'<path class="match chosen-back" d="M{x0} {y0}L{x1} {y1}"/>'
        f'<path class="match chosen {verdict}" d="M{x0} {y0}L{x1} {y1}"/>'
        f'<path class="chosen-end {verdict}" d="M{x0} {y0}h0M{x1} {y1}h0"/>'
    )


def find_nearest(lines: Array, x: float, y: float, within: float) -> int | None:
    """Find the line of (M, 4) nearest to a point; its index, or None if all are farther than ``within``."""
    if len(lines) == 0:
        return None
    start, along = lines[:, :2], lines[:, 2:] - lines[:, :2]
    squared_length = np.maximum((along**2).sum(axis=1), 1e-9)
    # Position of the foot of the perpendicular on each line, as a share of the line.
    share = np.clip((((x, y) - start) * along).sum(axis=1) / squared_length, 0, 1)
    distance = np.linalg.norm(start + share[:, np.newaxis] * along - (x, y), axis=1)
    index = int(distance.argmin())
    return index if distance[index] <= within else None


def draw_outlines(quadrilaterals: Iterable[Array]) -> str:
    """Draw closed outlines (4, 2), numbered from 1 at their centres."""
    parts = []
    for number, corners_px in enumerate(quadrilaterals, 1):
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners_px)
        x, y = corners_px.mean(axis=0)
        parts.append(f'<polygon class="footprint" points="{points}"/>')
        parts.append(f'<text class="footprint-name" x="{x:.0f}" y="{y:.0f}">{number}</text>')
    return "".join(parts)


def draw_seams(lines: Iterable[Array]) -> str:
    """Draw closed lines (N, 2) around what each photograph shows, as one path."""
    path = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in line) + "Z" for line in lines)
    return f'<path class="seam" d="{path}"/>'


def draw_links(quadrilaterals: Mapping[str, Array], linked: Iterable[tuple[str, str, int]]) -> str:
    """Draw lines between the centres of linked photographs with outlines, wider and greener with more inliers."""
    parts = []
    for left, right, inliers in linked:
        if left in quadrilaterals and right in quadrilaterals:
            (x0, y0), (x1, y1) = (quadrilaterals[name].mean(axis=0) for name in (left, right))
            strength = min(inliers / MAX_LINK_INLIERS, 1.0)
            style = f"stroke: hsl({120 * strength:.0f} 75% 55%); stroke-width: {1 + 4 * strength:.1f}px"
            parts.append(f'<path class="link" style="{style}" d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"/>')
    return "".join(parts)
