"""Where a homography of the ground ends: at the line that it maps to infinity, the horizon, beyond which lies the sky.

What it says of the sky is no place on the ground: formally the sky is mapped to the other side, behind the camera.
"""

import numpy as np

from golden_model.arrays import Array, Matrix, Points


def ahead(homography: Matrix, points: Points) -> Array:
    """How far points (N, 2) are on the ground's side of the horizon, in any unit: 0 on it, negative in the sky, (N,).

    It is the third homogeneous coordinate w, whose sign is arbitrary. The local scale of areas is det H / w³, and two
    photographs of the same side of the ground have the same orientation, so on the ground w has the sign of det H.
    """
    third = points @ homography[2, :2] + homography[2, 2]
    return np.asarray(third * np.sign(np.linalg.det(homography)))


def clip_polygon(polygon: Points, inside: Array) -> Points:
    """The part of a convex polygon (N, 2) in a half-plane: ``inside`` (N,), linear in the plane, is not negative there.

    It has no corner (0, 2) where nothing is left.
    """
    kept = []
    edges = zip(np.roll(polygon, 1, axis=0), polygon, np.roll(inside, 1), inside, strict=True)
    for start, end, first, last in edges:
        if (first < 0) != (last < 0):
            kept.append(start + (end - start) * first / (first - last))
        if last >= 0:
            kept.append(end)
    return np.array(kept).reshape(-1, 2)
