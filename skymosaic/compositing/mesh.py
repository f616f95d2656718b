"""Smooth grids of displacements on top of homographies, for ground with relief.

No homography fits two views of ground that is not flat. Where there is relief, matches deviate from the homographies
by a few pixels. Their residuals, spread over coarse grids and smoothed, warp the photographs so that the homographies
fit them better; to all later stages, a warped photograph is an ordinary one. (Zaragoza and others,
As-projective-as-possible image stitching, 2013, move the homography instead. A grid of residuals is smaller, and falls
back to the homography where there are no matches.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import cg

from golden_model.arrays import Array, Intensities, Mask, Matrix, Points
from skymosaic.compositing.grid import interpolation, roughness
from skymosaic.compositing.warp import magnification
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import INLIER_PX

CELLS = 16
"""Cells of a grid along the longer side of the image."""
NEAR_PX = 12.0
"""Matches this close to the homographies shape the grids; others are considered wrong, or show what stands upright."""
STIFFNESS = 0.3
"""Weight of the difference between neighbouring nodes, against a match's weight of 1."""
RETURN = 0.01
"""Weight of a node's own displacement, which returns it to the homography where no matches are near."""
ROBUST_PX = (6.0, 3.0, 2.0)
"""Scales of the reweighting; a residual of 0.64 scales has half of the weight."""
SOLVED = 1e-3
"""Relative residual at which the equations of the nodes count as solved: about a hundredth of a pixel."""
MIN_MATCHES = 30
CHECK_CELLS = 10
"""Held-out matches lie in alternate fields of a chessboard on the ground, with so many along a side of an image."""
MIN_GAIN = 0.03
"""Rise of the share of held-out matches within 2 px from which warping photographs is worthwhile."""
UNBENDING_STEPS = 3
"""A displacement changes by at most a tenth of itself over its own length, so each step leaves a tenth of the error."""


class Frame(NamedTuple):
    """An image's size (width, height), px, and where it lies: its pixels to the ground's, (3, 3)."""

    size: tuple[int, int]
    to_ground: Matrix


class Ties(NamedTuple):
    """Two images, and matches between them, (N, 2) px each, wrong ones included."""

    left: int
    right: int
    left_points: Points
    right_points: Points


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
        rows, columns, _ = self.nodes_px.shape
        weights = interpolation(points / (np.array(self.size) - 1), (rows, columns))
        return np.asarray(weights @ self.nodes_px.reshape(-1, 2))

    def find(self, points: Points) -> Points:
        """Where the warped image shows points (N, 2) of the image."""
        warped = points
        for _ in range(UNBENDING_STEPS):
            warped = points - self.displacement(warped)
        return warped

    def apply(self, image: Intensities) -> Intensities:
        """Warp an image of any size; the grid is stretched over it."""
        height, width = image.shape[:2]
        rows, columns = self.nodes_px.shape[:2]
        # Bilinear interpolation is separable: a product of matrices on either side.
        down, across = (_interpolate(*axis).astype(np.float32) for axis in ((height, rows), (width, columns)))
        x, y = (self.nodes_px * (np.array([width, height]) / self.size)).astype(np.float32).transpose(2, 0, 1)
        source_x = down @ x @ across.T + np.arange(width, dtype=np.float32)
        source_y = down @ y @ across.T + np.arange(height, dtype=np.float32)[:, None]
        warped = cv2.remap(image, source_x, source_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(warped, dtype=image.dtype)

    def __eq__(self, other: object) -> bool:
        """Whether the other mesh moves all pixels alike."""
        return isinstance(other, Mesh) and self._content == other._content

    def __hash__(self) -> int:
        """Hash of the displacements."""
        return hash(self._content)

    @property
    def _content(self) -> tuple[tuple[int, int], bytes]:
        return self.size, self.nodes_px.tobytes()


def _interpolate(pixels: int, nodes: int) -> Array:
    """Weights (pixels, nodes) of the nodes along a side, the outermost ones at its first and last pixel."""
    places = np.linspace(0, nodes - 1, pixels)
    return np.asarray(np.maximum(1 - np.abs(places[:, None] - np.arange(nodes)), 0))


@dataclass(frozen=True, eq=False)
class _Matches:
    """N matches of all pairs: the images, their points (N, 2), and the homographies from right to left, (N, 3, 3)."""

    left: NDArray[np.intp]
    right: NDArray[np.intp]
    left_points: Points
    right_points: Points
    to_left: Array

    def __len__(self) -> int:
        return len(self.left)

    def of(self, chosen: Mask) -> _Matches:
        return _Matches(*(column[chosen] for column in vars(self).values()))

    def carry(self, points: Points) -> tuple[Points, Array]:
        """Where points (N, 2) of the right images lie in the left ones, and by how much they move there, (N, 2, 2)."""
        mapped = (self.to_left[..., :2] @ points[..., None])[..., 0] + self.to_left[..., 2]
        at = mapped[:, :2] / mapped[:, 2:]
        moving = self.to_left[:, :2, :2] - at[..., None] * self.to_left[:, 2:, :2]
        return at, moving / mapped[:, 2:, None]

    def errors_px(self, meshes: Mapping[int, Mesh]) -> Array:
        """Distance of each match in its left image, with the images warped by their meshes, (N,)."""
        left, right = self.left_points.copy(), self.right_points.copy()
        for images, points in ((self.left, left), (self.right, right)):
            for image, mesh in meshes.items():
                points[images == image] = mesh.find(points[images == image])
        return np.asarray(np.linalg.norm(left - self.carry(right)[0], axis=1))


def fit_meshes(
    frames: Mapping[int, Frame], ties: Sequence[Ties], bent: Sequence[int], *, always: bool
) -> tuple[dict[int, Mesh], tuple[float, float]]:
    """Fit the grids that bring some of the images, ``bent``, closer to the others under their homographies.

    There are none where held-out matches do not gain by them, unless ``always``, or with fewer than 30 matches within
    12 px of the homographies. Returns also what `held_out_shares` does.
    """
    shares = held_out_shares(frames, ties, bent)
    worthwhile = always or shares[1] >= shares[0] + MIN_GAIN
    return _fit(frames, _gather(frames, ties), bent) if worthwhile else {}, shares


def held_out_shares(frames: Mapping[int, Frame], ties: Sequence[Ties], bent: Sequence[int]) -> tuple[float, float]:
    """Share of the held-out matches within 12 px that lie within 2 px: under homographies alone, and with grids.

    The grids are fitted twice, each time without the matches on half of the fields of a chessboard on the ground.
    """
    matches = _gather(frames, ties)
    if len(matches) < 2 * MIN_MATCHES:
        return 0.0, 0.0
    # Whole fields, because neighbouring matches deviate alike and would confirm each other.
    side_px = float(np.median([magnification(*frame) * max(frame.size) for frame in frames.values()])) / CHECK_CELLS
    ground = np.zeros_like(matches.left_points)
    for image in np.unique(matches.left).tolist():
        ground[matches.left == image] = apply(frames[image].to_ground, matches.left_points[matches.left == image])
    field = np.floor(ground / side_px).astype(np.int64).sum(axis=1) % 2 == 0
    plain, warped = [], []
    for held_out in (field, ~field):
        meshes = _fit(frames, matches.of(~held_out), bent)
        if not meshes or not held_out.any():
            return 0.0, 0.0
        plain.append(matches.of(held_out).errors_px({}) <= INLIER_PX)
        warped.append(matches.of(held_out).errors_px(meshes) <= INLIER_PX)
    return float(np.concatenate(plain).mean()), float(np.concatenate(warped).mean())


def _gather(frames: Mapping[int, Frame], ties: Sequence[Ties]) -> _Matches:
    """All matches near the homographies."""
    counts = [len(each.left_points) for each in ties]
    to_left = [np.linalg.inv(frames[each.left].to_ground) @ frames[each.right].to_ground for each in ties]
    matches = _Matches(
        np.repeat([each.left for each in ties], counts),
        np.repeat([each.right for each in ties], counts),
        np.concatenate([each.left_points for each in ties]),
        np.concatenate([each.right_points for each in ties]),
        np.repeat(to_left, counts, axis=0),
    )
    return matches.of(matches.errors_px({}) <= NEAR_PX)


def _fit(frames: Mapping[int, Frame], matches: _Matches, bent: Sequence[int]) -> dict[int, Mesh]:
    """The grids of all images in ``bent``, by least squares with reweighting."""
    if len(matches) < MIN_MATCHES:
        return {}
    width, height = frames[bent[0]].size
    columns, rows = (max(round(CELLS * side / max(width, height)), 1) + 1 for side in (width, height))
    smooth = STIFFNESS * roughness((rows, columns)) + RETURN * np.eye(rows * columns)
    smooth = sparse.kron(sparse.eye_array(2 * len(bent)), smooth, format="csr")
    weight, solution = np.ones(2 * len(matches)), np.zeros(smooth.shape[0])
    moved_left, moved_right = np.zeros((2, len(matches), 2))
    for scale_px in ROBUST_PX:
        left = _weigh_nodes(frames, matches.left, matches.left_points - moved_left, bent, (rows, columns))
        right = _weigh_nodes(frames, matches.right, matches.right_points - moved_right, bent, (rows, columns))
        # The homography is to carry the right point, moved, to the left one, moved; it is linear near where they are.
        at, turn = matches.carry(matches.right_points - moved_right)
        target = (matches.left_points - at - (turn @ moved_right[..., None])[..., 0]).T.ravel()
        turned = sparse.block_array([[right.multiply(turn[:, i, j, None]) for j in (0, 1)] for i in (0, 1)])
        matrix = (sparse.block_diag((left, left)) - turned).tocsr()
        weighted = matrix.multiply(weight[:, None])
        normal = matrix.T @ weighted + smooth
        by_diagonal = sparse.diags_array(1 / normal.diagonal())
        solution, _ = cg(normal, weighted.T @ target, solution, rtol=SOLVED, M=by_diagonal)
        off = ((matrix @ solution - target).reshape(2, -1) ** 2).sum(axis=0)
        weight = np.tile(1 / (1 + off / scale_px**2) ** 2, 2)
        nodes_px = solution.reshape(2, -1).T
        moved_left, moved_right = left @ nodes_px, right @ nodes_px
    grids = nodes_px.reshape(len(bent), rows, columns, 2)
    return {image: Mesh(frames[image].size, grid) for image, grid in zip(bent, grids, strict=True)}


def _weigh_nodes(
    frames: Mapping[int, Frame],
    images: NDArray[np.intp],
    points: Points,
    bent: Sequence[int],
    shape: tuple[int, int],
) -> sparse.csr_array:
    """Weights (N, nodes of all bent images) of the nodes at points (N, 2), each in its image; 0 in one that stays."""
    known, place = np.unique(images, return_inverse=True)
    last = np.array([frames[image].size for image in known.tolist()])[place] - 1
    grid = np.array([bent.index(image) if image in bent else -1 for image in known.tolist()])[place]
    local = interpolation(points / last, shape)
    columns = local.indices + np.repeat(np.maximum(grid, 0) * shape[0] * shape[1], 4)
    values = np.where(np.repeat(grid < 0, 4), 0.0, local.data)
    return sparse.csr_array((values, columns, local.indptr), shape=(len(points), len(bent) * shape[0] * shape[1]))
