"""Global refinement of a flight: one transformation a view, fitted to the ties of all links at once.

Views and the ground are related by homographies (projective transformations, eight parameters). Each is refined
by small motions of the view's own pixels: two translations, rotation, scale (these four make a similarity), two
stretches (with them, affine) and two tilts. Coordinates are normalised: centred, in half diagonals of the view.

The ties alone leave some motions open, above all a bending of the whole mosaic. A prior decides these: over flat
ground a camera that looks down sees a similarity, except for a little tilt and the stretch that follows from it.
The stretch and tilt of all views thereby define the ground plane.

The distortion of the lens, the same for all views, can be one more unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from golden_model.arrays import Array
from skymosaic.flight.layout.distortion import LARGEST_CHANGE, LARGEST_DISTORTION, bending_of, straightened

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
    distortion : float
        Of the lens, see `skymosaic.flight.layout.distortion.straightened`. `calibrate` changes it.
    """

    def __init__(
        self, ties: Sequence[Ties], units_px: Sequence[float], reference: int, distortion: float = 0.0
    ) -> None:
        self._pairs = np.array([(tie.left, tie.right) for tie in ties], dtype=np.intp).reshape(-1, 2)
        # Every link gets the same number of rows, those beyond its ties without weight: arrays need no loop over links.
        self._counts = np.array([len(tie.left_points) for tie in ties], dtype=np.intp)
        self._valid = np.arange(self._counts.max()) < self._counts[:, None]
        self._seen = np.zeros((2, *self._valid.shape, 2))
        for row, tie in enumerate(ties):
            self._seen[:, row, : len(tie.left_points)] = tie.left_points, tie.right_points
        self.distortion = distortion
        self._views = len(units_px)
        self._reference = reference
        self._unit_px = np.asarray(units_px, dtype=np.float64)[self._pairs[:, 1], None]

    def errors_px(self, transforms: Array) -> list[Array]:
        """Distance of each tie's mapped left point from its right one, by link, in working px of the right view."""
        _, residual = self._residuals(transforms)
        error_px = np.linalg.norm(residual, axis=2) * self._unit_px
        return [row[:count] for row, count in zip(error_px, self._counts, strict=True)]

    def adjust(self, start: Array, model: str, *, max_steps: int = MAX_STEPS) -> Array:
        """Refine the transformations (V, 3, 3), view to ground, by reweighted Gauss-Newton steps.

        Every step weighs the ties by 1 / (1 + e²/s²)² (Geman-McClure), s falling with the median residual.
        """
        return self._adjusted(start, MODELS[model], max_steps, lens=False)

    def calibrate(self, start: Array, model: str, *, max_steps: int = MAX_STEPS) -> Array:
        """As `adjust`, with the distortion of the lens as one more unknown; sets `distortion`."""
        return self._adjusted(start, MODELS[model], max_steps, lens=True)

    @property
    def distortion(self) -> float:
        """Of the lens."""
        return self._distortion

    @distortion.setter
    def distortion(self, value: float) -> None:
        self._distortion = value
        self._x, self._y = self._seen if value == 0 else straightened(self._seen, value)

    def _adjusted(self, start: Array, free: int, max_steps: int, *, lens: bool) -> Array:
        transforms = start
        for _ in range(max_steps):
            motion, bending = self._step(transforms, free, lens=lens)
            transforms = transforms @ _motions(motion)
            transforms = transforms / transforms[:, 2:, 2:]
            if lens:
                self.distortion = float(np.clip(self.distortion + bending, -LARGEST_DISTORTION, LARGEST_DISTORTION))
            if np.abs(motion).max() * self._unit_px.max() < CONVERGED_PX:
                break
        return transforms

    def _residuals(self, transforms: Array) -> tuple[tuple[Array, Array], Array]:
        """The left points in the right views with the derivative of that mapping, and their offset from the right."""
        left, right = transforms[self._pairs[:, 0]], transforms[self._pairs[:, 1]]
        between = np.linalg.inv(right) @ left
        mapped = self._x @ between[:, :, :2].transpose(0, 2, 1) + between[:, None, :, 2]
        predicted = mapped[..., :2] / mapped[..., 2:]
        derivative = between[:, None, :2, :2] - predicted[..., None] * between[:, None, 2:, :2]
        return (predicted, derivative / mapped[..., 2, None, None]), predicted - self._y

    def _step(self, transforms: Array, free: int, *, lens: bool) -> tuple[Array, float]:
        """The motions (V, 8) of one Gauss-Newton step, and the change of the distortion."""
        (predicted, derivative), residual = self._residuals(transforms)
        error_px = np.linalg.norm(residual, axis=2) * self._unit_px
        scale_px = max(SMALLEST_SCALE_PX, 2 * float(np.median(error_px[self._valid])))
        root = (self._valid * self._unit_px / (1 + (error_px / scale_px) ** 2))[..., None]
        # A motion of the right view moves its point away from under the mapped one.
        jacobian = np.concatenate([_times(derivative, generators(self._x, free)), -generators(predicted, free)], axis=3)
        residual = residual * root
        bending = self._bending(derivative) * root if lens else np.zeros_like(residual)
        rows = (jacobian * root[..., None]).reshape(len(self._pairs), -1, 2 * free)
        ends = np.stack([residual, bending], axis=-1).reshape(len(self._pairs), -1, 2)
        system = _BlockSystem(self._views, self._pairs, rows, ends)
        if free > MODELS["similarity"]:
            sigma = np.array([STRETCH_SIGMA, STRETCH_SIGMA, TILT_SIGMA, TILT_SIGMA])[: free - 4]
            shape = shapes(transforms)
            shape[:, :2] -= stretch_of_tilt(shape[:, 2:])
            system.add_prior(shape[:, : free - 4], 1 / sigma**2)
        motion = np.zeros((self._views, 8))
        solved, of_bending = system.solve(self._reference)
        if not lens:
            motion[:, :free] = solved
            return motion, 0.0
        # The motions are eliminated first (Schur complement): a change of the distortion moves them by of_bending.
        to_bending = system.target[..., 1]
        downhill = float(np.vdot(bending, residual) + np.vdot(to_bending, solved))
        change = -downhill / float(np.vdot(bending, bending) + np.vdot(to_bending, of_bending))
        change = float(np.clip(change, -LARGEST_CHANGE, LARGEST_CHANGE))
        motion[:, :free] = solved + change * of_bending
        return motion, change

    def _bending(self, derivative: Array) -> Array:
        """How the residuals change with the distortion, (L, N, 2)."""
        left, right = (bending_of(points, self.distortion) for points in (self._x, self._y))
        return np.asarray(_times(derivative, left[..., None])[..., 0] - right)


def _times(left: Array, right: Array) -> Array:
    """Products of matrices (..., 2, 2) and (..., 2, k); numpy's own takes several times as long for so small ones."""
    return np.asarray(left[..., :1] * right[..., :1, :] + left[..., 1:] * right[..., 1:, :])


class _BlockSystem:
    """Normal equations of a network: one block of unknowns a view, and two right-hand sides.

    Parameters
    ----------
    views : int
    pairs : ndarray of int, shape (L, 2)
        Left and right view of each link.
    rows : ndarray of float64, shape (L, N, 2 free)
        Derivatives of the residuals by the unknowns of the left and of the right view.
    ends : ndarray of float64, shape (L, N, 2)
        What the rows should explain.
    """

    def __init__(self, views: int, pairs: NDArray[np.intp], rows: Array, ends: Array) -> None:
        self._pairs = pairs
        self._free = free = rows.shape[2] // 2
        transposed = rows.transpose(0, 2, 1)
        normal, target = transposed @ rows, transposed @ ends
        self._diagonal = np.zeros((views, free, free))
        self.target = np.zeros((views, free, 2))
        for side in (0, 1):
            own = slice(side * free, (side + 1) * free)
            np.add.at(self._diagonal, pairs[:, side], normal[:, own, own])
            np.add.at(self.target, pairs[:, side], target[:, own])
        self._across = normal[:, :free, free:]

    def add_prior(self, values: Array, weights: Array) -> None:
        """Pull the last unknowns of every view so that ``values`` (V, k) become 0."""
        k = values.shape[1]
        self._diagonal[:, -k:, -k:] += np.diag(weights)
        self.target[:, -k:, 0] += values * weights

    def solve(self, reference: int) -> tuple[Array, Array]:
        """The unknowns (V, free) that lower each right-hand side; the first four of the reference are 0."""
        views, free, _ = self.target.shape
        corners = np.concatenate([np.stack([np.arange(views)] * 2, axis=1), self._pairs, self._pairs[:, ::-1]])
        blocks = np.concatenate([self._diagonal, self._across, self._across.transpose(0, 2, 1)])
        inner = np.arange(free)
        rows = np.broadcast_to(free * corners[:, 0, None, None] + inner[:, None], blocks.shape)
        columns = np.broadcast_to(free * corners[:, 1, None, None] + inner, blocks.shape)
        side = views * free
        matrix = csc_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(side, side))
        open_unknowns = np.ones(side, dtype=bool)
        open_unknowns[reference * free : reference * free + 4] = False
        solution = np.zeros((side, 2))
        kept = np.flatnonzero(open_unknowns)
        solution[kept] = -splu(matrix[kept][:, kept]).solve(self.target.reshape(side, 2)[kept])
        both = solution.reshape(views, free, 2)
        return both[..., 0], both[..., 1]


def generators(points: Array, count: int) -> Array:
    """How each of the first ``count`` motions moves each point: (..., 2) to (..., 2, count).

    Right, down, turn, grow; stretch along the axes and along the diagonals; tilt about y and about x.
    """
    x, y = points[..., 0], points[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    along_x = (one, zero, -y, x, x, y, -x * x, -x * y)
    along_y = (zero, one, x, y, -y, x, -x * y, -y * y)
    return np.stack([np.stack(along_x[:count], axis=-1), np.stack(along_y[:count], axis=-1)], axis=-2)


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
