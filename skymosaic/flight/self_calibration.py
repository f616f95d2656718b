"""Radial distortion of a flight's lens, estimated from the ties of its links.

A lens that bends straight lines bends every strip of a mosaic, and running lanes then meet with a step. One
coefficient of OpenCV's model, k1, removes most of it. Every second tie is fitted and the others are predicted: the
coefficient is used only if it predicts them clearly better.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from golden_model.arrays import Array, Pixels
from skymosaic.flight.adjustment import FOCAL_HALF_DIAGONALS, MODELS, Network
from skymosaic.flight.layout import LinkedGroup, normalisation
from skymosaic.flight.links import Link
from skymosaic.flight.view import View
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import Lens

FEWEST_VIEWS = 6
"""Fewer views leave the distortion to the tilts: a homography each can absorb most of it."""
LARGEST = 0.25
"""Bound of the displacement in the corners, as a share of the half diagonal; stronger lenses need a calibration."""
WANTED_GAIN = 0.95
"""The coefficient is used if the median error of held-out ties falls below this share: straightening costs detail."""
FIRST_STEP = 0.02
ACCURACY = 0.002
"""First step of the search, and the relative accuracy at which it ends."""
STRAIGHTENING_ROUNDS = 12


@dataclass(frozen=True)
class Calibration:
    """What was found about the lens.

    Attributes
    ----------
    distortion : float
        A point at distance r from the centre, in half diagonals, is displaced outwards by ``distortion * r^2`` of it.
    before_px, after_px : float
        Median error of the held-out ties without and with it, working px.
    lens : Lens
        The same as OpenCV's k1, for photographs of the flight's size.
    """

    distortion: float
    before_px: float
    after_px: float
    lens: Lens

    @property
    def focal_px(self) -> float:
        """Focal length that the coefficient refers to, px of the originals."""
        assert self.lens.matrix is not None
        return float(self.lens.matrix[0, 0])

    @property
    def k1(self) -> float:
        """OpenCV's coefficient, which depends on the focal length that `lens` assumes."""
        assert self.lens.distortion is not None
        return float(self.lens.distortion[0])


def calibrate(
    views: Sequence[View], members: Sequence[int], links: Sequence[Link], mask: Pixels | None = None
) -> Calibration | None:
    """Estimate the distortion that all views share.

    Parameters
    ----------
    views : sequence of View
        All views of the flight, as their lens made them.
    members : sequence of int
        The largest group of linked views, rising.
    links : sequence of Link
        Links that hold.
    mask : ndarray of uint8 or None
        Of the lens, see `Lens`.

    Returns
    -------
    Calibration or None
        None for few views, different sizes (different cameras), or where held-out ties do not improve.
    """
    sizes = {tuple(sorted(views[member].size)) for member in members}
    if len(members) < FEWEST_VIEWS or len(sizes) > 1:
        return None
    group = LinkedGroup(views, members, links)
    straight, bent = _Trial(group), _Trial(group)
    # Similarities converge from far away; homographies with a wrong distortion may not, so they come second.
    found = bent.search(0.0, "similarity")
    found = bent.search(found, "homography")
    if abs(found) > LARGEST:
        return None
    before, after = (float(np.median(trial.best_errors_px)) for trial in (straight.fitted(0.0), bent))
    if after > WANTED_GAIN * before:
        return None
    return Calibration(found, before, after, _lens(found, views[members[0]].size, mask))


class _Trial:
    """Fits every second tie with a distortion and predicts the others; each trial starts from the best one so far."""

    def __init__(self, group: LinkedGroup) -> None:
        self._group = group
        self._start = group.start
        self._least = np.inf
        self.best_errors_px = np.zeros(0)

    def fitted(self, distortion: float) -> _Trial:
        """This trial, with all models fitted for one distortion."""
        for model in MODELS:
            self._least = np.inf
            self._cost(distortion, model)
        return self

    def search(self, start: float, model: str) -> float:
        """The distortion near ``start`` with the least cost."""
        for simpler in itertools.takewhile(lambda name: name != model, MODELS):
            self._cost(start, simpler)
            self._least = np.inf
        self._least = np.inf
        bracket = (start, start + FIRST_STEP)
        found = minimize_scalar(self._cost, bracket=bracket, args=(model,), tol=ACCURACY)
        return float(found.x)

    def _cost(self, distortion: float, model: str) -> float:
        """Median error of the ties that were not fitted, working px; more than any beyond the bound."""
        if abs(distortion) > LARGEST:
            return 1e6 * abs(distortion)
        transforms = self._network(distortion, 0).adjust(self._start, model)
        errors = np.concatenate(self._network(distortion, 1).errors_px(transforms))
        cost = float(np.median(errors))
        if cost < self._least:
            self._least, self._start, self.best_errors_px = cost, transforms, errors
        return cost

    def _network(self, distortion: float, first: int) -> Network:
        return self._group.network(slice(first, None, 2), lambda points: straightened(points, distortion))


def straightened(points: Array, distortion: float) -> Array:
    """Points (N, 2) about the centre, in half diagonals, with the distortion taken out."""
    straight = points
    for _ in range(STRAIGHTENING_ROUNDS):
        straight = points / (1 + distortion * (straight**2).sum(axis=1, keepdims=True))
    return np.asarray(straight)


def straightened_links(links: Sequence[Link], views: Sequence[View], distortion: float) -> list[Link]:
    """The links with their ties where a lens without distortion would have shown them."""
    return [
        dataclasses.replace(
            link,
            left_points=_straightened_pixels(link.left_points, views[link.left], distortion),
            right_points=_straightened_pixels(link.right_points, views[link.right], distortion),
        )
        for link in links
    ]


def _straightened_pixels(points: Array, view: View, distortion: float) -> Array:
    matrix = normalisation(view.working_size)
    return apply(np.linalg.inv(matrix).astype(np.float64), straightened(apply(matrix, points), distortion))


def _lens(distortion: float, size: tuple[int, int], mask: Pixels | None) -> Lens:
    """As a camera file would describe it; the focal length is that of common drones (`FOCAL_HALF_DIAGONALS`)."""
    focal_px = FOCAL_HALF_DIAGONALS * float(np.hypot(*size)) / 2
    x, y = (size[0] - 1) / 2, (size[1] - 1) / 2
    matrix = np.array([[focal_px, 0, x], [0, focal_px, y], [0, 0, 1]])
    return Lens(
        size=size, matrix=matrix, distortion=np.array([distortion * FOCAL_HALF_DIAGONALS**2, 0, 0, 0, 0]), mask=mask
    )
