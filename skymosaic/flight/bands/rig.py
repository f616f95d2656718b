"""Alignment of the bands of a rig: cameras that are fixed to each other, one for each band.

Two bands of one capture differ by a homography that is the same for all captures: the cameras' centres are
centimetres apart, and the ground is far. It is fitted to places of several captures at once. Bands do not look alike
(plants are dark in red and bright in near infrared, which turns descriptors over), but their edges lie in the same
places: patches of the gradient's magnitude are compared by normalised correlation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Matrix, Pixels, Points
from golden_model.pixel.gray import to_gray
from skymosaic.errors import RegistrationError
from skymosaic.flight.workers import Workers
from skymosaic.geometry.homography import apply
from skymosaic.geometry.prosac import estimate_homography
from skymosaic.imagery.images import reduce_to_width
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.registration.options import WORKING_WIDTH_PX

MOST_CAPTURES = 9
"""So many captures, spread over the flight, are compared."""
PATCHES_ACROSS, PATCHES_DOWN = 9, 7
PATCH_SHARE = 1 / 12
"""Side of a patch, as a share of the picture's width."""
REACH_PX = (16, 4)
"""How far patches are searched: about the common shift of a capture, then about the first homography. Cameras that
are turned against each other by a degree move the borders of a picture by 11 of 1280 pixels."""
LEAST_LIKENESS = 0.3
"""Correlation below which a patch is taken for another place."""
FEWEST_PLACES = 40
LEAST_AGREEING = 0.4
"""Fewer places that agree with one homography, or a smaller share of them, are no fixed alignment."""
STEADY_PX = 1.0
"""Median distance of a capture's places from where the others put them, beyond which the cameras are not fixed."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """How one band lies on the registering one.

    Attributes
    ----------
    homography : ndarray of float64, shape (3, 3)
        Straightened pixels of the band to those of the registering band.
    error_px : float
        Median distance of the places that agree, px of the picture.
    """

    homography: Matrix
    error_px: float


def alignments(captures: Sequence[Source], reference: str, lens: Lens, workers: Workers) -> Mapping[str, Alignment]:
    """Align all bands of a rig with the one that registers the flight.

    Parameters
    ----------
    captures : sequence of Source
        Sets of the same bands.
    reference : str
        Name of the registering band.
    lens : Lens
    workers : Workers

    Raises
    ------
    RegistrationError
        If a band cannot be aligned: its pictures show other things, or the cameras moved against each other.
    """
    spread = np.unique(np.linspace(0, len(captures) - 1, min(len(captures), MOST_CAPTURES)).round().astype(int))
    bands = [band for band in captures[0].bands if band != reference]
    calls = [
        (captures[index].bands[reference], [captures[index].bands[band] for band in bands], lens)
        for index in spread.tolist()
    ]
    to_original, compared = zip(*workers.run("bands", _compare, calls), strict=True)
    return {
        band: _fitted(band, reference, [places[row] for places in compared], to_original[0])
        for row, band in enumerate(bands)
    }


def _compare(
    reference: Source, others: Sequence[Source], lens: Lens
) -> tuple[Matrix, list[tuple[Points, Points, Array]]]:
    """Common places of bands of one capture and the reference in reduced pixels, and those to original ones."""
    pixels, to_original = reduce_to_width(reference.read_photograph(lens).pixels, WORKING_WIDTH_PX)
    wanted = _edges(pixels)
    others_reduced = (reduce_to_width(other.read_photograph(lens).pixels, WORKING_WIDTH_PX)[0] for other in others)
    return to_original, [_places(wanted, _edges(other)) for other in others_reduced]


def _places(wanted: Float32, edges: Float32) -> tuple[Points, Points, Array]:
    """Where patches of the reference's edges lie in another band: points in both (N, 2), and their likeness (N,)."""
    shift, _ = cv2.phaseCorrelate(wanted.astype(np.float64), edges.astype(np.float64))
    matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]], dtype=np.float64)
    for reach_px in REACH_PX:
        found = _patches(wanted, edges, matrix, reach_px)
        if len(found[0]) < FEWEST_PLACES // 4:
            break
        estimate = estimate_homography(*found, rng=np.random.default_rng(0), restarts=1)
        if estimate.homography is None:
            break
        matrix = estimate.homography
    return found


def _edges(pixels: Pixels) -> Float32:
    """The gradient's magnitude, relative to that around it."""
    gray = cv2.GaussianBlur(to_gray(pixels).astype(np.float32), (0, 0), 1.0)
    magnitude = cv2.magnitude(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1))
    around = cv2.blur(magnitude, (gray.shape[1] // 16,) * 2)
    return np.asarray(np.sqrt(magnitude / (around + 1)), dtype=np.float32)


def _patches(wanted: Float32, edges: Float32, matrix: Matrix, reach_px: int) -> tuple[Points, Points, Array]:
    """Search patches of ``wanted`` about where ``matrix`` puts them."""
    height, width = wanted.shape
    half = round(PATCH_SHARE * width / 2)
    # Seen through the homography, a patch is only shifted.
    moved = cv2.warpPerspective(edges, matrix, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    margin = half + reach_px
    columns = np.linspace(margin, width - 1 - margin, PATCHES_ACROSS).round().astype(int)
    rows = np.linspace(margin, height - 1 - margin, PATCHES_DOWN).round().astype(int)
    here, there, likeness = [], [], []
    for y in rows.tolist():
        for x in columns.tolist():
            patch = wanted[y - half : y + half + 1, x - half : x + half + 1]
            field = moved[y - margin : y + margin + 1, x - margin : x + margin + 1]
            peak = _peak(cv2.matchTemplate(field, patch, cv2.TM_CCOEFF_NORMED))
            if peak is not None:
                here.append((x, y))
                there.append((x + peak[0] - reach_px, y + peak[1] - reach_px))
                likeness.append(peak[2])
    seen = apply(matrix, np.array(there, dtype=np.float64).reshape(-1, 2))
    return np.array(here, dtype=np.float64).reshape(-1, 2), seen, np.array(likeness)


def _peak(scores: Float32) -> tuple[float, float, float] | None:
    """Place and height of the best score, by parabolas through its neighbours; None at the border or if it is low."""
    _, best, _, (x, y) = cv2.minMaxLoc(scores)
    if best < LEAST_LIKENESS or not (0 < x < scores.shape[1] - 1 and 0 < y < scores.shape[0] - 1):
        return None
    offsets = []
    for before, after in ((scores[y, x - 1], scores[y, x + 1]), (scores[y - 1, x], scores[y + 1, x])):
        bend = float(before + after) - 2 * best
        offsets.append(float(before - after) / (2 * bend) if bend < 0 else 0.0)
    return x + offsets[0], y + offsets[1], best


def _fitted(
    band: str, reference: str, compared: Sequence[tuple[Points, Points, Array]], to_original: Matrix
) -> Alignment:
    """One homography for the places of several captures."""
    here, there, likeness = (np.concatenate(parts) for parts in zip(*compared, strict=True))
    estimate = estimate_homography(there, here, likeness, rng=np.random.default_rng(0))
    agreeing = int(np.count_nonzero(estimate.inliers))
    failed = f"band {band} cannot be aligned with band {reference}:"
    if estimate.homography is None or agreeing < max(FEWEST_PLACES, LEAST_AGREEING * len(here)):
        raise RegistrationError(
            f"{failed} {agreeing} of {len(here)} places in {len(compared)} captures agree; name another "
            "--band, or leave its files out"
        )
    errors = [
        float(np.median(np.linalg.norm(apply(estimate.homography, seen) - place, axis=1)))
        for place, seen, _ in compared
        if len(place) >= FEWEST_PLACES // 4
    ]
    if max(errors) > STEADY_PX:
        raise RegistrationError(
            f"{failed} it lies {max(errors):.1f} px off in one capture; the cameras of a rig must be "
            "fixed to each other and expose at the same time"
        )
    homography = to_original @ estimate.homography @ np.linalg.inv(to_original)
    return Alignment(np.asarray(homography / homography[2, 2]), float(np.median(errors) * to_original[0, 0]))
