"""Radial distortion by one coefficient: OpenCV's k1, in units that do not need a focal length."""

from __future__ import annotations

import numpy as np

from golden_model.arrays import Array

LARGEST_DISTORTION = 0.25
"""Bound of the displacement in the corners, as a share of the half diagonal; stronger lenses need a calibration."""
LARGEST_CHANGE = 0.03
"""Of the distortion in one step: far from the solution the ties are not nearly linear in it."""
STRAIGHTENING_ROUNDS = 12


def straightened(points: Array, distortion: float) -> Array:
    """Points (..., 2) about the centre, in half diagonals, with the distortion of the lens taken out.

    A point at distance r from the centre, in half diagonals, was displaced outwards by ``distortion * r^2`` of it.
    """
    straight = points
    for _ in range(STRAIGHTENING_ROUNDS):
        straight = points / (1 + distortion * (straight**2).sum(axis=-1, keepdims=True))
    return np.asarray(straight)


def bending_of(straight: Array, distortion: float) -> Array:
    """How straightened points (..., 2) move with the distortion."""
    squared = (straight**2).sum(axis=-1, keepdims=True)
    return np.asarray(-straight * squared / (1 + 3 * distortion * squared))
