"""Distortion of a flight's lens, estimated from the ties of its links.

A lens that bends straight lines bends every strip of a mosaic, and running lanes then meet with a step. One
coefficient of OpenCV's model, k1, removes most of it. Where it helps, k2 and the centre of the lens are tried, too:
strong lenses need them. Every second tie is fitted and the others are predicted: what is estimated is used only if it
predicts them clearly better across the way from one photograph to the next. Along it, a lens may explain relief.

Near the borders of bent photographs features are a little off and fewer match, so that the coefficient comes out 0.2 %
too small in rendered flights, and 4 to 12 % smaller in public ones than by features of the straightened photographs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from golden_model.arrays import Array, Pixels
from golden_model.cache import NO_CACHE, Cache
from skymosaic.flight.layout.adjustment import MAX_DISTORTION, MAX_STEPS, MODELS, Network
from skymosaic.flight.layout.linked_group import LinkedGroup, linked_group, normalisation
from skymosaic.flight.layout.motions import FOCAL_HALF_DIAGONALS, NO_DISTORTION, straighten
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.orientation import UPRIGHT
from skymosaic.running.cache import key_of

MIN_VIEWS = 6
"""Fewer views leave the distortion to the tilts: a homography each can absorb most of it."""
MAX_ERROR_RATIO = 0.95
"""Terms are used if held-out ties are off by less than this share across the baseline, median: straightening costs
detail, and along the baseline relief looks like a lens, to fitted and to held-out ties alike."""
TRIAL_TIES_PER_LINK = 100
"""More ties per link show no better whether a distortion helps, but take longer."""
AFFINE_STEPS = 4
"""Steps of the affine model, which only leads from similarities to homographies."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """The lens estimated from tie points."""

    distortion: Array
    """(1,) or (4,): k1, or k1, k2 and the centre, see `skymosaic.flight.layout.motions.straighten`."""
    before_px: float
    after_px: float
    """Median error of the held-out ties without and with it, working px."""
    upright: Lens
    """The same for photographs of the flight's size, upright."""
    orientation: int = UPRIGHT
    """EXIF orientation of the photographs."""

    @cached_property
    def lens(self) -> Lens:
        """The same as a camera file describes it, for photographs as they are stored."""
        return self.upright.turned_back(self.orientation)

    @property
    def camera_file(self) -> str:
        """The lens as a file that `skymosaic.imagery.lens.load_lens` reads."""
        errors = f"{self.before_px:.2f} px without distortion, {self.after_px:.2f} px with it"
        lines = (f"{key} = {value}\n" for key, value in self.lens.numbers.items())
        return f"# Median error of held-out ties: {errors}.\n{''.join(lines)}"


def calibrate(
    views: Sequence[View],
    members: Sequence[int],
    links: Sequence[Link],
    mask: Pixels | None = None,
    cache: Cache = NO_CACHE,
) -> Calibration | None:
    """Estimate the distortion that all views share, by the largest group of linked views and by links that hold.

    None for few views, different sizes (different cameras), or where held-out ties do not improve. The cache keeps the
    result for the next run with the same links.
    """
    sizes = {tuple(sorted(views[member].size)) for member in members}
    if len(members) < MIN_VIEWS or len(sizes) > 1:
        return None
    group = linked_group(views, members, links)
    # Where photographs were turned in several ways, the centre of the lens is in several places.
    most = 4 if len({(views[member].size, views[member].orientation) for member in members}) == 1 else 1
    key = key_of(_measure, group.units_px, _digest(group.links), most)
    if (arrays := cache.load(key)) is None:
        arrays = {"numbers": _measure(group, most)}
        cache.save(key, arrays)
    before_px, after_px, *distortion = arrays["numbers"].tolist()
    if not distortion:
        return None
    distortion = np.array(distortion)
    first = views[members[0]]
    return Calibration(distortion, before_px, after_px, _lens(distortion, first.size, mask), first.orientation)


def _digest(links: Sequence[Link]) -> str:
    """A hash of the views that the links join and of their ties."""
    state = hashlib.sha256()
    for link in links:
        state.update(repr((link.left, link.right)).encode() + link.left_points.tobytes() + link.right_points.tobytes())
    return state.hexdigest()


def _measure(group: LinkedGroup, most: int) -> Array:
    """The median error of held-out ties without and with a distortion, working px, and the distortion by all ties.

    Of 1 and of 4 terms, if there may be so many, the more are used if they predict clearly better than the fewer.
    """
    (before_px, across_px), distortion, transforms = _try(group, NO_DISTORTION, None)
    after_px = before_px
    for terms in sorted({1, most}):
        start = transforms if len(distortion) else None
        found_px, *found = _try(group, np.pad(distortion, (0, terms - len(distortion))), start)
        if found_px[1] > MAX_ERROR_RATIO * across_px or (np.abs(found[0]) >= MAX_DISTORTION[:terms]).any():
            break
        (after_px, across_px), (distortion, transforms) = found_px, found
    if len(distortion):
        whole = group.network(slice(None), distortion=distortion)
        whole.adjust(transforms, "homography")
        distortion = whole.distortion
    return np.array([before_px, after_px, *distortion])


def _try(group: LinkedGroup, distortion: Array, start: Array | None) -> tuple[Array, Array, Array]:
    """Fit every second tie; the median error of the others, working px, the distortion and the transformations.

    Errors (2,) are whole ones and their part across the baseline. Begins from a distortion, and from homographies that
    were fitted with it, if any.
    """
    fitted = group.network(slice(0, None, 2), TRIAL_TIES_PER_LINK, distortion)
    transforms = _fit(fitted, group.start) if start is None else fitted.adjust(start, "homography")
    held_out = group.network(slice(1, None, 2), TRIAL_TIES_PER_LINK, fitted.distortion)
    errors_px = np.array(
        [np.median(np.concatenate(each(transforms))) for each in (held_out.errors_px, held_out.across_px)]
    )
    return errors_px, fitted.distortion, transforms


def _fit(network: Network, start: Array) -> Array:
    """Fit one model after the other."""
    # Similarities converge from far away; homographies with a wrong distortion may not, so they come last.
    transforms = start
    for model in MODELS:
        steps = AFFINE_STEPS if model == "affine" else MAX_STEPS
        transforms = network.adjust(transforms, model, max_steps=steps)
    return transforms


def straighten_links(
    links: Sequence[Link], views: Sequence[View], distortion: Mapping[int, Array]
) -> dict[Candidate, Link]:
    """Move the ties to where a lens without distortion would have shown them; the links by their pairs.

    ``distortion`` is that of each view's lens; views without one keep their ties.
    """
    moves = {
        member: partial(_straighten_pixels, view=view, distortion=distortion.get(member, NO_DISTORTION))
        for member, view in enumerate(views)
    }
    return {(link.left, link.right): link.move(moves) for link in links}


def _straighten_pixels(points: Array, *, view: View, distortion: Array) -> Array:
    matrix = normalisation(view.working_size)
    return apply(np.linalg.inv(matrix).astype(np.float64), straighten(apply(matrix, points), distortion))


def _lens(distortion: Array, size: tuple[int, int], mask: Pixels | None) -> Lens:
    """The lens as a camera file describes it; the focal length is that of common drones."""
    k1, k2, *centre = np.pad(distortion, (0, 4 - len(distortion)))
    half_px = float(np.hypot(*size)) / 2
    focal_px = FOCAL_HALF_DIAGONALS * half_px
    x, y = (np.array(size) - 1) / 2 + half_px * np.array(centre)
    matrix = np.array([[focal_px, 0, x], [0, focal_px, y], [0, 0, 1]])
    coefficients = np.array([k1 * FOCAL_HALF_DIAGONALS**2, k2 * FOCAL_HALF_DIAGONALS**4, 0, 0, 0])
    return Lens(size=size, matrix=matrix, distortion=coefficients, mask=mask)
