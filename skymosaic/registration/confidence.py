"""How far to trust a registered pair: a predicted error over the overlap, and one verdict with its reason.

`skymosaic.geometry.uncertainty` measures how well the matches fit; here the images are warped onto each other and
correlated as well.
"""

from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Mask, Matrix, Points
from golden_model.pixel.gray import to_gray
from skymosaic.common.brief import brief
from skymosaic.geometry.acceptance import hull_share
from skymosaic.geometry.ground import (
    REPEATS,
    GroundAgreement,
    Sight,
    band_pass,
    mask_common,
    measure_agreement,
    measure_rival,
)
from skymosaic.geometry.homography import apply, transfer_error
from skymosaic.geometry.horizon import Size
from skymosaic.geometry.prosac import INLIER_PX, MIN_INLIERS
from skymosaic.geometry.uncertainty import NEAR_PX, FitQuality, assess_fit, one_per_place

# A pair is good below the first predicted error, and poor from the second on.
GOOD_PX = 2.0
POOR_PX = 5.0
FEW_INLIERS = 20
# Inliers on less of the overlap leave most of it to a guess. From the last share of held-out matches on, their plane is
# also that of the ground far from them; without it, rendered pairs with relief are 30 px off.
SMALL_SHARE_OF_OVERLAP = 0.25
SMALL_SHARE_OF_FLAT_OVERLAP = 0.15
SURELY_FLAT_SHARE = 0.8
# With fewer held-out matches within 2 px, or less of the ground in agreement, the ground is not flat.
FLAT_SHARE = 0.75
FLAT_SHARE_OF_GROUND = 0.95
# What optical flow confirms is not poor: all but two of 75 such pairs are less than this off, and these two 8 px. Nor
# is an overlap that correlates like this, wherever its inliers are: none of 280 is more than 1.6 px off.
CONFIRMED_PX = 4.5
SURE_CORRELATION = 0.8
# A pair above all three needs no closer look.
CLEAR_INLIERS = 60
CLEAR_SHARE = 0.9
CLEAR_SHARE_OF_OVERLAP = 0.5
# Where the ground repeats itself, as rows of solar panels, wrong matches agree as well, a row away: a fifth as many as
# the inliers, or more. None of 298 good pairs of other ground has so many; a roof has.
REPEATED_SHARE = 0.2
REPEATED_PX = 8.0
MAX_COMPARED = 1000
REPEATED = "the ground repeats itself so far that it fits as well elsewhere"
HIGH_PASS_SIGMA_PX = 3.0
# Fewer pixels correlate by chance.
MIN_OVERLAP_PX = 400
# Fitted by `python -m bench.confidence`, see docs/explanation/registration.md. A fit to today's pairs gives other
# coefficients, which call a rendered pair good that is 8 px off.
INTERCEPT = 2.749
COEFFICIENTS = {
    "log_instability": 0.367,
    "log_missed": 0.584,
    "log_uncovered": 0.485,
    "correlation": -0.647,
}
"""Logarithm of the predicted error (px): intercept plus coefficients times `measure_inputs`."""


@brief
@dataclass(frozen=True)
class Confidence:
    """How far a pair can be trusted.

    Attributes
    ----------
    verdict : {"good", "check", "poor"}
    reason : str
        Why it is not good; the evidence where it is.
    predicted_px : float
        Predicted mean error over the overlap, px of the working images.
    correlation : float
        NCC of the overlap after warping, high-pass, -1 to 1.
    quality : FitQuality
        How well the matches fit the homography.
    ground : GroundAgreement
        How much of the ground agrees with it.
    """

    verdict: str
    reason: str
    predicted_px: float
    correlation: float
    quality: FitQuality
    ground: GroundAgreement

    @property
    def is_well_supported(self) -> bool:
        """Whether many matches and the ground agree: then a refit to the whole overlap gains next to nothing."""
        agrees = self.quality.held_out_share >= FLAT_SHARE and self.ground.share >= FLAT_SHARE_OF_GROUND
        return agrees and self.quality.inliers >= CLEAR_INLIERS

    @property
    def extrapolates(self) -> bool:
        """Whether the pair is poor and its inliers cover so little of the overlap that most of it is a guess."""
        surely_flat = self.quality.held_out_share >= SURELY_FLAT_SHARE
        least = SMALL_SHARE_OF_FLAT_OVERLAP if surely_flat else SMALL_SHARE_OF_OVERLAP
        return self.verdict == "poor" and self.quality.hull_share < least

    def summary(self) -> dict[str, Any]:
        """All numbers by name, ready for JSON."""
        values = {"predicted_px": self.predicted_px, "correlation": self.correlation, **asdict(self.quality)}
        values |= {"ground_share": self.ground.share, "ground_required": max(self.ground.required, 0.0)}
        values["ground_covered"] = self.ground.covered
        return {"verdict": self.verdict, "reason": self.reason} | {key: round(v, 4) for key, v in values.items()}


def assess(
    sights: tuple[Sight, Sight],
    homography: Matrix,
    left: Points,
    right: Points,
    *,
    ground: GroundAgreement | None = None,
    confirmed: bool = False,
) -> Confidence:
    """Predict the error of a homography between two working images.

    Parameters
    ----------
    sights : tuple of Sight
        Left and right working image.
    homography : (3, 3) ndarray
        Left to right, working px.
    left, right : (N, 2) ndarray
        The kept matches, including wrong ones, working px.
    ground : GroundAgreement or None
        How much of the ground agrees with it, where that is measured already.
    confirmed : bool
        Optical flow agrees with the homography over a third of the overlap.
    """
    quality = assess_fit(homography, left, right, *(sight.size for sight in sights))
    correlation = correlate_overlap(*sights, homography)
    inputs = measure_inputs(quality, correlation)
    exponent = INTERCEPT + sum(COEFFICIENTS[name] * value for name, value in inputs.items())
    # Beyond what the formula was fitted to, a number would only seem precise.
    predicted_px = float(np.exp(np.clip(exponent, -5, 5)))
    limited = predicted_px > CONFIRMED_PX and (confirmed or correlation >= SURE_CORRELATION)
    predicted_px = CONFIRMED_PX if limited else predicted_px
    verdict = "good" if predicted_px < GOOD_PX else "check" if predicted_px < POOR_PX else "poor"
    error = f"expected error {'below ' * limited}{predicted_px:.1f} px at a width of {sights[0].size[0]} px"
    reason = f"{_explain(quality, correlation, verdict)}; {error}"
    if measure_rival(*sights, homography) >= REPEATS:
        verdict, reason = "poor", f"{REPEATED}; {reason}"
    elif verdict == "good" and (repeats := describe_repetition(homography, left, right)):
        verdict, reason = "check", f"{repeats}; {reason}"
    ground = ground or measure_agreement(*sights, homography)
    if not ground.is_good:
        verdict, reason = "poor" if ground.is_refused or verdict == "poor" else "check", f"{ground.explain()}; {reason}"
    return Confidence(verdict, reason, predicted_px, correlation, quality, ground)


def describe_repetition(homography: Matrix, left: Points, right: Points) -> str:
    """That other matches agree on another homography, and how far away; empty where few do.

    Parameters as for `assess`.
    """
    left, right = one_per_place(left, right)
    expected = apply(homography, left)
    offset = right - expected
    away_px = np.linalg.norm(offset, axis=1)
    least = max(MIN_INLIERS, REPEATED_SHARE * np.count_nonzero(away_px <= INLIER_PX))
    # What moves with the camera, as a display, is no ground.
    moves = np.linalg.norm(right - left, axis=1) > REPEATED_PX
    expected, offset, away_px = (each[moves & (away_px > REPEATED_PX)] for each in (expected, offset, away_px))
    if len(offset) < least:
        return ""
    # A row away is nearly the same everywhere: the offset that most others are like.
    some = np.arange(0, len(offset), 1 + len(offset) // MAX_COMPARED)
    apart_px = np.linalg.norm(offset[some, None] - offset[some], axis=2)
    like = np.count_nonzero(apart_px <= 0.3 * away_px[some, None], axis=1)
    usual = offset[some[np.argmax(like / away_px[some])]]
    near = np.linalg.norm(offset - usual, axis=1) < 0.4 * np.linalg.norm(usual)
    if np.count_nonzero(near) < least:
        return ""
    _, found = cv2.findHomography(expected[near], (expected + offset)[near], cv2.USAC_MAGSAC, INLIER_PX)
    agree = 0 if found is None else np.count_nonzero(found)
    far = f"{np.linalg.norm(usual):.0f} px away"
    return f"the ground repeats itself: {agree} other matches agree {far}" if agree >= least else ""


def fits_throughout(homography: Matrix, left: Points, right: Points, left_size: Size, right_size: Size) -> bool:
    """Whether matches at so many places agree, over so much of the overlap, that the verdict is good without `assess`.

    Parameters as for `skymosaic.geometry.uncertainty.assess_fit`. It takes a twentieth of the time of `assess`.
    """
    left, right = one_per_place(left, right)
    error_px = transfer_error(homography, left, right)
    inlier, near = error_px <= INLIER_PX, error_px <= NEAR_PX
    if np.count_nonzero(inlier) < max(CLEAR_INLIERS, CLEAR_SHARE * np.count_nonzero(near)):
        return False
    return hull_share(homography, left[inlier], left_size, right_size) >= CLEAR_SHARE_OF_OVERLAP


def measure_inputs(quality: FitQuality, correlation: float) -> dict[str, float]:
    """The quantities that predict the error, by the names of `COEFFICIENTS`."""
    # The offsets keep the logarithms finite where everything fits or is covered.
    return {
        "log_instability": float(np.log(max(quality.instability_px, 0.01))),
        "log_missed": float(np.log(1.02 - quality.held_out_share)),
        "log_uncovered": float(np.log(1.05 - quality.hull_share)),
        "correlation": correlation,
    }


def correlate_overlap(left_sight: Sight, right_sight: Sight, homography: Matrix) -> float:
    """Normalised cross-correlation of left and warped right image over the ground of both, without low frequencies.

    Without these, brightness that differs or falls off towards the corners does not matter. 0 where fewer than 400 px
    of the overlap are far enough from its edge.
    """
    left, right = to_gray(left_sight.pixels), to_gray(right_sight.pixels)
    # The homography maps left to right: the inverse map, by which OpenCV looks up each pixel of the warped image.
    to_left_grid = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(right, homography, left_sight.size, flags=to_left_grid)
    covered = mask_common(left_sight, right_sight, homography)
    # At the edge of the overlap the high-pass mixes in what lies outside it.
    radius = round(3 * HIGH_PASS_SIGMA_PX)
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    inside: Mask = cv2.erode(covered, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0) == 255
    if np.count_nonzero(inside) < MIN_OVERLAP_PX:
        return 0.0
    left_high, right_high = (band_pass(image, HIGH_PASS_SIGMA_PX)[inside] for image in (left, warped))
    energy = float(np.sqrt((left_high**2).sum(dtype=np.float64) * (right_high**2).sum(dtype=np.float64)))
    return float((left_high * right_high).sum(dtype=np.float64)) / energy if energy > 0 else 0.0


def _explain(quality: FitQuality, correlation: float, verdict: str) -> str:
    """The evidence of a good verdict, or the strongest cause of another, in words."""
    held_out = f"{100 * quality.held_out_share:.0f} % of held-out matches within 2 px"
    if verdict == "good":
        return held_out
    if quality.hull_share < SMALL_SHARE_OF_OVERLAP:
        return f"inliers cover {100 * quality.hull_share:.0f} % of the overlap"
    if quality.inliers < FEW_INLIERS:
        return f"only {quality.inliers} inliers"
    if quality.held_out_share < FLAT_SHARE:
        # What lies higher or lower than its matches, as a roof, is farther off.
        return f"relief: {held_out}; expect ghosting of {quality.held_out_px:.0f} px and more"
    if correlation < SURE_CORRELATION:
        return f"the overlap correlates by only {correlation:.2f}"
    return f"{held_out}, and inliers on {100 * quality.hull_share:.0f} % of the overlap"
