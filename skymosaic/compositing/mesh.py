"""A smooth grid of displacements on top of a homography, for ground with relief.

No homography fits two views of ground that is not flat. The matches that deviate from it by a few pixels tell where the
relief is: their residuals, spread over a coarse grid and smoothed, bend one photograph so that the homography fits it
better. The bent photograph is an ordinary one for everything that follows. (Zaragoza and others, As-projective-as-
possible image stitching, 2013, moves the homography instead; a grid of residuals is smaller and falls back to the
homography where there are no matches.)
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from golden_model.arrays import Array, Intensities, Matrix, Points
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import INLIER_PX

CELLS = 10
"""Cells of the grid along the longer side of the image."""
NEAR_PX = 12.0
"""Matches this close to the homography shape the grid; others are taken for wrong."""
STIFFNESS = 0.3
"""Weight of the difference between neighbouring nodes, against a match's weight of 1."""
RETURN = 0.01
"""Weight of a node's own displacement: without matches near it, it returns to the homography."""
ROBUST_PX = (6.0, 3.0, 2.0)
"""Scales of the reweighting, of which each halves the weight of what lies 0.64 scales off."""
MIN_MATCHES = 30
CHECK_CELLS = 10
"""Held-out matches lie in fields of a chessboard with so many fields along a side."""
MIN_GAIN = 0.03
"""Held-out matches within 2 px that a grid has to gain, as a share, before it is worth bending a photograph."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Displacements of an image's pixels at the nodes of a grid, bilinear in between.

    Attributes
    ----------
    size : (int, int)
        Width and height of the image, px.
    nodes_px : ndarray of float64, shape (rows, columns, 2)
        What to add to a position in the bent image to get the position in the image. The first and the last node are
        at the image's corner pixels.
    """

    size: tuple[int, int]
    nodes_px: Array

    def displacement(self, points: Points) -> Points:
        """Displacements (N, 2) at points (N, 2) of the bent image."""
        matrix = _interpolation(points, self.size, self.nodes_px.shape[:2])
        return np.asarray(matrix @ self.nodes_px.reshape(-1, 2))

    def bend(self, image: Intensities) -> Intensities:
        """The bent image; ``image`` may have any size, the grid is stretched over it."""
        height, width = image.shape[:2]
        stretch = np.array([width, height]) / self.size
        # OpenCV puts the outermost samples half a pixel outside when it enlarges; here nodes are at the corner pixels.
        rows, columns = self.nodes_px.shape[:2]
        x, y = np.meshgrid(np.linspace(0, columns - 1, width), np.linspace(0, rows - 1, height))
        nodes = (self.nodes_px * stretch).astype(np.float32)
        offsets = np.moveaxis(cv2.remap(nodes, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR), -1, 0)
        grid = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        source_x, source_y = (axis + offset for axis, offset in zip(grid, offsets, strict=True))
        bent = cv2.remap(image, source_x, source_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(bent, dtype=image.dtype)


def fit_mesh(homography: Matrix, left: Points, right: Points, size: tuple[int, int]) -> Mesh | None:
    """The grid that brings the left image of a pair closer to the right one under its homography.

    Parameters
    ----------
    homography : (3, 3) ndarray
        Left to right.
    left, right : (N, 2) ndarray
        Matches, wrong ones included, px.
    size : (int, int)
        Of the left image, px.

    Returns
    -------
    Mesh or None
        None with fewer than 30 matches within 12 px of the homography.
    """
    near = np.linalg.norm(apply(homography, left) - right, axis=1) <= NEAR_PX
    if np.count_nonzero(near) < MIN_MATCHES:
        return None
    # Where the homography looks for the right point, the bent image has to show the left one.
    bent = apply(np.asarray(np.linalg.inv(homography)), right[near])
    target = left[near] - bent
    cell_px = max(size) / CELLS
    shape = (max(round(size[1] / cell_px), 1) + 1, max(round(size[0] / cell_px), 1) + 1)
    matrix, smooth = _interpolation(bent, size, shape), _smoothness(shape)
    weight, nodes = np.ones(len(bent)), np.zeros((shape[0] * shape[1], 2))
    for scale_px in ROBUST_PX:
        normal = matrix.T @ (matrix * weight[:, None]) + smooth
        nodes = np.linalg.solve(normal, matrix.T @ (target * weight[:, None]))
        squared = ((matrix @ nodes - target) ** 2).sum(axis=1)
        weight = 1 / (1 + squared / scale_px**2) ** 2
    return Mesh(size, nodes.reshape(*shape, 2))


def fit_useful_mesh(homography: Matrix, left: Points, right: Points, size: tuple[int, int]) -> Mesh | None:
    """`fit_mesh`, or None where held-out matches do not gain by it."""
    plain, bent = held_out_shares(homography, left, right, size)
    return fit_mesh(homography, left, right, size) if bent >= plain + MIN_GAIN else None


def held_out_shares(homography: Matrix, left: Points, right: Points, size: tuple[int, int]) -> tuple[float, float]:
    """Share of the held-out matches within 12 px that lie within 2 px: of the homography alone, and with a grid.

    The grid is fitted twice, each time without the matches on half of the fields of a chessboard.
    """
    near = np.linalg.norm(apply(homography, left) - right, axis=1) <= NEAR_PX
    left, right = left[near], right[near]
    if len(left) < 2 * MIN_MATCHES:
        return 0.0, 0.0
    field = np.floor(left / np.array(size) * CHECK_CELLS).astype(np.int64).sum(axis=1) % 2 == 0
    plain, bent = [], []
    for held_out in (field, ~field):
        mesh = fit_mesh(homography, left[~held_out], right[~held_out], size)
        if mesh is None or not held_out.any():
            return 0.0, 0.0
        # The error is measured in the right image, as the homography's own.
        expected = apply(np.asarray(np.linalg.inv(homography)), right[held_out])
        moved = left[held_out] - mesh.displacement(expected)
        plain.append(np.linalg.norm(apply(homography, left[held_out]) - right[held_out], axis=1) <= INLIER_PX)
        bent.append(np.linalg.norm(apply(homography, moved) - right[held_out], axis=1) <= INLIER_PX)
    return float(np.concatenate(plain).mean()), float(np.concatenate(bent).mean())


def _interpolation(points: Points, size: tuple[int, int], shape: tuple[int, ...]) -> Array:
    """Bilinear weights (N, rows * columns) of the nodes at points, which are clipped to the image."""
    rows, columns = shape
    position = np.clip(points / (np.array(size) - 1), 0, 1) * [columns - 1, rows - 1]
    first = np.minimum(np.floor(position), [columns - 2, rows - 2]).astype(np.intp)
    share = position - first
    weights = np.zeros((len(points), rows * columns))
    index = np.arange(len(points))
    for down in (0, 1):
        for across in (0, 1):
            factor = np.where(across, share[:, 0], 1 - share[:, 0]) * np.where(down, share[:, 1], 1 - share[:, 1])
            weights[index, (first[:, 1] + down) * columns + first[:, 0] + across] += factor
    return weights


def _smoothness(shape: tuple[int, int]) -> Array:
    """The quadratic form of the differences between neighbours, and of the displacements themselves."""
    rows, columns = shape
    index = np.arange(rows * columns).reshape(shape)
    pairs = np.concatenate(
        [
            np.stack((index[:, :-1].ravel(), index[:, 1:].ravel()), axis=1),
            np.stack((index[:-1].ravel(), index[1:].ravel()), axis=1),
        ]
    )
    difference = np.zeros((len(pairs), rows * columns))
    order = np.arange(len(pairs))
    difference[order, pairs[:, 0]], difference[order, pairs[:, 1]] = 1, -1
    return np.asarray(STIFFNESS * difference.T @ difference + RETURN * np.eye(rows * columns))
