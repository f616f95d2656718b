"""Homographies in fixed point and matches, with the extremes of both."""

import numpy as np
from numpy.typing import NDArray

from golden_model.formats import POSITION
from golden_model.geometry.fixed_point import ENTRY, quantise

TRUTH = np.array([[1.02, 0.05, 30], [-0.04, 0.97, 10], [1e-5, 2e-5, 1]])


def matches(count: int, seed: int = 1) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Positions in 1/16 px, some near to where `TRUTH` maps them, some anywhere; and weights."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, 10_240, (count, 2))
    lifted = np.hstack((left / 16, np.ones((count, 1)))) @ TRUTH.T
    right = 16 * (lifted[:, :2] / lifted[:, 2:] + rng.normal(0, 2, (count, 2)))
    right = np.where(rng.random((count, 1)) < 0.3, rng.integers(0, 10_240, (count, 2)), right)
    return left, np.clip(np.rint(right), 0, POSITION.max_raw).astype(np.int64), rng.integers(0, 256, count)


def near_truth(count: int, seed: int = 2) -> NDArray[np.int64]:
    """Hypotheses that fit part of the matches."""
    spread = np.array([[1e-3, 1e-3, 1], [1e-3, 1e-3, 1], [2e-7, 2e-7, 2e-3]])
    return quantise(TRUTH + np.random.default_rng(seed).normal(size=(count, 3, 3)) * spread)


def extreme_hypotheses() -> NDArray[np.int64]:
    """Elements at both ends of the range, behind the camera, at the horizon, singular."""
    rng = np.random.default_rng(3)
    ends = rng.choice([ENTRY.min_raw, ENTRY.max_raw, 0], (10, 3, 3))
    anything = rng.integers(ENTRY.min_raw, ENTRY.max_raw + 1, (6, 3, 3))
    plain = near_truth(1)[0]
    horizon, mirrored, point = plain.copy(), -plain, np.zeros_like(plain)
    horizon[2] = (ENTRY.max_raw, ENTRY.min_raw, 0)
    point[:, 2] = (1 << 20, 1 << 19, ENTRY.max_raw)
    some = np.stack((quantise(np.eye(3)[np.newaxis])[0], plain, horizon, mirrored, point, 0 * plain))
    return np.concatenate((ends, anything, some))


def extreme_matches() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    corners = np.array([[0, 0], [POSITION.max_raw, 0], [0, POSITION.max_raw], [POSITION.max_raw] * 2])
    left, right = np.repeat(corners, 4, axis=0), np.tile(corners, (4, 1))
    # Under the identity, squared errors of 1, 4, 9 and 16 sixteenths of the tolerance: ties of every comparison.
    left[4:8], right[4:8] = 5000, 5000 + np.array([[12, 12], [-24, 24], [36, -36], [48, 48]])
    some = matches(14)
    weight = np.resize([255, 0, 1, 128], 16)
    return np.vstack((left, some[0])), np.vstack((right, some[1])), np.concatenate((weight, some[2]))
