"""The tracked object: how the front end sees it, and how it is found in a frame.

A small object has few corners at its own size, and none within the border that descriptors need. So the front end
processes a *view*: the object enlarged, with its surroundings, whose features are ignored. A frame is warped into the
same view by the expected pose of the object; matching with the held reference then measures the error of this pose.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Pixels
from golden_model.config import Config
from sim.backends.interface import Backend
from skymosaic.compositing.warp import Canvas, shrink, warp_backward
from skymosaic.features.positions import feature_points, match_points
from skymosaic.geometry.homography import apply, resize_matrix, transfer_error
from skymosaic.geometry.model_selection import TOLERANCE_PX, fit, fit_similarity

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


class TemplatePose(NamedTuple):
    """Pose of the template in a frame.

    ``homography`` (3, 3) maps template pixels to frame pixels; ``model`` is the estimated model, "similarity" or
    "projective"; ``features`` are the indices of the template's features that agree within 3 view pixels; ``inliers``
    counts the trusted ones among them.
    """

    homography: Array
    model: str
    inliers: int
    features: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Template:
    """A rectangle of a picture, and the front end that finds it in frames.

    Attributes
    ----------
    picture : ndarray of uint8, shape (H, W) or (H, W, 3)
    roi : Roi
        The rectangle that is the template; its first pixel is the origin of template coordinates.
    front_end : Backend
        Computes the matches, with the template's view as the held reference.
    config : Config
        The front end's configuration.
    """

    picture: Pixels
    roi: Roi
    front_end: Backend
    config: Config

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
        features = self.front_end.run([self._reference], self.config)[0].features
        points = feature_points(features)
        first, last = apply(self._to_view, self.corners)[[0, 2]]
        # From -1 to 1 across the template.
        from_middle = (2 * points - first - last) / (last - first)
        inside = (np.abs(from_middle) <= 1).all(axis=1)
        return np.where(inside, np.exp(-(from_middle**2).sum(axis=1)), 0)

    def find_near(
        self, frame: Pixels, expected: Array, weight: Array, *, min_inliers: int, rng: np.random.Generator
    ) -> TemplatePose | None:
        """Find the template within about a quarter of its size from the expected pose.

        Parameters
        ----------
        frame : ndarray of uint8
        expected : ndarray, shape (3, 3)
            Expected pose, template to frame pixels.
        weight : ndarray, shape (F,)
            Weight of the template's features; 0 for features that are not trusted.
        min_inliers : int
            Inliers needed.
        rng : numpy.random.Generator
            Source of the robust estimator's samples.

        Returns
        -------
        TemplatePose or None
            None if the template is not found.
        """
        index, left, right = self._match(self._view(frame, expected))
        trusted = weight[index] > 0
        best = fit(left[trusted], right[trusted], weight[index[trusted]], fewest=min_inliers, rng=rng)
        if best is None:
            return None
        agreeing = transfer_error(best.matrix, left, right) <= TOLERANCE_PX
        homography = expected @ np.linalg.inv(self._to_view) @ best.matrix @ self._to_view
        return TemplatePose(homography / homography[2, 2], best.model, best.inliers, index[agreeing])

    def guess_within(
        self, frame: Pixels, part: Canvas, zoom: float, weight: Array, *, min_inliers: int
    ) -> Array | None:
        """Guess the template's pose (3, 3) from a part of the frame magnified by ``zoom``; None if it is not found.

        A similarity needs ``min_inliers``; up to 3 matches agree by chance.
        """
        magnified = resize_matrix(zoom)
        index, left, right = self._match(_warp(frame, magnified, part))
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
    def _reference(self) -> Pixels:
        return self._view(self.picture, self.in_picture)

    def _view(self, frame: Pixels, pose: Array) -> Pixels:
        """The view of a frame, for a template in ``pose`` (template to frame pixels, (3, 3))."""
        width, height = (round(self.zoom * side) + 2 * MARGIN_PX for side in self.roi[2:])
        return _warp(frame, self._to_view @ np.linalg.inv(pose), Canvas(0, 0, width, height))

    def _match(self, picture: Pixels) -> tuple[NDArray[np.intp], Array, Array]:
        """Match the template's features: feature index (N,) and positions (N, 2) in the view and in ``picture``.

        Matches of the surroundings are left out. The fuzzy stage's verdicts are ignored, because the relative
        orientation that most matches agree on may be that of the surroundings.
        """
        matches = self.front_end.run([self._reference, picture], self.config, reference="held")[1].matches
        matches = matches[self.weight[matches["left_index"]] > 0]
        return matches["left_index"].astype(np.intp), *match_points(matches)


def _warp(frame: Pixels, transform: Array, canvas: Canvas) -> Pixels:
    """Warp a frame into ``canvas``, averaged by area where it shrinks; its border pixels are repeated beyond it."""
    return np.asarray(warp_backward(*shrink(frame, transform), canvas, border=cv2.BORDER_REPLICATE), dtype=np.uint8)
