"""Robust estimators by name: PROSAC, the estimator of the hardware, OpenCV's RANSAC and MAGSAC++, and fuzzy RANSAC."""

from typing import Literal, get_args

import cv2
import numpy as np

from golden_model.arrays import Array, Mask
from skymosaic.common.later import Later
from skymosaic.geometry import fuzzy_ransac
from skymosaic.geometry.homography import DegenerateError, dlt, transfer_error
from skymosaic.geometry.prosac import CONFIDENCE, INLIER_PX, MIN_INLIERS, estimate_homography

Estimator = Literal["prosac", "fabric", "ransac", "magsac", "fuzzy-ransac"]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)
PROSAC = "prosac"
FUZZY_RANSAC = "fuzzy-ransac"
fabric = Later("skymosaic.geometry.fabric")
FABRIC = "fabric"
"""What the chip computes, which also decides what is accepted; the checks of the host come after it."""
MIN_MATCHES = 4
_BY_OPENCV = {
    # Samples of four until a better one is improbable (thesis, section III.5.1); and MAGSAC++ (Barath et al., 2020).
    "ransac": (cv2.RANSAC, fuzzy_ransac.TOLERANCE_PX, 2000),
    "magsac": (cv2.USAC_MAGSAC, 3.0, 10_000),
}
"""OpenCV's estimators by name: method, tolerance in px, and samples at most."""


def estimate(
    name: str,
    left: Array,
    right: Array,
    weight: Array,
    verified: Mask,
    *,
    size: tuple[int, int],
    rng: np.random.Generator,
    record: np.void | None = None,
) -> tuple[Array | None, Mask]:
    """Estimate the homography of matches, of which many may be wrong.

    Parameters
    ----------
    name, left, right
        One of `ESTIMATORS`; matched points (N, 2), px.
    weight : (N,) float64 ndarray
        Confidence of each match, 0 to 255; only ``prosac`` and ``fabric`` use it.
    verified : (N,) bool ndarray
        Whether the front end accepted the match. Only fuzzy RANSAC also uses the other matches.
    size : (int, int)
        Width and height of the right image, px; only ``fabric`` uses it.
    rng : numpy.random.Generator
        Source of the samples of ``prosac`` and ``fabric``; OpenCV's estimators use a fixed seed.
    record : structured scalar or None
        What the estimator on the chip has sent for these matches; ``fabric`` then computes nothing.

    Returns
    -------
    homography : (3, 3) float64 ndarray or None
        Left to right; None with fewer than 12 verified matches within 2 px.
    inliers : (N,) bool ndarray
        The verified matches within 2 px; for fuzzy RANSAC, those that its rules accept.
    """
    inliers = np.zeros(len(left), dtype=bool)
    if name == PROSAC:
        result = estimate_homography(left[verified], right[verified], weight[verified], rng=rng)
        inliers[verified] = result.inliers
        return result.homography, inliers
    if name == FUZZY_RANSAC:
        # RANSAC needs all matches here: the rules count the ones that only one of the two checks accepts.
        H, decision = fuzzy(left, right, verified)
        inliers = inliers if decision is None else decision.inliers
    elif name == FABRIC and record is not None:
        H = fabric.homography_in_pixels(record)
    elif name == FABRIC:
        H = fabric.estimate_as_in_fabric(left[verified], right[verified], weight[verified], size, rng=rng)
    else:
        H = estimate_by_opencv(name, left[verified], right[verified])
    if H is None:
        return None, inliers
    near = verified & (transfer_error(H, left, right) <= INLIER_PX)
    return H if near.sum() >= MIN_INLIERS else None, inliers if name == FUZZY_RANSAC else near


def estimate_by_opencv(name: str, left: Array, right: Array) -> Array | None:
    """Estimate by OpenCV's ``ransac`` or ``magsac``; None where no homography can be estimated."""
    if len(left) < MIN_MATCHES:
        return None
    kind, tolerance_px, rounds = _BY_OPENCV[name]
    H, _ = cv2.findHomography(left, right, kind, tolerance_px, maxIters=rounds, confidence=CONFIDENCE)
    return None if H is None else np.asarray(H, dtype=np.float64)


def fuzzy(left: Array, right: Array, verified: Mask) -> tuple[Array | None, fuzzy_ransac.Decision | None]:
    """Run RANSAC over all matches, apply the six rules, and fit the accepted ones by DLT (thesis, Table III-3).

    Where RANSAC finds nothing, both are None; where the rules accept too few matches, the homography alone.
    """
    H = estimate_by_opencv("ransac", left, right)
    if H is None:
        return None, None
    decision = fuzzy_ransac.decide(H, left, right, verified)
    try:
        return dlt(left[decision.inliers], right[decision.inliers]), decision
    except DegenerateError:
        return None, decision
