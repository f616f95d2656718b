"""The homography of four matches, without a division.

In homogeneous coordinates the homography that maps four points p to q is H = sum_i (b_i / a_i) q_i (p_j x p_k)', i = 0,
1, 2, where a_i is twice the area of the left triangle without point i, and b_i that of the right one. With positions
relative to the fourth point the third coordinate of each cross product is a_i itself, and the sums of the last column
are known: 0, 0 and b_3. The scale is free: all is multiplied by a_0 a_1 a_2, and by that product times b_3 once more,
which makes the third coordinate of the fourth point positive.

A view from the same side turns no triangle over: a_i b_i > 0 for i = 0 ... 3. A sample is dropped unless all four
products are at least (8 px²)², since noise decides the orientation of small triangles.
"""

from collections.abc import Sequence
from typing import TypeVar

from golden_model.geometry.floating import Number

N = TypeVar("N", bound=Number)

MIN_CHECKED_EXPONENT = -41
"""Smallest exponent of a_i b_i in units of (4096 px)^4, where a and b are twice the areas: 2^-42 is (8 px²)²."""

OTHERS = ((1, 2), (2, 0), (0, 1))
"""The other two of the first three points, for each of them."""

Positions = Sequence[Sequence[N]]
"""Positions (x, y), not normalised; in units of 4096 px."""


def areas(zero: N, one: N, sample: tuple[Positions[N], Positions[N]]) -> tuple[tuple[list[N], list[N]], list[N]]:
    """Compute twice the areas of a sample's triangles.

    Returns
    -------
    areas : two lists of four numbers
    products : list of four numbers
        The sample is dropped unless all are positive with an exponent of at least `MIN_CHECKED_EXPONENT`.
    """
    both = []
    for points in sample:
        _, edges = _from_fourth(zero, one, points)
        sides = [zero.plus(edges[j][0], edges[k][1]).minus(edges[j][1], edges[k][0]) for j, k in OTHERS]
        both.append([*sides, sides[0].plus(one, sides[1]).plus(one, sides[2])])
    return (both[0], both[1]), [zero.plus(*each) for each in zip(*both, strict=True)]


def solve(
    zero: N, one: N, sample: tuple[Positions[N], Positions[N]], both_areas: tuple[Sequence[N], Sequence[N]]
) -> list[list[N]]:
    """Solve a sample, given its `areas`: three rows of a homography of any scale."""
    (p, d), (q, e) = (_from_fourth(zero, one, points) for points in sample)
    a, b = both_areas
    pairs = [zero.plus(a[j], a[k]) for j, k in OTHERS]
    both = zero.plus(zero.plus(pairs[2], a[2]), b[3])
    factors = [zero.plus(zero.plus(pairs[i], b[i]), both) for i in range(3)]
    edges = [(d[j][1].minus(one, d[k][1]), d[k][0].minus(one, d[j][0])) for j, k in OTHERS]
    scaled = [[zero.plus(factors[i], e[i][axis]) for i in range(3)] for axis in range(2)]
    rows = [[_dot(zero, row, [edge[axis] for edge in edges]) for axis in range(2)] for row in (*scaled, factors)]
    return restore(zero, one, [[*rows[0], zero], [*rows[1], zero], [*rows[2], zero.plus(both, both)]], p, q)


def _from_fourth(zero: N, one: N, points: Positions[N]) -> tuple[list[N], list[list[N]]]:
    """The fourth point, and its distance from each of the other three."""
    origin = [zero.plus(one, value) for value in points[3]]
    return origin, [[origin[axis].minus(one, point[axis]) for axis in range(2)] for point in points[:3]]


def restore(zero: N, one: N, rows: Sequence[Sequence[N]], p: Sequence[N], q: Sequence[N]) -> list[list[N]]:
    """Turn the homography from ``p`` - left to ``q`` - right into that from left to right, for any p and q."""
    bottom = rows[2]
    restored = []
    for row, origin in zip(rows[:2], q, strict=True):
        linear = [row[axis].minus(origin, bottom[axis]) for axis in range(2)]
        constant = zero.plus(origin, bottom[2]).minus(one, row[2])
        restored.append([*linear, constant.minus(linear[0], p[0]).minus(linear[1], p[1])])
    constant = bottom[2].plus(bottom[0], p[0]).plus(bottom[1], p[1])
    return [*restored, [zero.minus(one, bottom[0]), zero.minus(one, bottom[1]), constant]]


def _dot(zero: N, a: Sequence[N], b: Sequence[N]) -> N:
    total = zero
    for each in zip(a, b, strict=True):
        total = total.plus(*each)
    return total
