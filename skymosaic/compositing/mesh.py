"""A smooth grid of displacements on top of a homography, for ground with relief.

No homography fits two views of ground that is not flat. Where there is relief, matches deviate from the homography by a
few pixels. Their residuals, spread over a coarse grid and smoothed, warp one photograph so that the homography fits it
better; to all later stages, the warped photograph is an ordinary one. (Zaragoza and others, As-projective-as-possible
image stitching, 2013, move the homography instead. A grid of residuals is smaller, and falls back to the homography
where there are no matches.)
"""

from dataclasses import dataclass

import cv2
import numpy as np

from golden_model.arrays import Array, Intensities, Matrix, Points
from skymosaic.compositing.grid import interpolation, roughness
from skymosaic.geometry.homography import apply, transfer_error
from skymosaic.geometry.prosac import INLIER_PX

CELLS = 10
"""Cells of the grid along the longer side of the image."""
NEAR_PX = 12.0
"""Matches this close to the homography shape the grid; others are considered wrong."""
STIFFNESS = 0.3
"""Weight of the difference between neighbouring nodes, against a match's weight of 1."""
RETURN = 0.01
"""Weight of a node's own displacement, which returns it to the homography where no matches are near."""
ROBUST_PX = (6.0, 3.0, 2.0)
"""Scales of the reweighting; a residual of 0.64 scales has half of the weight."""
MIN_MATCHES = 30
CHECK_CELLS = 10
"""Held-out matches lie in alternate fields of a chessboard with this many fields along a side."""
MIN_GAIN = 0.03
"""Rise of the share of held-out matches within 2 px from which warping a photograph is worthwhile."""


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

    def apply(self, image: Intensities) -> Intensities:
        """Warp an image of any size; the grid is stretched over it."""
        height, width = image.shape[:2]
        stretch = np.array([width, height]) / self.size
        # Not cv2.resize, which would put the outermost nodes half a pixel outside instead of at the corner pixels.
        rows, columns = self.nodes_px.shape[:2]
        x, y = np.meshgrid(np.linspace(0, columns - 1, width), np.linspace(0, rows - 1, height))
        nodes = (self.nodes_px * stretch).astype(np.float32)
        offsets = np.moveaxis(cv2.remap(nodes, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR), -1, 0)
        grid = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        source_x, source_y = (axis + offset for axis, offset in zip(grid, offsets, strict=True))
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


def fit_mesh(homography: Matrix, left: Points, right: Points, size: tuple[int, int]) -> Mesh | None:
    """Fit the grid that brings the left image of a pair closer to the right one under its homography, left to right.

    Wrong matches may be among ``left`` and ``right`` (N, 2). ``size`` is that of the left image. None with fewer than
    30 matches within 12 px of the homography.
    """
    near = transfer_error(homography, left, right) <= NEAR_PX
    if np.count_nonzero(near) < MIN_MATCHES:
        return None
    # The bent image has to show the left point where the homography looks for the right one.
    bent = apply(np.asarray(np.linalg.inv(homography)), right[near])
    target = left[near] - bent
    cell_px = max(size) / CELLS
    shape = (max(round(size[1] / cell_px), 1) + 1, max(round(size[0] / cell_px), 1) + 1)
    matrix = interpolation(bent / (np.array(size) - 1), shape).toarray()
    smooth = STIFFNESS * roughness(shape) + RETURN * np.eye(shape[0] * shape[1])
    weight, nodes = np.ones(len(bent)), np.zeros((shape[0] * shape[1], 2))
    for scale_px in ROBUST_PX:
        normal = matrix.T @ (matrix * weight[:, None]) + smooth
        nodes = np.linalg.solve(normal, matrix.T @ (target * weight[:, None]))
        squared = ((matrix @ nodes - target) ** 2).sum(axis=1)
        weight = 1 / (1 + squared / scale_px**2) ** 2
    return Mesh(size, nodes.reshape(*shape, 2))


def fit_useful_mesh(homography: Matrix, left: Points, right: Points, size: tuple[int, int]) -> Mesh | None:
    """As `fit_mesh`, but None also where held-out matches do not gain by it."""
    plain, bent = held_out_shares(homography, left, right, size)
    return fit_mesh(homography, left, right, size) if bent >= plain + MIN_GAIN else None


def held_out_shares(homography: Matrix, left: Points, right: Points, size: tuple[int, int]) -> tuple[float, float]:
    """Share of the held-out matches within 12 px that lie within 2 px: under the homography alone, and with a grid.

    The grid is fitted twice, each time without the matches on half of the fields of a chessboard.
    """
    near = transfer_error(homography, left, right) <= NEAR_PX
    left, right = left[near], right[near]
    if len(left) < 2 * MIN_MATCHES:
        return 0.0, 0.0
    # Whole fields, because neighbouring matches deviate alike and would confirm each other.
    field = np.floor(left / np.array(size) * CHECK_CELLS).astype(np.int64).sum(axis=1) % 2 == 0
    plain, bent = [], []
    for held_out in (field, ~field):
        mesh = fit_mesh(homography, left[~held_out], right[~held_out], size)
        if mesh is None or not held_out.any():
            return 0.0, 0.0
        # Errors are measured in the right image, like those of the homography alone.
        expected = apply(np.asarray(np.linalg.inv(homography)), right[held_out])
        moved = left[held_out] - mesh.displacement(expected)
        plain.append(transfer_error(homography, left[held_out], right[held_out]) <= INLIER_PX)
        bent.append(transfer_error(homography, moved, right[held_out]) <= INLIER_PX)
    return float(np.concatenate(plain).mean()), float(np.concatenate(bent).mean())
