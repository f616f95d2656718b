"""Smooth grids of displacements on top of homographies, for ground with relief.

No homography fits two views of ground that is not flat: matches deviate from it by a few pixels. Their residuals,
spread over coarse grids and smoothed, warp the photographs so that the homographies fit them better. (Zaragoza and
others, As-projective-as-possible image stitching, 2013, move the homography instead. A grid of residuals is smaller,
and falls back to the homography where there are no matches.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from golden_model.arrays import Array, Float32, Mask, Matrix, Points
from skymosaic.compositing.grid import interpolation, nodes_around, roughness, solve
from skymosaic.compositing.warp import Canvas, magnification, nearest_corner, source_window
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import INLIER_PX

CELLS = 16
"""Cells of a grid along the longer side of the image."""
REACHES_PX = (24.0, 12.0)
"""Matches this close to the homographies shape the grids; others are considered wrong, or show what stands upright. The
second reach is tried where the first gains nothing: on steep ground, where much that is farther off is wrong."""
JUDGED_PX = 12.0
"""Held-out matches this close to the homographies tell whether grids gain; of farther ones, more are wrong."""
STIFFNESS = 0.3
"""Weight of the difference between neighbouring nodes, against a match's weight of 1."""
RETURN = 0.01
"""Weight of a node's own displacement, which returns it to the homography where no matches are near."""
ROBUST_PX = (6.0, 3.0, 2.0)
"""Scales of the reweighting; a residual of 0.64 scales has half of the weight."""
MIN_MATCHES = 30
NOWHERE_PX = -1e6
"""Where places beyond the horizon are put: far outside of every image."""
CHECK_CELLS = 10
"""Held-out matches lie in alternate fields of a chessboard on the ground, with so many along a side of an image."""
MIN_GAIN = 0.03
"""Rise of the share of held-out matches within 2 px from which warping photographs is worthwhile."""
FINDING_STEPS = 3
"""A displacement changes by at most a tenth of itself over its own length, so each step leaves a tenth of the error."""


Shape = tuple[int, int, int]
"""Number of grids, their rows and their columns."""


class Frame(NamedTuple):
    """An image's size (width, height), px, and where it lies: its pixels to the ground's, (3, 3)."""

    size: tuple[int, int]
    to_ground: Matrix


class Judged(NamedTuple):
    """How many held-out matches lie within 12 px of the homographies, and within 2 px: without grids, and with them."""

    matches: int
    plain: int
    warped: int


class Ties(NamedTuple):
    """Two images, by their numbers, and matches between them, (N, 2) each; px, and wrong ones included, for meshes."""

    left: int
    right: int
    left_points: Points
    right_points: Points


UNKNOWN = Judged(0, 0, 0)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Displacements of an image's pixels at the nodes of a grid, bilinear in between."""

    size: tuple[int, int]
    """Width and height of the image, px."""
    nodes_px: Array
    """(rows, columns, 2): added to a position in the warped image, they give the position in the image. The outermost
    nodes are at the image's corner pixels."""

    def displacement(self, points: Points) -> Points:
        """Displacements (N, 2) at points (N, 2) of the warped image."""
        nodes, weights = nodes_around(points / (np.array(self.size) - 1), self.nodes_px.shape[:2])
        return np.asarray(np.einsum("nk,nkc->nc", weights, self.nodes_px.reshape(-1, 2)[nodes]))

    def find(self, points: Points) -> Points:
        """Where the warped image shows points (N, 2) of the image."""
        warped = points
        for _ in range(FINDING_STEPS):
            warped = points - self.displacement(warped)
        return warped

    def places(self, size: tuple[int, int], transform: Array, part: Canvas, first: tuple[int, int] = (0, 0)) -> Float32:
        """Where an image shows the pixels of a part of the reference frame, (height, width, 2) px from a ``first`` one.

        The image may have any ``size``, over which the grid is stretched. ``transform`` is from pixels of the warped
        image to reference pixels. Interpolated there, the image is warped and transformed at once.
        """
        inverse, stretched = np.asarray(np.linalg.inv(transform)), np.array(size) / self.size
        nearest = nearest_corner(size, transform)

        def compute(points: Points) -> Array:
            shown = apply(inverse, points)
            places = shown + stretched * self.displacement(shown / stretched) - first
            # Beyond the horizon nothing is shown; between both sides of it, places would run through the image.
            places[(points @ inverse[2, :2] + inverse[2, 2]) * nearest <= 0] = NOWHERE_PX
            return places

        return part.interpolate(compute)

    def window(self, size: tuple[int, int], transform: Array, part: Canvas) -> Canvas:
        """The rectangle of image pixels that `places` needs, as `source_window`."""
        reach_px = math.ceil(float(np.abs(self.nodes_px * (np.array(size) / self.size)).max()))
        window = source_window(size, transform, part).grown(reach_px).intersection(Canvas(0, 0, *size))
        assert window is not None
        return window


def fit_meshes(
    frames: Mapping[int, Frame], ties: Sequence[Ties], bent: Sequence[int]
) -> tuple[dict[int, Mesh], Judged]:
    """Fit the grids that bring some of the images, ``bent``, closer to the others under their homographies.

    There are none where held-out matches do not gain by them, or are too few to tell.
    """
    if not ties:
        return {}, UNKNOWN
    width, height = frames[bent[0]].size
    columns, rows = (max(round(CELLS * side / max(width, height)), 1) + 1 for side in (width, height))
    shape = len(bent), rows, columns
    for reach_px in REACHES_PX:
        matches = _gather(frames, ties, bent, reach_px)
        judged = _judge(matches, shape)
        if judged.warped >= judged.plain + MIN_GAIN * judged.matches > 0:
            grids = _fit(matches, shape).reshape(*shape, 2)
            return {image: Mesh(frames[image].size, grid) for image, grid in zip(bent, grids, strict=True)}, judged
    return {}, judged


@dataclass(frozen=True, eq=False)
class _Matches:
    """N matches of all pairs, and the images that they join, the left ones first."""

    points: Array
    """(2, N, 2)"""
    last: Array
    """(2, N, 2): last pixel of each image."""
    grid: NDArray[np.intp]
    """(2, N): place of each image among those that are bent; -1 for one that is not."""
    to_left: Array
    """(N, 3, 3): homographies from right to left."""
    ground: Points
    """(N, 2): where the left points lie, in fields of a chessboard."""

    def of(self, chosen: Mask) -> _Matches:
        points, last, grid = self.points[:, chosen], self.last[:, chosen], self.grid[:, chosen]
        return _Matches(points, last, grid, self.to_left[chosen], self.ground[chosen])

    @cached_property
    def off_px(self) -> Array:
        """Distance of each match in its left image, without grids, (N,)."""
        return np.asarray(np.linalg.norm(self.points[0] - self.carry(np.zeros_like(self.ground))[0], axis=1))

    def weigh(self, side: int, moved: Array, shape: Shape) -> sparse.csr_array:
        """Weights (N, nodes of all grids) of the nodes at the points of a side, moved by (N, 2)."""
        # Of 32 bits, they take half of the memory, and less time.
        local = interpolation(((self.points[side] - moved) / self.last[side]).astype(np.float32), shape[1:])
        grid = np.repeat(self.grid[side], 4)
        columns = local.indices + np.maximum(grid, 0) * local.shape[1]
        values = np.where(grid < 0, np.float32(0), local.data)
        return sparse.csr_array((values, columns, local.indptr), shape=(len(moved), math.prod(shape)))

    def carry(self, moved: Array) -> tuple[Points, Array]:
        """Where right points, moved by (N, 2), lie in the left images, and how much they move there, (N, 2, 2)."""
        mapped = (self.to_left[..., :2] @ (self.points[1] - moved)[..., None])[..., 0] + self.to_left[..., 2]
        at = mapped[:, :2] / mapped[:, 2:]
        moving = self.to_left[:, :2, :2] - at[..., None] * self.to_left[:, 2:, :2]
        return at, moving / mapped[:, 2:, None]

    def errors_px(self, nodes_px: Array, shape: Shape) -> Array:
        """Distance of each match in its left image, with the images warped by grids, (N,)."""
        moved = np.zeros_like(self.points)
        for _ in range(FINDING_STEPS):
            moved = np.stack([self.weigh(side, moved[side], shape) @ nodes_px for side in (0, 1)])
        return np.asarray(np.linalg.norm(self.points[0] - moved[0] - self.carry(moved[1])[0], axis=1))


def _gather(frames: Mapping[int, Frame], ties: Sequence[Ties], bent: Sequence[int], reach_px: float) -> _Matches:
    """All matches in reach of the homographies."""
    place = {image: number for number, image in enumerate(bent)}
    side_px = float(np.median([magnification(*frame) * max(frame.size) for frame in frames.values()])) / CHECK_CELLS
    counts, ends = [len(each.left_points) for each in ties], [(each.left, each.right) for each in ties]
    to_left = [np.linalg.inv(frames[left].to_ground) @ frames[right].to_ground for left, right in ends]
    last = np.array([[frames[image].size for image in pair] for pair in ends]) - 1
    matches = _Matches(
        np.stack([np.concatenate([each[side] for each in ties]) for side in (2, 3)]),
        np.repeat(last, counts, axis=0).swapaxes(0, 1),
        np.repeat([[place.get(image, -1) for image in pair] for pair in ends], counts, axis=0).T,
        np.repeat(to_left, counts, axis=0),
        np.concatenate([apply(frames[each.left].to_ground, each.left_points) for each in ties]) / side_px,
    )
    return matches.of(matches.off_px <= reach_px)


def _judge(matches: _Matches, shape: Shape) -> Judged:
    """See `Judged`; the grids are fitted twice, each time without half of the fields of a chessboard on the ground.

    Whole fields are held out, because neighbouring matches deviate alike and would confirm each other.
    """
    field = np.floor(matches.ground).astype(np.int64).sum(axis=1) % 2 == 0
    judged = matches.off_px <= JUDGED_PX
    if min(np.count_nonzero(field), np.count_nonzero(~field)) < MIN_MATCHES or not judged.any():
        return UNKNOWN
    count, plain = int(np.count_nonzero(judged)), int(np.count_nonzero(matches.off_px[judged] <= INLIER_PX))
    # On flat ground, which most surveys show, there is nothing to gain.
    if plain + MIN_GAIN * count > count:
        return Judged(count, plain, plain)
    errors_px = np.empty(len(field))
    for held_out in (field, ~field):
        errors_px[held_out] = matches.of(held_out).errors_px(_fit(matches.of(~held_out), shape), shape)
    return Judged(count, plain, int(np.count_nonzero(errors_px[judged] <= INLIER_PX)))


def _fit(matches: _Matches, shape: Shape) -> Array:
    """Displacements (nodes of all grids, 2) by least squares with reweighting."""
    smooth = STIFFNESS * roughness(shape[1:]) + RETURN * np.eye(shape[1] * shape[2])
    smooth = sparse.kron(sparse.eye_array(2 * shape[0]), smooth, format="csr").astype(np.float32)
    solution: Float32 = np.zeros((smooth.shape[0], 1), np.float32)
    weight: Float32 = np.ones(2 * len(matches.ground), np.float32)
    moved = np.zeros_like(matches.points)
    for scale_px in ROBUST_PX:
        left, right = (matches.weigh(side, moved[side], shape) for side in (0, 1))
        # The homography is to carry the right point, moved, to the left one, moved; it is linear near where they are.
        at, turn = matches.carry(moved[1])
        off = (matches.points[0] - at - (turn @ moved[1][..., None])[..., 0]).T.reshape(-1, 1)
        target, slopes = off.astype(np.float32), turn.astype(np.float32)
        turned = sparse.block_array([[right.multiply(slopes[:, i, j, None]) for j in (0, 1)] for i in (0, 1)])
        matrix = (sparse.block_diag((left, left)) - turned).tocsr()
        solution = solve(matrix, weight, smooth, target, solution)
        squared = ((matrix @ solution - target).reshape(2, -1) ** 2).sum(axis=0)
        weight = np.tile(1 / (1 + squared / scale_px**2) ** 2, 2).astype(np.float32)
        nodes_px = solution.reshape(2, -1).T.astype(np.float64)
        moved = np.stack([left @ nodes_px, right @ nodes_px])
    return nodes_px
