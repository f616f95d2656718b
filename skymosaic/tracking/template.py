"""The tracked object: how the front end sees it, and how it is found in a frame.

A small object has few corners at its own size, and none within the border that descriptors need. So the front end
processes a *view*: the object enlarged, with its surroundings. A frame is warped into the same view by the expected
pose of the object; matching features with the first view, or blocks with the first or a recent one, then measures the
error of this pose. The surroundings show how the ground moves.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Mask, Pixels
from golden_model.config import Config
from sim.backends.interface import Backend
from skymosaic.compositing.warp import Canvas, magnification, shrink, warp_backward
from skymosaic.features.positions import feature_points, match_points
from skymosaic.geometry.homography import apply, rescale, resize_matrix, transfer_error
from skymosaic.geometry.model_selection import TOLERANCE_PX, fit, fit_similarity
from skymosaic.tracking.blocks import BLOCK_PX, BORDER_PX, STEP_PX, match_blocks
from skymosaic.tracking.motion import Find, Matches, fit_object, fit_surroundings

MIN_ROI_PX = 16
"""Smallest side of a template."""
MIN_VIEW_SIDE_PX, MAX_VIEW_SIDE_PX = 128, 256
"""Limits of the object's side in the view, measured as the square root of its area; the object is resized to them."""
MARGIN_PX = 64
"""Surroundings in the view: the front end's border at half size (40 px) and the possible error of the expected pose."""


class Roi(NamedTuple):
    """A rectangle of whole pixels."""

    x_px: int
    y_px: int
    width_px: int
    height_px: int


class View(NamedTuple):
    """A picture in which the object was seen.

    ``from_frame`` (3, 3) maps pixels of the frame to those of ``picture``, and ``in_frame`` (3, 3) template pixels to
    those of the frame.
    """

    picture: Pixels
    from_frame: Array
    in_frame: Array


class TemplatePose(NamedTuple):
    """Pose of the template in a frame.

    ``homography`` (3, 3) maps template pixels to frame pixels; ``model`` is the estimated model, "similarity" or
    "projective"; ``inliers`` counts the trusted matches that agree within 3 view pixels. ``followed`` and ``left_out``
    are indices of the template's features: those that agree, and those that moved like the surroundings or stood still
    while the object did not; both are empty where blocks were matched. ``moves`` says that matches were left out for
    that. ``view`` is what was seen.
    """

    homography: Array
    model: str
    inliers: int
    followed: NDArray[np.intp]
    left_out: NDArray[np.intp]
    moves: bool
    view: View


@dataclass(frozen=True, eq=False)
class Template:
    """A rectangle of a picture, and the front end that finds it in frames."""

    picture: Pixels
    roi: Roi
    """The rectangle that is the template; its first pixel is the origin of template coordinates."""
    front_end: Backend
    """Computes the matches, with the template's view as the held reference."""
    config: Config
    """The front end's configuration."""

    @property
    def corners(self) -> Array:
        """Outer corners (4, 2) in template pixels, clockwise from the top left."""
        right, bottom = self.roi.width_px - 0.5, self.roi.height_px - 0.5
        return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])

    @property
    def in_picture(self) -> Array:
        """Template pixels to pixels of the picture, (3, 3)."""
        return np.array([[1.0, 0, self.roi.x_px], [0, 1, self.roi.y_px], [0, 0, 1]])

    @cached_property
    def zoom(self) -> float:
        """View pixels per template pixel."""
        side_px = float(np.sqrt(self.roi.width_px * self.roi.height_px))
        return float(np.clip(side_px, MIN_VIEW_SIDE_PX, MAX_VIEW_SIDE_PX)) / side_px

    @cached_property
    def weight(self) -> Array:
        """Weight of each feature of the view, (F,): it falls from the centre outwards, and is 0 outside the template.

        A rectangle drawn around an object contains more of the ground towards its edges.
        """
        features = self.front_end.run([self.first_view.picture], self.config)[0].features
        return self._weight_at(feature_points(features))

    def look_near(
        self,
        frame: Pixels,
        expected: Array,
        weight: Array,
        reference: View | None = None,
        *,
        moves: bool,
        min_inliers: int,
        rng: np.random.Generator,
    ) -> tuple[TemplatePose | None, bool]:
        """Look for the template within about a quarter of its size from the expected pose, template to frame pixels.

        The features of the first view are sought, with a ``weight`` (F,) that is 0 for those that are not trusted; or
        blocks of a ``reference``, the first view or a recent one. ``moves`` says that the object is known to move
        otherwise than its surroundings. Returns also whether what surrounded it in the reference was seen.
        """
        view = self._view(frame, expected)
        find: Find = fit_similarity
        if reference is None:
            index, left, now = self._match(self.first_view.picture, view.picture)
            trust, find = weight[index], partial(fit, rng=rng)
        else:
            index, left, now = self._match_blocks(reference, view, frame.shape)
            trust = self._weight_at(left)
        # The frame at the scale of the enlarged template: so a similarity of the two has no shear.
        scaled = resize_matrix(self.zoom / magnification(self.roi[2:], expected))
        right = apply(scaled @ np.linalg.inv(view.from_frame), now)
        inside = self._is_inside(left)
        matches = Matches(left, right, trust, ~inside)
        around = fit_surroundings(matches)
        before = (reference or self.first_view).in_frame
        still, ahead = (scaled @ pose @ np.linalg.inv(self._to_view) for pose in (before, expected))
        best, left_out = fit_object(
            matches, still, around and around.matrix, ahead if moves else None, find, fewest=min_inliers
        )
        if best is None:
            return None, around is not None
        agreeing = inside & (transfer_error(best.matrix, left, right) <= TOLERANCE_PX)
        homography = rescale(np.linalg.inv(scaled) @ best.matrix @ self._to_view)
        followed, others = (index[each & (index >= 0)] for each in (agreeing, left_out & ~agreeing))
        seen = view._replace(in_frame=homography)
        pose = TemplatePose(homography, best.model, best.inliers, followed, others, bool(left_out.any()), seen)
        return pose, around is not None

    def guess_within(
        self, frame: Pixels, part: Canvas, zoom: float, weight: Array, *, min_inliers: int
    ) -> Array | None:
        """Guess the template's pose (3, 3) from a part of the frame magnified by ``zoom``; None if it is not found.

        A similarity needs ``min_inliers``; up to 3 matches agree by chance.
        """
        magnified = resize_matrix(zoom)
        index, left, right = self._match(self.first_view.picture, _warp(frame, magnified, part))
        trusted = weight[index] > 0
        best = fit_similarity(left[trusted], right[trusted], weight[index[trusted]], fewest=min_inliers)
        if best is None:
            return None
        homography = np.linalg.inv(part.translation @ magnified) @ best.matrix @ self._to_view
        return np.asarray(homography / homography[2, 2])

    @cached_property
    def _to_view(self) -> Array:
        """Template pixels to view pixels, (3, 3)."""
        return np.array([[1.0, 0, MARGIN_PX], [0, 1, MARGIN_PX], [0, 0, 1]]) @ resize_matrix(self.zoom)

    @cached_property
    def _blocks(self) -> Array:
        """Middles (N, 2) of blocks of the view: all of the object, and every other one of its surroundings."""
        height, width = self.first_view.picture.shape[:2]
        columns, rows = (np.arange(BORDER_PX, side - BORDER_PX, 2.0 * STEP_PX) for side in (width, height))
        dense = np.stack(np.meshgrid(columns, rows), axis=-1)
        sparse = dense[:, ::2]
        return np.concatenate([dense[self._is_inside(dense)], sparse[~self._is_inside(sparse)]])

    @cached_property
    def first_view(self) -> View:
        """The picture that the template was cut from."""
        return self._view(self.picture, self.in_picture)

    def _from_middle(self, points: Array) -> Array:
        """Points (..., 2) of the enlarged template, from -1 to 1 across it."""
        first, last = apply(self._to_view, self.corners)[[0, 2]]
        return np.asarray((2 * points - first - last) / (last - first))

    def _weight_at(self, points: Array) -> Array:
        return np.where(self._is_inside(points), np.exp(-(self._from_middle(points) ** 2).sum(axis=1)), 0)

    def _is_inside(self, points: Array) -> Mask:
        return np.asarray((np.abs(self._from_middle(points)) <= 1).all(axis=-1))

    def _view(self, frame: Pixels, pose: Array) -> View:
        """The view of a frame, for a template in ``pose`` (template to frame pixels, (3, 3))."""
        width, height = (round(self.zoom * side) + 2 * MARGIN_PX for side in self.roi[2:])
        from_frame = self._to_view @ np.linalg.inv(pose)
        return View(_warp(frame, from_frame, Canvas(0, 0, width, height)), from_frame, pose)

    def _match(self, reference: Pixels, picture: Pixels) -> tuple[NDArray[np.intp], Array, Array]:
        """Match two pictures: index (N,) of the feature in the first, and positions (N, 2) in both.

        The fuzzy stage's verdicts are ignored, because the relative orientation that most matches agree on may be that
        of the surroundings.
        """
        matches = self.front_end.run([reference, picture], self.config, reference="held")[1].matches
        return matches["left_index"].astype(np.intp), *match_points(matches)

    def _match_blocks(
        self, reference: View, view: View, frame_shape: tuple[int, ...]
    ) -> tuple[NDArray[np.intp], Array, Array]:
        """Match blocks of a reference with a view as `_match` does; they have no index, -1.

        What lies near the frame's border is left out: beyond, the border pixels are repeated.
        """
        to_middle = self._to_view @ np.linalg.inv(reference.from_frame @ reference.in_frame)
        height, width = view.picture.shape[:2]
        before, now = match_blocks(
            _warp(reference.picture, to_middle, Canvas(0, 0, width, height)), view.picture, self._blocks
        )
        corners = now[:, None] + np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]) * float(BLOCK_PX)
        in_frame = apply(view.in_frame @ np.linalg.inv(self._to_view), corners)
        seen = ((in_frame >= 0) & (in_frame < frame_shape[1::-1])).all(axis=(1, 2))
        return np.full(seen.sum(), -1), before[seen], now[seen]


def _warp(frame: Pixels, transform: Array, canvas: Canvas) -> Pixels:
    """Warp a frame into ``canvas``, averaged by area where it shrinks; its border pixels are repeated beyond it."""
    return np.asarray(warp_backward(*shrink(frame, transform), canvas, border=cv2.BORDER_REPLICATE), dtype=np.uint8)
