"""Global refinement of a flight: one transformation a view, fitted to the ties of all links at once.

Views and the ground are related by homographies (projective transformations, eight parameters). Each is refined
by small motions of the view's own pixels: two translations, rotation, scale (these four make a similarity), two
stretches (with them, affine) and two tilts. Coordinates are normalised: centred, in half diagonals of the view.

The ties alone leave some motions open, above all a bending of the whole mosaic. A prior decides these: over flat
ground a camera that looks down sees a similarity, except for a little tilt and the stretch that follows from it.
The stretch and tilt of all views thereby define the ground plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import spsolve

from golden_model.arrays import Array

MODELS = {"similarity": 4, "affine": 6, "homography": 8}
"""Motions that each model leaves free."""
FOCAL_HALF_DIAGONALS = 1.2
"""Focal length in half diagonals of the view: common drones have 1.1 to 1.3."""
STRETCH_SIGMA = 1e-3
"""Expected stretch beside what the tilt explains."""
TILT_SIGMA = 0.05
"""Expected perspective: the tangent of the tilt over the focal length in half diagonals; about 3 degrees."""
SMALLEST_SCALE_PX = 1.5
"""Scale of the robust loss once the residuals are small; before that, twice their median."""
MAX_STEPS = 15
CONVERGED_PX = 0.01


@dataclass(frozen=True, eq=False)
class Ties:
    """Point pairs of one link in normalised coordinates of its views.

    Attributes
    ----------
    left, right : int
        Rows of the views.
    left_points, right_points : ndarray of float64, shape (N, 2)
    """

    left: int
    right: int
    left_points: Array
    right_points: Array


class Network:
    """The ties of a flight, ready for adjustments.

    Parameters
    ----------
    ties : sequence of Ties
    units_px : sequence of float
        Half diagonal of each view, in working px.
    reference : int
        The view whose position, rotation and scale stay fixed.
    """

    def __init__(self, ties: Sequence[Ties], units_px: Sequence[float], reference: int) -> None:
        self._pairs = np.array([(tie.left, tie.right) for tie in ties], dtype=np.intp).reshape(-1, 2)
        counts = np.array([len(tie.left_points) for tie in ties], dtype=np.intp)
        self._bounds = np.concatenate([[0], np.cumsum(counts)])
        self._link = np.repeat(np.arange(len(ties)), counts)
        self._x = np.concatenate([tie.left_points for tie in ties])
        self._y = np.concatenate([tie.right_points for tie in ties])
        self._views = len(units_px)
        self._reference = reference
        self._unit_px = np.asarray(units_px, dtype=np.float64)[self._pairs[self._link, 1]]

    def errors_px(self, transforms: Array) -> list[Array]:
        """Distance of each tie's mapped left point from its right one, by link, in working px of the right view."""
        _, residual = self._residuals(transforms)
        return np.split(np.linalg.norm(residual, axis=1) * self._unit_px, self._bounds[1:-1])

    def adjust(self, start: Array, model: str, *, max_steps: int = MAX_STEPS) -> Array:
        """Refine the transformations (V, 3, 3), view to ground, by reweighted Gauss-Newton steps.

        Every step weighs the ties by 1 / (1 + e²/s²)² (Geman-McClure), s falling with the median residual.
        """
        transforms, free = start, MODELS[model]
        for _ in range(max_steps):
            motion = self._step(transforms, free)
            transforms = transforms @ _motions(motion)
            transforms = transforms / transforms[:, 2:, 2:]
            if np.abs(motion).max() * self._unit_px.max() < CONVERGED_PX:
                break
        return transforms

    def _residuals(self, transforms: Array) -> tuple[tuple[Array, Array], Array]:
        """The left points in the right views with the derivative of that mapping, and their offset from the right."""
        left, right = transforms[self._pairs[:, 0]], transforms[self._pairs[:, 1]]
        between = (np.linalg.inv(right) @ left)[self._link]
        mapped = (between[:, :, :2] @ self._x[:, :, None])[..., 0] + between[:, :, 2]
        predicted = mapped[:, :2] / mapped[:, 2:]
        derivative = (between[:, :2, :2] - predicted[:, :, None] * between[:, 2:, :2]) / mapped[:, 2, None, None]
        return (predicted, derivative), predicted - self._y

    def _step(self, transforms: Array, free: int) -> Array:
        """The motions (V, 8) of one Gauss-Newton step."""
        (predicted, derivative), residual = self._residuals(transforms)
        error_px = np.linalg.norm(residual, axis=1) * self._unit_px
        scale_px = max(SMALLEST_SCALE_PX, 2 * float(np.median(error_px)))
        root = self._unit_px / (1 + (error_px / scale_px) ** 2)
        # A motion of the right view moves its point away from under the mapped one.
        jacobian = np.concatenate([derivative @ generators(self._x, free), -generators(predicted, free)], axis=2)
        jacobian *= root[:, None, None]
        residual = residual * root[:, None]
        system = _BlockSystem(self._views, free)
        for (left, right), first, last in zip(self._pairs, self._bounds, self._bounds[1:], strict=False):
            rows = jacobian[first:last].reshape(-1, 2 * free)
            system.add(left, right, rows.T @ rows, rows.T @ residual[first:last].ravel())
        if free > MODELS["similarity"]:
            sigma = np.array([STRETCH_SIGMA, STRETCH_SIGMA, TILT_SIGMA, TILT_SIGMA])[: free - 4]
            shape = shapes(transforms)
            shape[:, :2] -= stretch_of_tilt(shape[:, 2:])
            system.add_prior(shape[:, : free - 4], 1 / sigma**2)
        motion = np.zeros((self._views, 8))
        motion[:, :free] = system.solve(self._reference)
        return motion


class _BlockSystem:
    """Normal equations of a network: one block of unknowns a view."""

    def __init__(self, views: int, free: int) -> None:
        self._free = free
        self._diagonal = np.zeros((views, free, free))
        self._target = np.zeros((views, free))
        self._across: dict[tuple[int, int], Array] = {}

    def add(self, left: int, right: int, normal: Array, target: Array) -> None:
        """Add the normal matrix (2 free, 2 free) and right-hand side (2 free) of one link."""
        cut = self._free
        self._diagonal[left] += normal[:cut, :cut]
        self._diagonal[right] += normal[cut:, cut:]
        self._target[left] += target[:cut]
        self._target[right] += target[cut:]
        self._across[left, right] = normal[:cut, cut:]

    def add_prior(self, values: Array, weights: Array) -> None:
        """Pull the last unknowns of every view so that ``values`` (V, k) become 0."""
        k = values.shape[1]
        self._diagonal[:, -k:, -k:] += np.diag(weights)
        self._target[:, -k:] += values * weights

    def solve(self, reference: int) -> Array:
        """The unknowns (V, free) that lower the residuals; the first four of the reference are 0."""
        views, free = self._target.shape
        corners = np.array([(v, v) for v in range(views)] + list(self._across) + [(b, a) for a, b in self._across])
        across = list(self._across.values())
        blocks = np.concatenate([self._diagonal, *([np.stack(across), np.stack(across).transpose(0, 2, 1)])])
        inner = np.arange(free)
        rows = np.broadcast_to(free * corners[:, 0, None, None] + inner[:, None], blocks.shape)
        columns = np.broadcast_to(free * corners[:, 1, None, None] + inner, blocks.shape)
        side = views * free
        matrix = csc_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(side, side))
        open_unknowns = np.ones(side, dtype=bool)
        open_unknowns[reference * free : reference * free + 4] = False
        solution = np.zeros(side)
        kept = np.flatnonzero(open_unknowns)
        solution[kept] = -spsolve(matrix[kept][:, kept], self._target.ravel()[kept])
        return solution.reshape(views, free)


def generators(points: Array, count: int) -> Array:
    """How each of the first ``count`` motions moves each point: (N, 2) to (N, 2, count).

    Right, down, turn, grow; stretch along the axes and along the diagonals; tilt about y and about x.
    """
    x, y = points.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    along_x = (one, zero, -y, x, x, y, -x * x, -x * y)
    along_y = (zero, one, x, y, -y, x, -x * y, -y * y)
    return np.stack([np.stack(along_x[:count], axis=1), np.stack(along_y[:count], axis=1)], axis=1)


def shapes(transforms: Array) -> Array:
    """Stretch along the axes, along the diagonals, and tilt about y and x of each view at its centre, (V, 4)."""
    scaled = transforms / transforms[:, 2:, 2:]
    tilt = scaled[:, 2, :2]
    affine = scaled[:, :2, :2] - scaled[:, :2, 2:] * tilt[:, None, :]
    # As complex numbers, an affine map is z -> similar z + stretching z*; their quotient is seen by the view itself.
    similar = affine[:, 0, 0] + affine[:, 1, 1] + 1j * (affine[:, 1, 0] - affine[:, 0, 1])
    stretching = affine[:, 0, 0] - affine[:, 1, 1] + 1j * (affine[:, 1, 0] + affine[:, 0, 1])
    stretch = stretching / similar
    return np.column_stack([stretch.real, stretch.imag, tilt])


def stretch_of_tilt(tilt: Array) -> Array:
    """Stretch (V, 2), as `shapes` measures it, of a camera whose tilt (V, 2) is the only one it has.

    A camera that leans by an angle a sees a tilt of tan(a) / f, and along it a stretch of tan²(a / 2).
    """
    leaning = FOCAL_HALF_DIAGONALS * (tilt[:, 0] + 1j * tilt[:, 1])
    stretch = leaning**2 / (1 + np.sqrt(1 + np.abs(leaning) ** 2)) ** 2
    return np.column_stack([stretch.real, stretch.imag])


def _motions(motion: Array) -> Array:
    """The transformations (V, 3, 3) of small motions (V, 8)."""
    right, down, turn, grow, axes, diagonals, tilt_x, tilt_y = motion.T
    one = np.ones_like(right)
    rows = [
        [1 + grow + axes, diagonals - turn, right],
        [diagonals + turn, 1 + grow - axes, down],
        [tilt_x, tilt_y, one],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
