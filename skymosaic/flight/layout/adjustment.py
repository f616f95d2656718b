"""Global refinement of a flight: one transformation per view, fitted to the ties of all links at once.

Views and the ground are related by homographies (projective transformations, eight parameters). Each is refined
by small motions of the view's own pixels: two translations, rotation, scale (these four make a similarity), two
stretches (with them, affine) and two tilts. Coordinates are normalised: centred, in half diagonals of the view.

The ties alone leave some motions open, above all a bending of the whole mosaic. A prior decides these: over flat
ground a camera that looks down sees a similarity, except for a little tilt and the stretch that follows from it.
The stretch and tilt of all views thereby define the ground plane.

The radial distortion of the lens, the same for all views, can be one more unknown: one coefficient, which is OpenCV's
k1 in units that need no focal length.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from skymosaic.flight.layout.motions import (
    bending_of,
    generators,
    multiply_small,
    shapes,
    squared_lengths,
    straighten,
    stretch_of_tilt,
    to_transforms,
)
from skymosaic.flight.layout.normal_equations import BlockSystem, normal_blocks

MODELS = {"similarity": 4, "affine": 6, "homography": 8}
"""Motions that each model leaves free."""
STRETCH_SIGMA = 1e-3
"""Expected stretch beside what the tilt explains."""
STRETCH_ERROR = 0.2
"""Standard deviation of the stretch that the tilt explains, as a share of it: the focal length is hardly known."""
TILT_SIGMA = 0.05
"""Expected perspective: the tangent of the tilt over the focal length in half diagonals; about 3 degrees."""
MIN_SCALE_PX = 1.5
"""Scale of the robust loss once the residuals are small; before that, twice their median."""
WIDEST_SCALE_PX = 200.0
"""Scale from which the robust loss is annealed: a link that the first guess placed this badly still counts."""
COOLING = 0.5
"""Factor of the annealed scale from one step to the next."""
ANCHOR_SCALE = 4.0
"""Scale of the robust loss of anchors, in their standard deviations."""
LINKS_AT_ONCE = 64
"""Links whose ties are in arrays together: derivatives of all links would take a megabyte per view."""
MAX_STEPS = 15
CONVERGED_PX = 0.01
MAX_DISTORTION = 0.25
"""Bound of the displacement in the corners, as a share of the half diagonal; stronger lenses need a calibration."""
MAX_DISTORTION_CHANGE = 0.03
"""Bound of one step: far from the solution the ties are not nearly linear in the distortion."""


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


@dataclass(frozen=True, eq=False)
class Anchors:
    """Points of views whose places are known otherwise: where cameras were, or surveyed points.

    Attributes
    ----------
    views : ndarray of int, shape (N,)
        Rows of the views.
    points, places : ndarray of float64, shape (N, 2)
        In normalised coordinates of the view and of the ground.
    sigma : ndarray of float64, shape (N,)
        Standard deviation of the places, as they are given.
    """

    views: NDArray[np.intp]
    points: Array
    places: Array
    sigma: Array


class _Batch:
    """Some links of a network. All get the same number of rows, those beyond a link's ties without weight."""

    def __init__(self, ties: Sequence[Ties], unit_px: Array, distortion: float) -> None:
        self.pairs = np.array([(tie.left, tie.right) for tie in ties], dtype=np.intp)
        self.counts = np.array([len(tie.left_points) for tie in ties], dtype=np.intp)
        self.valid = np.arange(self.counts.max()) < self.counts[:, None]
        self._points = np.zeros((2, *self.valid.shape, 2))
        for row, tie in enumerate(ties):
            self._points[:, row, : len(tie.left_points)] = tie.left_points, tie.right_points
        self._unit_px = unit_px[self.pairs[:, 1], None]
        self.straighten(distortion)

    def straighten(self, distortion: float) -> None:
        """Take the distortion of the lens out of the ties."""
        self.left, self._right = self._points if distortion == 0 else straighten(self._points, distortion)

    def map(self, transforms: Array) -> tuple[Array, Array, Array]:
        """Map the left points into the right views, (L, N, 2), with their depth (L, N), by matrices (L, 3, 3, 1)."""
        left, right = transforms[self.pairs[:, 0]], transforms[self.pairs[:, 1]]
        between = (np.linalg.inv(right) @ left)[..., None]
        x, y = self.left[..., 0], self.left[..., 1]
        *place, depth = (between[:, row, 0] * x + between[:, row, 1] * y + between[:, row, 2] for row in range(3))
        return np.moveaxis(np.array(place) / depth, 0, -1), depth, between

    def errors_px(self, predicted: Array) -> Array:
        """Distance of each mapped left point from its right one, (L, N), in working px of the right view."""
        return np.asarray(np.sqrt(squared_lengths(predicted - self._right)[..., 0]) * self._unit_px)

    def equations(
        self, transforms: Array, free: int, scale_px: float, distortion: float | None
    ) -> tuple[Array, Array, Array, Array]:
        """Normal equations of each link, and the weighted residuals and their derivative by the distortion, if any."""
        predicted, depth, between = self.map(transforms)
        root = (self.valid * self._unit_px / (1 + (self.errors_px(predicted) / scale_px) ** 2))[..., None]
        rows = [[between[:, row, k] - predicted[..., row] * between[:, 2, k] for k in (0, 1)] for row in (0, 1)]
        # In memory, all points of an element follow each other, as those of `generators` do.
        derivative = np.moveaxis(np.array(rows) / depth, (0, 1), (-2, -1))
        residual = (predicted - self._right) * root
        bending = np.zeros_like(residual)
        if distortion is not None:
            left, right = (bending_of(points, distortion) for points in (self.left, self._right))
            bending = (multiply_small(derivative, left[..., None])[..., 0] - right) * root
        # Left points are mapped into the right view, not both onto the ground: there, shrinking all views would
        # help. A motion of the right view moves its point away from under the mapped one.
        by_left = multiply_small(derivative, generators(self.left, free))
        jacobian = np.concatenate([by_left, -generators(predicted, free)], axis=3) * root[..., None]
        targets = np.stack([residual, bending], axis=-1).reshape(len(self.pairs), -1, 2)
        return *normal_blocks(jacobian.reshape(len(jacobian), -1, 2 * free), targets), residual, bending


class Network:
    """The ties of a flight, ready for adjustments.

    Parameters
    ----------
    ties : iterable of Ties
        Copied link by link, so that they need not be in memory together.
    units_px : sequence of float
        Half diagonal of each view, in working px.
    reference : int
        The view whose position, rotation and scale stay fixed.
    distortion : float
        Distortion of the lens, see `straighten`.

    Attributes
    ----------
    distortion : float
        As given, or as `adjust` estimated it.
    """

    def __init__(
        self, ties: Iterable[Ties], units_px: Sequence[float], reference: int, distortion: float = 0.0
    ) -> None:
        self.distortion = distortion
        self._unit_px = np.asarray(units_px, dtype=np.float64)
        self._reference = reference
        ties = iter(ties)
        batches = iter(lambda: list(islice(ties, LINKS_AT_ONCE)), [])
        self._batches = [_Batch(batch, self._unit_px, distortion) for batch in batches]
        self._pairs = np.concatenate([batch.pairs for batch in self._batches])

    def errors_px(self, transforms: Array) -> list[Array]:
        """Distance of each tie's mapped left point from its right one, by link, in working px of the right view."""
        return [
            row[:count]
            for batch in self._batches
            for row, count in zip(batch.errors_px(batch.map(transforms)[0]), batch.counts, strict=True)
        ]

    def adjust(
        self,
        start: Array,
        model: str,
        *,
        max_steps: int = MAX_STEPS,
        lens: bool = False,
        from_px: float = 0.0,
        anchors: Anchors | None = None,
    ) -> Array:
        """Refine the transformations (V, 3, 3), view to ground, by reweighted Gauss-Newton steps.

        Every step weighs the ties by 1 / (1 + e²/s²)² (Geman-McClure), s falling with the median residual.

        Parameters
        ----------
        start : ndarray of float64, shape (V, 3, 3)
        model : str
            A key of `MODELS`.
        max_steps : int
        lens : bool
            Whether the distortion of the lens is one more unknown; `distortion` is then set.
        from_px : float
            Scale s of the first step, at least; it is annealed before the ``max_steps`` begin. Near the final scale
            alone, links that the first guess placed badly would hardly count, whether they are true or not.
        anchors : Anchors or None
            More observations, each weighed by its accuracy and robustly, as ties are: an outlier hardly counts.
        """
        transforms = start
        annealed = max(0, math.ceil(math.log(MIN_SCALE_PX / from_px, COOLING))) if from_px else 0
        for step in range(annealed + max_steps):
            least_px = max(MIN_SCALE_PX, from_px * COOLING**step)
            motion, change = self._step(transforms, MODELS[model], least_px, lens=lens, anchors=anchors)
            # Motions are of the view's own pixels, so they come first: a tilt is the same wherever the view lies.
            transforms = transforms @ to_transforms(motion)
            transforms = transforms / transforms[:, 2:, 2:]
            if lens:
                self.distortion = float(np.clip(self.distortion + change, -MAX_DISTORTION, MAX_DISTORTION))
                for batch in self._batches:
                    batch.straighten(self.distortion)
            if step >= annealed and np.abs(motion).max() * self._unit_px.max() < CONVERGED_PX:
                break
        return transforms

    def _step(
        self, transforms: Array, free: int, least_px: float, *, lens: bool, anchors: Anchors | None
    ) -> tuple[Array, float]:
        """Compute the motions (V, 8) of one Gauss-Newton step, and the change of the distortion."""
        scale_px = max(least_px, 2 * float(np.median(np.concatenate(self.errors_px(transforms)))))
        blocks, downhill, curvature = [], 0.0, 0.0
        for batch in self._batches:
            *block, residual, bending = batch.equations(transforms, free, scale_px, self.distortion if lens else None)
            blocks.append(block)
            # Not BLAS, whose sums depend on the number of its threads, and with them the layout.
            downhill += float((bending * residual).sum())
            curvature += float((bending * bending).sum())
        normal, target = map(np.concatenate, zip(*blocks, strict=True))
        system = BlockSystem(len(self._unit_px), self._pairs, normal, target)
        if anchors is not None:
            system.add_observations(anchors.views, *_anchor_rows(transforms, anchors, free))
        if free > MODELS["similarity"]:
            shape = shapes(transforms)
            expected = stretch_of_tilt(shape[:, 2:])
            shape[:, :2] -= expected
            sigma = np.empty_like(shape)
            sigma[:, :2] = np.hypot(STRETCH_SIGMA, STRETCH_ERROR * np.linalg.norm(expected, axis=1))[:, None]
            sigma[:, 2:] = np.maximum(TILT_SIGMA, np.abs(shape[:, 2:]))
            system.add_prior(shape[:, : free - 4], 1 / sigma[:, : free - 4] ** 2)
        motion = np.zeros((len(self._unit_px), 8))
        still, per_change = system.solve(self._reference)
        change = 0.0
        if lens:
            # The motions are eliminated (Schur complement): `still` if the distortion stays, and per change of it.
            downhill += float((system.target[..., 1] * still).sum())
            curvature += float((system.target[..., 1] * per_change).sum())
            change = float(np.clip(-downhill / curvature, -MAX_DISTORTION_CHANGE, MAX_DISTORTION_CHANGE))
        motion[:, :free] = still + change * per_change
        return motion, change


def _anchor_rows(transforms: Array, anchors: Anchors, free: int) -> tuple[Array, Array]:
    """Derivatives (N, 2, free) and residuals (N, 2) of anchors, in their standard deviations and robustly weighted."""
    matrix = transforms[anchors.views]
    mapped = (matrix[:, :, :2] @ anchors.points[..., None])[..., 0] + matrix[..., 2]
    place = mapped[:, :2] / mapped[:, 2:]
    derivative = (matrix[:, :2, :2] - place[..., None] * matrix[:, 2:, :2]) / mapped[:, 2, None, None]
    residual = (place - anchors.places) / anchors.sigma[:, None]
    root = 1 / (1 + (residual**2).sum(axis=1) / ANCHOR_SCALE**2)
    rows = multiply_small(derivative, generators(anchors.points, free)) * (root / anchors.sigma)[:, None, None]
    return rows, residual * root[:, None]
