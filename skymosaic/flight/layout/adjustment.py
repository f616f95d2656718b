"""Global refinement of a flight: one transformation per view, fitted to the ties of all links at once.

Views and the ground are related by homographies (projective transformations, eight parameters). Each is refined
by small motions of the view's own pixels: two translations, rotation, scale (these four make a similarity), two
stretches (with them, affine) and two tilts. Coordinates are normalised: centred, in half diagonals of the view.

The ties alone leave some motions open; a prior decides these, see `skymosaic.flight.layout.expected_shape`.

The distortion of the lens, the same for all views, can be one more unknown, or four: OpenCV's k1 and k2 in units that
need no focal length, and the centre, see `skymosaic.flight.layout.motions.straighten`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array
from skymosaic.compositing.mesh import Ties
from skymosaic.flight.layout.expected_shape import are_possible, differences, expect
from skymosaic.flight.layout.motions import (
    NO_DISTORTION,
    bending_of,
    generators,
    multiply_small,
    squared_lengths,
    straighten,
    to_transforms,
)
from skymosaic.flight.layout.normal_equations import BlockSystem

MODELS = {"similarity": 4, "affine": 6, "homography": 8}
"""Motions that each model leaves free."""
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
DAMPING, FIRMER, MAX_DAMPING = 1e-6, 10.0, 1e6
"""Damping of a step that failed, its factor from one trial to the next, and where the layout stays as it is. The first
is weak: ties leave the tilt of the whole to the prior, so that a stronger one would hold it where it is, however wrong.
"""
MAX_RISE = 1e-3
"""Rise of the cost, as a share of it, that is no failure: one of a flight that converges is below 1e-5."""
MIN_DEPTH = 0.02
"""Smallest depth of a tie, where that of the middle of its view is 1: ground fifty times as far away."""
MAX_DISTORTION = np.array([0.25, 0.05, 0.1, 0.1])
"""Bounds of the displacements in the corners, and of the centre, as shares of the half diagonal: stronger lenses, which
would fold the picture, need a calibration."""
MAX_DISTORTION_CHANGE = 0.03
"""Bound of one step: far from the solution the ties are not nearly linear in the distortion."""


@dataclass(frozen=True, eq=False)
class Anchors:
    """Points of views whose places are known otherwise: where cameras were, or surveyed points."""

    views: NDArray[np.intp]
    """(N,): rows of the views."""
    points: Array
    places: Array
    """(N, 2): in normalised coordinates of the view and of the ground."""
    sigma: Array
    """(N,): standard deviation of the places, as they are given."""


class _Batch:
    """Some links of a network. All get the same number of rows, those beyond a link's ties without weight."""

    def __init__(self, ties: Sequence[Ties], unit_px: Array, distortion: Array) -> None:
        self.pairs = np.array([(tie.left, tie.right) for tie in ties], dtype=np.intp)
        self.counts = np.array([len(tie.left_points) for tie in ties], dtype=np.intp)
        self.valid = np.arange(self.counts.max()) < self.counts[:, None]
        self._points = np.zeros((2, *self.valid.shape, 2))
        for row, tie in enumerate(ties):
            self._points[:, row, : len(tie.left_points)] = tie.left_points, tie.right_points
        self._unit_px = unit_px[self.pairs[:, 1], None]
        self.straighten(distortion)

    def straighten(self, distortion: Array) -> None:
        """Take the distortion of the lens out of the ties."""
        self.left, self._right = straighten(self._points, distortion)

    def map(self, transforms: Array) -> tuple[Array, Array, Array]:
        """Map the left points into the right views, (L, N, 2), with their depth (L, N), by matrices (L, 3, 3, 1)."""
        left, right = transforms[self.pairs[:, 0]], transforms[self.pairs[:, 1]]
        between = (np.linalg.inv(right) @ left)[..., None]
        x, y = self.left[..., 0], self.left[..., 1]
        *place, depth = (between[:, row, 0] * x + between[:, row, 1] * y + between[:, row, 2] for row in range(3))
        return np.moveaxis(np.array(place) / depth, 0, -1), depth, between

    @np.errstate(invalid="ignore")
    def lower_to_depths(self, least: Array, transforms: Array) -> None:
        """Lower ``least`` (V,) to the depths of the ties in their views, that of the middle being 1, or to NaN."""
        for side, points in enumerate((self.left, self._right)):
            third = transforms[self.pairs[:, side], 2, :, None]
            depth = points[..., 0] * third[:, 0] + points[..., 1] * third[:, 1] + third[:, 2]
            np.minimum.at(least, self.pairs[:, side], depth.min(axis=1))

    def errors_px(self, predicted: Array) -> Array:
        """Distance of each mapped left point from its right one, (L, N), in working px of the right view."""
        return np.asarray(np.sqrt(squared_lengths(predicted - self._right)[..., 0]) * self._unit_px)

    def across_px(self, predicted: Array, between: Array) -> Array:
        """The part of `errors_px` across the way from the right view to the left one."""
        # The place of the left view's middle, but for the depth.
        x, y = between[:, 0, 2], between[:, 1, 2]
        off = predicted - self._right
        return np.asarray(np.abs(off[..., 0] * y - off[..., 1] * x) / np.hypot(x, y) * self._unit_px)

    def equations(
        self, transforms: Array, free: int, scale_px: float, distortion: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Normal equations of each link, and the weighted residuals and their derivatives by the distortion's terms."""
        predicted, depth, between = self.map(transforms)
        root = (self.valid * self._unit_px / (1 + (self.errors_px(predicted) / scale_px) ** 2))[..., None]
        places = [[between[:, row, k] - predicted[..., row] * between[:, 2, k] for k in (0, 1)] for row in (0, 1)]
        # In memory, all points of an element follow each other, as those of `generators` do.
        derivative = np.moveaxis(np.array(places) / depth, (0, 1), (-2, -1))
        residual = (predicted - self._right) * root
        bending = np.zeros((*residual.shape, len(distortion)))
        if len(distortion):
            left, right = (bending_of(points, distortion) for points in (self.left, self._right))
            bending = (multiply_small(derivative, left) - right) * root[..., None]
        # Left points are mapped into the right view, not both onto the ground: there, shrinking all views would
        # help. A motion of the right view moves its point away from under the mapped one.
        by_left = multiply_small(derivative, generators(self.left, free))
        jacobian = np.concatenate([by_left, -generators(predicted, free)], axis=3) * root[..., None]
        rows = jacobian.reshape(len(self.pairs), -1, 2 * free)
        targets = np.concatenate([residual[..., None], bending], axis=-1)
        targets = targets.reshape(len(self.pairs), -1, 1 + len(distortion))
        transposed = rows.transpose(0, 2, 1)
        return transposed @ rows, transposed @ targets, residual, bending


class Network:
    """The ties of a flight, ready for adjustments.

    Parameters
    ----------
    ties : iterable of Ties
        By the rows of the views, in normalised coordinates. Copied link by link, so that they need not be in memory
        together.
    units_px : sequence of float
        Half diagonal of each view, in working px.
    reference : int
        The view whose position, rotation and scale stay fixed.
    distortion : ndarray of float64, at most (4,)
        Distortion of the lens, see `straighten`, from which `adjust` starts.

    Attributes
    ----------
    distortion : ndarray of float64
        As given, or as `adjust` estimated it.
    """

    def __init__(
        self, ties: Iterable[Ties], units_px: Sequence[float], reference: int, distortion: Array = NO_DISTORTION
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

    def across_px(self, transforms: Array) -> list[Array]:
        """The part of each error across the way between the middles of its views: height, as of relief, has none."""
        return [
            row[:count]
            for batch in self._batches
            for row, count in zip(batch.across_px(*batch.map(transforms)[::2]), batch.counts, strict=True)
        ]

    def cost(self, model: str, transforms: Array) -> float:
        """How badly transformations (V, 3, 3) explain the ties, and how far they are from what a camera would see."""
        prior = expect(transforms, MODELS[model] - MODELS["similarity"])
        return _cost(transforms, np.concatenate(self.errors_px(transforms)), MIN_SCALE_PX, prior, anchors=None)

    def adjust(
        self,
        start: Array,
        model: str,
        *,
        max_steps: int = MAX_STEPS,
        from_px: float = 0.0,
        anchors: Anchors | None = None,
    ) -> Array:
        """Refine the transformations (V, 3, 3), view to ground, and the distortion, by reweighted Gauss-Newton steps.

        Every step weighs the ties by 1 / (1 + e²/s²)² (Geman-McClure), s falling with the median residual.

        Parameters
        ----------
        start : ndarray of float64, shape (V, 3, 3)
        model : str
            A key of `MODELS`.
        max_steps : int
        from_px : float
            Scale s of the first step, at least; it is annealed before the ``max_steps`` begin. Near the final scale
            alone, links that the first guess placed badly would hardly count, whether they are true or not.
        anchors : Anchors or None
            More observations, each weighed by its accuracy and robustly, as ties are: an outlier hardly counts.
        """
        transforms, errors_px = start, np.concatenate(self.errors_px(start))
        damping = np.zeros(len(start))
        annealed = max(0, math.ceil(math.log(MIN_SCALE_PX / from_px, COOLING))) if from_px else 0
        for step in range(annealed + max_steps):
            least_px = max(MIN_SCALE_PX, from_px * COOLING**step)
            scale_px = max(least_px, 2 * float(np.median(errors_px)))
            transforms, errors_px, motion = self._step(
                transforms, errors_px, MODELS[model], scale_px, damping, anchors=anchors
            )
            if step >= annealed and motion * self._unit_px.max() < CONVERGED_PX:
                break
        return transforms

    def _step(
        self, start: Array, errors_px: Array, free: int, scale_px: float, damping: Array, *, anchors: Anchors | None
    ) -> tuple[Array, Array, float]:
        """Take a step; returns the transformations, the errors of all ties and the largest motion.

        It is damped (Levenberg-Marquardt) where it fails: views that it would make impossible, and all of them where it
        would raise the cost. ``damping`` (V,) is that of the last step, and becomes that of this one.
        """
        prior = expect(start, free - MODELS["similarity"])
        system = self._linearise(start, free, scale_px, prior, anchors)
        cost = _cost(start, errors_px, scale_px, prior, anchors)
        distortion, allowed = self.distortion, np.minimum(MIN_DEPTH, self._least_depths(start))
        damping[:] = np.where(damping > DAMPING, damping / FIRMER, 0)
        while damping.max() <= MAX_DAMPING:
            motion, change = system.solve(self._reference, damping, MAX_DISTORTION_CHANGE)
            # Motions are of the view's own pixels, so they come first: a tilt is the same wherever the view lies.
            transforms = start @ to_transforms(np.pad(motion, ((0, 0), (0, 8 - free))))
            transforms = transforms / transforms[:, 2:, 2:]
            self._set_distortion(distortion + change)
            failing = ~(are_possible(transforms) & (self._least_depths(transforms) >= allowed))
            if not failing.any():
                new_errors_px = np.concatenate(self.errors_px(transforms))
                if _cost(transforms, new_errors_px, scale_px, prior, anchors) <= (1 + MAX_RISE) * cost:
                    return transforms, new_errors_px, float(np.abs(motion).max())
                failing[:] = True
            damping[failing] = np.maximum(FIRMER * damping[failing], DAMPING)
        self._set_distortion(distortion)
        return start, errors_px, 0.0

    def _linearise(
        self, transforms: Array, free: int, scale_px: float, prior: Array, anchors: Anchors | None
    ) -> BlockSystem:
        """Set up the normal equations of a Gauss-Newton step, each tie weighted by its error."""
        blocks, downhill, curvature = [], np.zeros(len(self.distortion)), np.zeros([len(self.distortion)] * 2)
        for batch in self._batches:
            *block, residual, bending = batch.equations(transforms, free, scale_px, self.distortion)
            blocks.append(block)
            # Not BLAS, whose sums depend on the number of its threads, and with them the layout.
            downhill += (bending * residual[..., None]).sum(axis=(0, 1, 2))
            curvature += (bending[..., None] * bending[..., None, :]).sum(axis=(0, 1, 2))
        normal, target = map(np.concatenate, zip(*blocks, strict=True))
        system = BlockSystem(len(self._unit_px), self._pairs, normal, target, shared=(downhill, curvature))
        if anchors is not None:
            system.add_observations(anchors.views, *_anchor_rows(transforms, anchors, free))
        if free > MODELS["similarity"]:
            system.add_prior(differences(transforms, prior.shape[1]), prior)
        return system

    def _set_distortion(self, distortion: Array) -> None:
        limit = MAX_DISTORTION[: len(distortion)]
        self.distortion = np.clip(distortion, -limit, limit)
        for batch in self._batches:
            batch.straighten(self.distortion)

    def _least_depths(self, transforms: Array) -> Array:
        """The least depth of the ties of each view, (V,). What else it shows may lie beyond the horizon."""
        least = np.ones(len(transforms))
        for batch in self._batches:
            batch.lower_to_depths(least, transforms)
        return least


def _cost(transforms: Array, errors_px: Array, scale_px: float, prior: Array, anchors: Anchors | None) -> float:
    """What a step should lower: the robust errors of ties and anchors, squared, and what the prior does not expect."""
    cost = _robust(errors_px**2, scale_px) + float((differences(transforms, prior.shape[1]) ** 2 * prior).sum())
    if anchors is not None:
        cost += _robust(squared_lengths(_anchor_errors(transforms, anchors)[0]), ANCHOR_SCALE)
    return cost


def _robust(squared: Array, scale: float) -> float:
    """The sum of squared errors, each limited to the square of the scale."""
    return float((squared / (1 + squared / scale**2)).sum())


def _anchor_rows(transforms: Array, anchors: Anchors, free: int) -> tuple[Array, Array]:
    """Derivatives (N, 2, free) and residuals (N, 2) of anchors, in their standard deviations and robustly weighted."""
    residual, derivative = _anchor_errors(transforms, anchors)
    root = 1 / (1 + (residual**2).sum(axis=1) / ANCHOR_SCALE**2)
    rows = multiply_small(derivative, generators(anchors.points, free)) * (root / anchors.sigma)[:, None, None]
    return rows, residual * root[:, None]


def _anchor_errors(transforms: Array, anchors: Anchors) -> tuple[Array, Array]:
    """How far anchors are from their places (N, 2), in their standard deviations, and the derivative of the places."""
    matrix = transforms[anchors.views]
    mapped = (matrix[:, :, :2] @ anchors.points[..., None])[..., 0] + matrix[..., 2]
    place = mapped[:, :2] / mapped[:, 2:]
    derivative = (matrix[:, :2, :2] - place[..., None] * matrix[:, 2:, :2]) / mapped[:, 2, None, None]
    return (place - anchors.places) / anchors.sigma[:, None], derivative
