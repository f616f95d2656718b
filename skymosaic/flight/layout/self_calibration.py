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
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from golden_model.arrays import Array, Pixels
from skymosaic.flight.cache import ResultCache, key_of
from skymosaic.flight.layout.adjustment import FOCAL_HALF_DIAGONALS, MAX_STEPS, MODELS
from skymosaic.flight.layout.distortion import LARGEST_DISTORTION, straightened
from skymosaic.flight.layout.layout import LinkedGroup, normalisation
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import Lens

FEWEST_VIEWS = 6
"""Fewer views leave the distortion to the tilts: a homography each can absorb most of it."""
WANTED_GAIN = 0.95
"""The coefficient is used if the median error of held-out ties falls below this share: straightening costs detail."""
TIES_A_LINK = 100
"""More ties of a link than these do not tell better whether a distortion helps, but take longer."""
BETWEEN_STEPS = 4
"""Steps of the affine model, which only leads from similarities to homographies."""


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

    def with_remaining(self, distortion: float) -> Calibration:
        """With what distortion the photographs have left once ``lens`` has straightened them."""
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
        lens = self.lens
        assert lens.size is not None
        assert lens.matrix is not None
        numbers = {
            "width_px": lens.size[0],
            "height_px": lens.size[1],
            "focal_x_px": float(lens.matrix[0, 0]),
            "focal_y_px": float(lens.matrix[1, 1]),
            "centre_x_px": float(lens.matrix[0, 2]),
            "centre_y_px": float(lens.matrix[1, 2]),
            "k1": self.k1,
        }
        measured = (
            f"# Median error of held-out ties: {self.before_px:.2f} px without k1, {self.after_px:.2f} px with it.\n"
        )
        return measured + "".join(f"{key} = {value}\n" for key, value in numbers.items())


def calibrate(
    views: Sequence[View],
    members: Sequence[int],
    links: Sequence[Link],
    mask: Pixels | None = None,
    cache: ResultCache | None = None,
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
    cache : ResultCache or None
        Keeps the result for the next run with the same links.

    Returns
    -------
    Calibration or None
        None for few views, different sizes (different cameras), or where held-out ties do not improve.
    """
    sizes = {tuple(sorted(views[member].size)) for member in members}
    if len(members) < FEWEST_VIEWS or len(sizes) > 1:
        return None
    before_px, after_px, distortion = _kept("calibration", _measured, LinkedGroup(views, members, links), cache)
    if abs(distortion) >= LARGEST_DISTORTION or after_px > WANTED_GAIN * before_px:
        return None
    return Calibration(distortion, before_px, after_px, _lens(distortion, views[members[0]].size, mask))


def remaining_distortion(
    views: Sequence[View], members: Sequence[int], links: Sequence[Link], cache: ResultCache | None = None
) -> float:
    """The distortion between straightened photographs; arguments as of `calibrate`."""
    (distortion,) = _kept("remaining distortion", _remaining, LinkedGroup(views, members, links), cache)
    return distortion


def _kept(
    what: str,
    measure: Callable[[LinkedGroup], tuple[float, ...]],
    group: LinkedGroup,
    cache: ResultCache | None,
) -> tuple[float, ...]:
    """What ``measure`` finds, from the cache where sizes and ties are those of an earlier run."""
    key = key_of(what, group.units_px, _digest(group.links))
    arrays = cache.load(key) if cache is not None else None
    if arrays is None:
        arrays = {"found": np.array(measure(group))}
        if cache is not None:
            cache.save(key, arrays)
    return tuple(arrays["found"].tolist())


def _digest(links: Sequence[Link]) -> str:
    """A hash of the views that the links join and of their ties."""
    state = hashlib.sha256()
    for link in links:
        state.update(repr((link.left, link.right)).encode() + link.left_points.tobytes() + link.right_points.tobytes())
    return state.hexdigest()


def _measured(group: LinkedGroup) -> tuple[float, float, float]:
    """Median error of held-out ties without and with a distortion, working px, and the distortion by all ties."""
    before_px, _, _ = _trial(group, lens=False)
    after_px, distortion, transforms = _trial(group, lens=True)
    whole = group.network(slice(None), distortion=distortion)
    whole.calibrate(transforms, "homography")
    return before_px, after_px, whole.distortion


def _remaining(group: LinkedGroup) -> tuple[float]:
    whole = group.network(slice(None))
    _fitted(group.start, whole.calibrate)
    return (whole.distortion,)


def _trial(group: LinkedGroup, *, lens: bool) -> tuple[float, float, Array]:
    """Fit every second tie: the median error of the others, working px; the distortion, and the transformations."""
    fitted = group.network(slice(0, None, 2), TIES_A_LINK)
    transforms = _fitted(group.start, fitted.calibrate if lens else fitted.adjust)
    held_out = group.network(slice(1, None, 2), TIES_A_LINK, fitted.distortion)
    return float(np.median(np.concatenate(held_out.errors_px(transforms)))), fitted.distortion, transforms


def _fitted(start: Array, fit: Callable[..., Array]) -> Array:
    """Transformations by `Network.adjust` or `Network.calibrate`."""
    # Similarities converge from far away; homographies with a wrong distortion may not, so they come last.
    transforms = start
    for model in MODELS:
        transforms = fit(transforms, model, max_steps=BETWEEN_STEPS if model == "affine" else MAX_STEPS)
    return transforms


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
