"""Registers a pair of overlapping photographs: features, matches, homography, or the reason of a failure."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Mask, Matrix, Pixels, Points, Records
from golden_model.config import LARGEST_THRESHOLD, Config, preset_config
from golden_model.feature.ilbp import PATTERNS
from golden_model.records import Cause
from sim.backend import Backend, FrameResult, Progress, silent
from skymosaic.errors import InputError
from skymosaic.features.guided_matching import refine_pair
from skymosaic.features.methods import Method, backend_of, choose
from skymosaic.features.positions import match_points
from skymosaic.geometry.estimators import ESTIMATORS, FUZZY_RANSAC, estimate
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import INLIER_PX, MIN_INLIERS
from skymosaic.imagery.images import Photograph, keeps_damaged, load, reduced_for_front_end
from skymosaic.imagery.lens import Lens
from skymosaic.stopwatch import Stopwatch

WORKING_WIDTH_PX = 1280
MASK_MARGIN_PX = 40
"""Features keep this distance from masked pixels, in working px: farther away no descriptor reads the mask."""


@dataclass(frozen=True)
class Pair:
    """Two photographs, their features and matches, and their homography.

    Attributes
    ----------
    left, right : Photograph
        The originals.
    to_original : tuple of ndarray, shape (3, 3)
        Working pixels to original pixels, of left and right.
    working : tuple of ndarray
        The images as the front end saw them.
    features : tuple of structured arrays
        Feature records of left and right (`golden_model.records.feature_record`), in 1/16 working px.
    matches, kept, inliers : structured arrays
        Match records (`golden_model.records.MATCH`) as proposed (after the mutual check; of a ratio test, before
        it), after the fuzzy stage or the ratio test's mutual check, and within 2 working px of the homography (of
        fuzzy RANSAC: accepted by its rules).
    refined_inliers : int
        Matches of the second pass within 2 working px; 0 where there was none, or it found less than the first.
    homography : ndarray of float64, shape (3, 3), or None
        Left original pixels to right original pixels, pixel centres at integers; None where not accepted.
    reason : str
        Why the pair was not accepted, with the counts; empty where it was.
    config : Config
        Of the front end and matcher.
    method : Method
        Detector and descriptor.
    estimator : str
        Robust estimator.
    backend : str
        Name of the backend that computed features and matches.
    seconds : dict
        Wall time of each stage.
    """

    left: Photograph
    right: Photograph
    to_original: tuple[Matrix, Matrix]
    working: tuple[Pixels, Pixels]
    features: tuple[Records, Records]
    matches: Records
    kept: Records
    inliers: Records
    refined_inliers: int
    homography: Matrix | None
    reason: str
    config: Config
    method: Method
    estimator: str
    backend: str
    seconds: dict[str, float]

    @property
    def accepted(self) -> bool:
        """Whether the homography can be trusted (at least 12 inliers at 2 px)."""
        return self.homography is not None

    def summary(self) -> dict[str, Any]:
        """The pair in plain numbers, as ``register --json`` prints it."""
        return {
            "accepted": self.accepted,
            "homography": None if self.homography is None else self.homography.tolist(),
            "features": [len(side) for side in self.features],
            "matches": len(self.matches),
            "kept": len(self.kept),
            "inliers": len(self.inliers),
            "refined_inliers": self.refined_inliers,
            "reason": self.reason,
            "seconds": {stage: round(value, 4) for stage, value in self.seconds.items()},
            "backend": self.backend,
            "preset": self.config.preset,
            "detector": self.method.detector,
            "descriptor": self.method.descriptor,
            "estimator": self.estimator,
        }


def register(
    left: str | Path | Pixels,
    right: str | Path | Pixels,
    *,
    preset: str = "aerial",
    config: Config | None = None,
    detector: str | None = None,
    descriptor: str | None = None,
    estimator: str = "prosac",
    backend: str = "golden",
    seed: int = 0,
    working_width_px: int = WORKING_WIDTH_PX,
    refine: bool = False,
    damaged: str = "refuse",
    progress: Progress = silent,
) -> Pair:
    """Find the homography between two photographs.

    Parameters
    ----------
    left, right : path or ndarray of uint8, shape (H, W) or (H, W, 3) BGR
        The photographs; they need not be of one size.
    preset : str
        ``"aerial"`` or ``"thesis"``; `config` overrides it.
    detector, descriptor : str or None
        Names of `skymosaic.features.detectors.DETECTORS` and `skymosaic.features.descriptors.DESCRIPTORS`; None:
        the one that suits the other, or as configured.
    estimator : str
        One of `skymosaic.geometry.estimators.ESTIMATORS`.
    backend : str
        What computes features and matches: ``golden``, ``rtl``, ...
    seed : int
        Of the robust estimator.
    working_width_px : int
        Wider photographs are reduced by area for registration; the result is in original pixels.
    refine : bool
        A second, guided pass: about twice the inliers and half the error.
    damaged : {"refuse", "keep"}
        Whether a damaged JPEG is an error, or used as far as it can be decoded.
    progress : callable
        Receives lines about the first build of a simulation.

    Returns
    -------
    Pair
        With ``accepted`` False and a ``reason`` where the photographs cannot be registered.

    Raises
    ------
    skymosaic.errors.InputError
        For a photograph that cannot be used, an unknown name or an impossible combination.
    """
    clock = Stopwatch()
    keep = keeps_damaged(damaged)
    photographs = (
        load(left, "left image", keep_damaged=keep),
        load(right, "right image", keep_damaged=keep),
    )
    clock.lap("reading")
    return register_photographs(
        photographs,
        config=config or preset_config(preset),
        detector=detector,
        descriptor=descriptor,
        estimator=estimator,
        backend=backend,
        seed=seed,
        working_width_px=working_width_px,
        refine=refine,
        seconds=clock.seconds,
        progress=progress,
    )


def register_photographs(
    photographs: tuple[Photograph, Photograph],
    *,
    config: Config,
    backend: str,
    seed: int,
    working_width_px: int,
    refine: bool,
    seconds: dict[str, float],
    detector: str | None = None,
    descriptor: str | None = None,
    estimator: str = "prosac",
    lens: Lens | None = None,
    progress: Progress = silent,
) -> Pair:
    """`register` for photographs that are already decoded.

    ``seconds`` holds the time spent so far. Matches in pixels that ``lens`` masks do not count.
    """
    clock = Stopwatch(seconds)
    method, config = settled_method(config, detector, descriptor, estimator, refine)
    (left, to_left), (right, to_right) = (
        reduced_for_front_end(photo.pixels, working_width_px, photo.name) for photo in photographs
    )
    results, config = extract_within_capacity(backend_of(method, backend, progress), [left, right], config)
    features = results[0].features, results[1].features
    matches = results[1].matches
    if lens is not None:
        masks = tuple(lens.visible((image.shape[1], image.shape[0])) for image in (left, right))
        on_ground = [on_the_ground(points, mask) for points, mask in zip(match_points(matches), masks, strict=True)]
        matches = matches[on_ground[0] & on_ground[1]]
    clock.lap("features and matches")

    verified = matches["verdict"] == 1
    left_points, right_points = match_points(matches)
    homography, inliers = estimate(
        estimator,
        left_points,
        right_points,
        matches["weight"].astype(np.float64),
        verified,
        rng=np.random.default_rng(seed),
    )
    refined_inliers = 0
    clock.lap("homography")
    if refine and homography is not None:
        refined, found = refine_pair(left, right, features, homography, config)
        # Over strong relief the upright search may find fewer matches: then keep the result of the first pass.
        if found >= inliers.sum():
            homography, refined_inliers = refined, found
            near = np.linalg.norm(apply(homography, left_points) - right_points, axis=1) <= INLIER_PX
            inliers = verified & near
        clock.lap("refinement")
    return Pair(
        left=photographs[0],
        right=photographs[1],
        to_original=(to_left, to_right),
        working=(left, right),
        features=features,
        matches=matches,
        kept=matches[verified],
        inliers=matches[inliers],
        refined_inliers=refined_inliers,
        homography=None if homography is None else _in_originals(homography, to_left, to_right),
        reason="" if homography is not None else _why_not(results, matches, int(verified.sum()), int(inliers.sum())),
        config=config,
        method=method,
        estimator=estimator,
        backend=backend,
        seconds=clock.seconds,
    )


def extract_within_capacity(
    front_end: Backend, frames: Sequence[Pixels], config: Config
) -> tuple[list[FrameResult], Config]:
    """Run the front end; if a frame has more corners than a feature bank holds, raise the threshold for all frames.

    Only a configuration without cell selection can exceed the capacity. The thesis raises its threshold in
    the same way (section II.2.1.2); we double it until every frame fits.
    """
    while True:
        results = front_end.run(frames, config)
        threshold, limit = config.front_end.threshold, LARGEST_THRESHOLD[config.front_end.detector]
        too_many = any(int(result.status["causes"]) & Cause.TOO_MANY_FEATURES for result in results)
        if not too_many or threshold == limit:
            return results, config
        raised = dataclasses.replace(config.front_end, threshold=min(2 * threshold, limit))
        config = dataclasses.replace(config, front_end=raised)


def on_the_ground(points: Points, visible: Pixels | None) -> Mask:
    """Whether each point (N, 2), in working px, is far enough from masked pixels to count, (N,).

    Parameters
    ----------
    points : ndarray of float64, shape (N, 2)
    visible : ndarray of uint8, shape (H, W), or None
        255 where the working image shows ground, else 0; None: everywhere.
    """
    if visible is None:
        return np.ones(len(points), dtype=np.bool_)
    kernel = np.ones((2 * MASK_MARGIN_PX + 1, 2 * MASK_MARGIN_PX + 1), np.uint8)
    inside = cv2.erode(visible, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=255)
    x, y = np.rint(points).astype(np.intp).clip(0, np.subtract(visible.shape[::-1], 1)).T
    return np.asarray(inside[y, x] == 255)


def _in_originals(homography: Matrix, to_left: Matrix, to_right: Matrix) -> Matrix:
    original = to_right @ homography @ np.linalg.inv(to_left)
    scaled: Matrix = original / original[2, 2]
    return scaled


def settled_method(
    config: Config, detector: str | None, descriptor: str | None, estimator: str, refine: bool
) -> tuple[Method, Config]:
    """The method and its configuration, checked against the estimator and the second pass.

    Raises
    ------
    InputError
        For an unknown name or an impossible combination.
    """
    if estimator not in ESTIMATORS:
        raise InputError(f"estimator is {estimator!r}; valid: {', '.join(ESTIMATORS)}")
    if estimator == FUZZY_RANSAC:
        # Fuzzy RANSAC has rules of its own, which replace those of the matcher.
        config = dataclasses.replace(config, matcher=dataclasses.replace(config.matcher, rule_base="none"))
    method, config = choose(config, detector, descriptor)
    if refine and method.descriptor not in PATTERNS:
        raise InputError(f"refinement describes the images again by ILBP, not by {method.descriptor}; leave one out")
    return method, config


def _why_not(results: Sequence[FrameResult], matches: Records, kept: int, inliers: int) -> str:
    features = [len(result.features) for result in results]
    counts = f"features {features[0]} and {features[1]}, matches {len(matches)}, kept {kept}, inliers {inliers}"
    if min(features) < MIN_INLIERS:
        cause = "too few features (flat or blurred image?)"
    elif kept < MIN_INLIERS:
        cause = "too few matches (do the images overlap?)"
    else:
        cause = f"too few inliers, {MIN_INLIERS} needed (do the images overlap?)"
    return f"{cause}: {counts}"
