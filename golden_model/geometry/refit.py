"""Weighted least squares over the inliers: the normal equations of the DLT with h22 = 1, and their solution by LDL'.

With left positions (x, y), right ones (u, v), both from the frame's centre, and weight g, each of the equations' sums
is one of g, gu, gv, g(u² + v²) times one of x², xy, y², x, y, 1: 23 different sums.
"""

from collections.abc import Sequence
from typing import TypeVar

from golden_model.geometry.floating import Number
from golden_model.geometry.solving import restore

N = TypeVar("N", bound=Number)

BANDS = (1, 9, 17, 25)
"""Smallest gain of the matches that each round is computed from: errors below 4.2, 3.7, 3 and 2.1 px."""
MAX_INLIERS = 512
"""A round takes at most this many, those with the largest weights."""
SUMS = 23
NEWTON_STEPS = 2
"""Each doubles the number of correct bits of a reciprocal, which starts at 7."""


def factors(zero: N, one: N, centre: Sequence[N], match: Sequence[N], weight: N) -> list[tuple[N, N]]:
    """Compute the two factors of what a match (left x and y, right x and y) adds to each of the `SUMS`."""
    x, y, u, v = (centre[axis % 2].minus(one, value) for axis, value in enumerate(match))
    g = zero.plus(one, weight)
    gu, gv = zero.plus(g, u), zero.plus(g, v)
    monomials = [zero.plus(x, x), zero.plus(x, y), zero.plus(y, y), x, y, one]
    scales = [g, gu, gv, zero.plus(gu, u).plus(gv, v)]
    # The last sum, of g(u² + v²), has no place in the equations.
    return [(scale, monomial) for scale in scales for monomial in monomials][:SUMS]


def solve_sums(zero: N, one: N, centre: Sequence[N], sums: Sequence[N]) -> tuple[list[list[N]], N]:
    """Solve the normal equations of the sums: the homography row by row, and its determinant.

    A homography preserves orientation, for points in front of the camera, where its determinant is positive.
    """
    h = _solve_symmetric(zero, one, _equations(zero, one, sums))
    rows = restore(zero, one, [h[0:3], h[3:6], [*h[6:8], one]], centre, centre)
    determinant = zero
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        minor = zero.plus(rows[1][j], rows[2][k]).minus(rows[1][k], rows[2][j])
        determinant = determinant.plus(rows[0][i], minor)
    return rows, determinant


def _equations(zero: N, one: N, sums: Sequence[N]) -> list[list[N]]:
    """Lower triangle of the symmetric matrix, whose ninth row is the right-hand side.

    The rows of a match are (x, y, 1, 0, 0, 0, -ux, -uy | u) and (0, 0, 0, x, y, 1, -vx, -vy | v).
    """
    xx, xy, yy, x, y, n = range(6)
    g, gu, gv, gs = (sums[first : first + 6] for first in (0, 6, 12, 18))
    block = [[g[xx]], [g[xy], g[yy]], [g[x], g[y], g[n]]]
    none = [zero] * 3

    def negative(value: N) -> N:
        return zero.minus(one, value)

    products = [[[negative(q[m]) for m in row] for row in ((xx, xy, x), (xy, yy, y))] for q in (gu, gv)]
    return [
        *block,
        *([*none, *row] for row in block),
        [*products[0][0], *products[1][0], gs[xx]],
        [*products[0][1], *products[1][1], gs[xy], gs[yy]],
        [*(q[m] for q in (gu, gv) for m in (x, y, n)), negative(gs[x]), negative(gs[y])],
    ]


def _solve_symmetric(zero: N, one: N, rows: list[list[N]]) -> list[N]:
    """Eliminate column by column; ``rows`` is the lower triangle with the right-hand side below."""
    size = len(rows) - 1
    factors = []
    for column in range(size):
        inverse = _reciprocal(zero, one, rows[column][column])
        below = [
            row if (row := rows[i][column]) is zero else zero.plus(row, inverse) for i in range(column + 1, size + 1)
        ]
        for i in range(column + 1, size + 1):
            for k in range(column + 1, min(i, size - 1) + 1):
                if below[i - column - 1] is not zero and rows[k][column] is not zero:
                    rows[i][k] = rows[i][k].minus(below[i - column - 1], rows[k][column])
        factors.append(below)
    solution: list[N] = []
    for column in reversed(range(size)):
        value = factors[column][-1]
        for i in range(column + 1, size):
            if factors[column][i - column - 1] is not zero:
                value = value.minus(factors[column][i - column - 1], solution[size - 1 - i])
        solution.append(value)
    return solution[::-1]


def _reciprocal(zero: N, one: N, value: N) -> N:
    inverse = value.seed()
    for _ in range(NEWTON_STEPS):
        inverse = inverse.plus(inverse, one.minus(inverse, value))
    return inverse
