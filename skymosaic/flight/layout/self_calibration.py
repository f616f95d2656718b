"""Radial distortion of a flight's lens, estimated from the ties of its links.

A lens that bends straight lines bends every strip of a mosaic, and running lanes then meet with a step. One
coefficient of OpenCV's model, k1, removes most of it. Every second tie is fitted and the others are predicted: the
coefficient is used only if it predicts them clearly better.

Features of bent photographs are a little off towards the borders, which makes the coefficient 0.2 % too small in
rendered flights. What distortion remains between features of the straightened photographs is therefore added to it.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.flight.layout.adjustment import MAX_DISTORTION, MAX_STEPS, MODELS, Network
from skymosaic.flight.layout.linked_group import LinkedGroup, linked_group, normalisation
from skymosaic.flight.layout.motions import FOCAL_HALF_DIAGONALS, straighten
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import Lens
from skymosaic.running.cache import NO_CACHE, ResultCache, key_of

MIN_VIEWS = 6
"""Fewer views leave the distortion to the tilts: a homography each can absorb most of it."""
MAX_ERROR_RATIO = 0.95
"""The coefficient is used if the median error of held-out ties falls below this share: straightening costs detail."""
TRIAL_TIES_PER_LINK = 100
"""More ties per link show no better whether a distortion helps, but take longer."""
AFFINE_STEPS = 4
"""Steps of the affine model, which only leads from similarities to homographies."""


@dataclass(frozen=True)
class Calibration:
    """The lens estimated from tie points."""

    distortion: float
    """A point at distance r from the centre, in half diagonals, is displaced outwards by ``distortion * r^2`` of it."""
    before_px: float
    after_px: float
    """Median error of the held-out ties without and with it, working px."""
    lens: Lens
    """The same as OpenCV's k1, for photographs of the flight's size."""

    def with_remaining(self, distortion: float) -> Calibration:
        """Add the distortion that is left once ``lens`` has straightened the photographs."""
        assert self.lens.size is not None
        whole = self.distortion + distortion
        return dataclasses.replace(self, distortion=whole, lens=_lens(whole, self.lens.size, self.lens.mask))

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

    @property
    def camera_file(self) -> str:
        """The lens as a file that `skymosaic.imagery.lens.load_lens` reads."""
        errors = f"{self.before_px:.2f} px without k1, {self.after_px:.2f} px with it"
        return f"# Median error of held-out ties: {errors}.\n{self.lens.to_toml()}"


def calibrate(
    views: Sequence[View],
    members: Sequence[int],
    links: Sequence[Link],
    mask: Pixels | None = None,
    cache: ResultCache = NO_CACHE,
) -> Calibration | None:
    """Estimate the distortion that all views share, by the largest group of linked views and by links that hold.

    None for few views, different sizes (different cameras), or where held-out ties do not improve. The cache keeps the
    result for the next run with the same links.
    """
    sizes = {tuple(sorted(views[member].size)) for member in members}
    if len(members) < MIN_VIEWS or len(sizes) > 1:
        return None
    group = linked_group(views, members, links)
    before_px, after_px, distortion = _load_or_measure(_measure, group, cache)
    if abs(distortion) >= MAX_DISTORTION or after_px > MAX_ERROR_RATIO * before_px:
        return None
    return Calibration(distortion, before_px, after_px, _lens(distortion, views[members[0]].size, mask))


def measure_remaining_distortion(
    views: Sequence[View], members: Sequence[int], links: Sequence[Link], cache: ResultCache = NO_CACHE
) -> float:
    """Measure the distortion between straightened photographs, as `calibrate` does."""
    group = linked_group(views, members, links)
    (distortion,) = _load_or_measure(_measure_remaining, group, cache)
    return distortion


def _load_or_measure(
    measure: Callable[[LinkedGroup], tuple[float, ...]], group: LinkedGroup, cache: ResultCache
) -> tuple[float, ...]:
    """Call ``measure``, or load its result from the cache where sizes and ties are those of an earlier run."""
    key = key_of(measure, group.units_px, _digest(group.links))
    arrays = cache.load(key)
    if arrays is None:
        arrays = {"numbers": np.array(measure(group))}
        cache.save(key, arrays)
    return tuple(arrays["numbers"].tolist())


def _digest(links: Sequence[Link]) -> str:
    """A hash of the views that the links join and of their ties."""
    state = hashlib.sha256()
    for link in links:
        state.update(repr((link.left, link.right)).encode() + link.left_points.tobytes() + link.right_points.tobytes())
    return state.hexdigest()


def _measure(group: LinkedGroup) -> tuple[float, float, float]:
    """The median error of held-out ties without and with a distortion, working px, and the distortion by all ties."""
    before_px, _, _ = _try(group, lens=False)
    after_px, distortion, transforms = _try(group, lens=True)
    whole = group.network(slice(None), distortion=distortion)
    whole.adjust(transforms, "homography", lens=True)
    return before_px, after_px, whole.distortion


def _measure_remaining(group: LinkedGroup) -> tuple[float]:
    whole = group.network(slice(None))
    _fit(whole, group.start, lens=True)
    return (whole.distortion,)


def _try(group: LinkedGroup, *, lens: bool) -> tuple[float, float, Array]:
    """Fit every second tie; the median error of the others, working px, the distortion and the transformations."""
    fitted = group.network(slice(0, None, 2), TRIAL_TIES_PER_LINK)
    transforms = _fit(fitted, group.start, lens=lens)
    held_out = group.network(slice(1, None, 2), TRIAL_TIES_PER_LINK, fitted.distortion)
    return float(np.median(np.concatenate(held_out.errors_px(transforms)))), fitted.distortion, transforms


def _fit(network: Network, start: Array, *, lens: bool) -> Array:
    """Fit one model after the other."""
    # Similarities converge from far away; homographies with a wrong distortion may not, so they come last.
    transforms = start
    for model in MODELS:
        steps = AFFINE_STEPS if model == "affine" else MAX_STEPS
        transforms = network.adjust(transforms, model, max_steps=steps, lens=lens)
    return transforms


def straighten_links(
    links: Sequence[Link], views: Sequence[View], distortion: Mapping[int, float]
) -> dict[Candidate, Link]:
    """Move the ties to where a lens without distortion would have shown them; the links by their pairs.

    ``distortion`` is that of each view's lens; views without one keep their ties.
    """
    moves = {
        member: partial(_straighten_pixels, view=view, distortion=distortion.get(member, 0.0))
        for member, view in enumerate(views)
    }
    return {(link.left, link.right): link.move(moves[link.left], moves[link.right]) for link in links}


def _straighten_pixels(points: Array, *, view: View, distortion: float) -> Array:
    matrix = normalisation(view.working_size)
    return apply(np.linalg.inv(matrix).astype(np.float64), straighten(apply(matrix, points), distortion))


def _lens(distortion: float, size: tuple[int, int], mask: Pixels | None) -> Lens:
    """The lens as a camera file describes it; the focal length is that of common drones."""
    focal_px = FOCAL_HALF_DIAGONALS * float(np.hypot(*size)) / 2
    x, y = (size[0] - 1) / 2, (size[1] - 1) / 2
    matrix = np.array([[focal_px, 0, x], [0, focal_px, y], [0, 0, 1]])
    coefficients = np.array([distortion * FOCAL_HALF_DIAGONALS**2, 0, 0, 0, 0])
    return Lens(size=size, matrix=matrix, distortion=coefficients, mask=mask)
