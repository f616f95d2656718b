"""Alignment of the bands of a rig: cameras that are fixed to each other, one for each band.

Two bands of one capture differ by a homography that is the same for all captures: the cameras' centres are
centimetres apart, and the ground is far. It is fitted to places of several captures at once. Bands do not look alike
(plants are dark in red and bright in near infrared, which turns descriptors over), but their edges lie in the same
places: patches of the gradient's magnitude are compared by normalised correlation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Matrix, Pixels, Points
from golden_model.pixel.gray import to_gray
from skymosaic.common.errors import RegistrationError
from skymosaic.geometry.homography import apply, rescale, transfer_error
from skymosaic.geometry.prosac import estimate_homography
from skymosaic.imagery.images import reduce_to_width
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.registration.options import WORKING_WIDTH_PX
from skymosaic.running.workers import Workers

MAX_CAPTURES = 9
"""Captures that are compared, spread over the flight."""
PATCHES_ACROSS, PATCHES_DOWN = 9, 7
PATCH_SHARE = 1 / 12
"""Side of a patch, as a share of the picture's width."""
REACH_PX = (16, 4)
"""How far patches are searched: about the common shift of a capture, then about the first homography. Cameras that
are turned against each other by a degree move the borders of a picture by 11 of 1280 pixels."""
MIN_CORRELATION = 0.3
"""Correlation below which a patch is taken for another place."""
MIN_PLACES, MIN_AGREEING = 40, 0.4
"""Places, and share of all places, that must agree with one homography: fewer are no fixed alignment."""
MIN_PLACES_PER_CAPTURE = MIN_PLACES // 4
MAX_DRIFT_PX = 1.0
"""Median distance of a capture's places from where the others put them, beyond which the cameras are not fixed."""
Places = tuple[Points, Points, Array]
"""Common places of two bands: points in the reference and in the other band, (N, 2), and their correlation, (N,)."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """How one band lies on the reference band."""

    homography: Matrix
    """(3, 3): straightened pixels of the band to those of the reference band."""
    error_px: float
    """Median distance of the places that agree, px of the picture."""


def align_bands(captures: Sequence[Source], reference: str, lens: Lens, workers: Workers) -> Mapping[str, Alignment]:
    """Align all bands of some sets of the same bands with the reference band, which registers the flight.

    Raises
    ------
    RegistrationError
        If a band cannot be aligned: its pictures show other things, or the cameras moved against each other.
    """
    spread = np.unique(np.linspace(0, len(captures) - 1, min(len(captures), MAX_CAPTURES)).round().astype(int))
    bands = [band for band in captures[0].bands if band != reference]
    calls = [
        (captures[index].bands[reference], [captures[index].bands[band] for band in bands], lens)
        for index in spread.tolist()
    ]
    to_original, compared = zip(*workers.run("bands", _compare, calls), strict=True)
    names_and_places = zip(bands, zip(*compared, strict=True), strict=True)
    return {band: _fit(band, reference, places, to_original[0]) for band, places in names_and_places}


def _compare(reference: Source, others: Sequence[Source], lens: Lens) -> tuple[Matrix, list[Places]]:
    """Find the places that bands of one capture share with the reference, in reduced px; and reduced to original px."""
    pixels, to_original = reduce_to_width(reference.read_photograph(lens).pixels, WORKING_WIDTH_PX)
    reference_edges = _edges(pixels)
    reduced = (reduce_to_width(other.read_photograph(lens).pixels, WORKING_WIDTH_PX)[0] for other in others)
    return to_original, [_find_places(reference_edges, _edges(other)) for other in reduced]


def _find_places(reference: Float32, edges: Float32) -> Places:
    """Find where patches of the reference's edges lie in another band."""
    shift, _ = cv2.phaseCorrelate(reference.astype(np.float64), edges.astype(np.float64))
    matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]], dtype=np.float64)
    for reach_px in REACH_PX:
        places = _search_patches(reference, edges, matrix, reach_px)
        if len(places[0]) < MIN_PLACES_PER_CAPTURE:
            break
        estimate = estimate_homography(*places, rng=np.random.default_rng(0), restarts=1)
        if estimate.homography is None:
            break
        matrix = estimate.homography
    return places


def _edges(pixels: Pixels) -> Float32:
    """The gradient's magnitude relative to its mean around each pixel: bands differ in contrast, too."""
    gray = cv2.GaussianBlur(to_gray(pixels).astype(np.float32), (0, 0), 1.0)
    magnitude = cv2.magnitude(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1))
    around = cv2.blur(magnitude, (gray.shape[1] // 16,) * 2)
    return np.asarray(np.sqrt(magnitude / (around + 1)), dtype=np.float32)


def _search_patches(reference: Float32, edges: Float32, matrix: Matrix, reach_px: int) -> Places:
    """Search patches of ``reference`` in ``edges``, within ``reach_px`` of where ``matrix`` puts them."""
    height, width = reference.shape
    half = round(PATCH_SHARE * width / 2)
    # Seen through the homography, a patch is only shifted.
    moved = cv2.warpPerspective(edges, matrix, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    margin = half + reach_px
    columns = np.linspace(margin, width - 1 - margin, PATCHES_ACROSS).round().astype(int)
    rows = np.linspace(margin, height - 1 - margin, PATCHES_DOWN).round().astype(int)
    found = []
    for y in rows.tolist():
        for x in columns.tolist():
            patch = reference[y - half : y + half + 1, x - half : x + half + 1]
            field = moved[y - margin : y + margin + 1, x - margin : x + margin + 1]
            peak = _peak(cv2.matchTemplate(field, patch, cv2.TM_CCOEFF_NORMED))
            if peak is not None:
                found.append((x, y, x + peak[0] - reach_px, y + peak[1] - reach_px, peak[2]))
    places = np.array(found, dtype=np.float64).reshape(-1, 5)
    return places[:, :2], apply(matrix, places[:, 2:4]), places[:, 4]


def _peak(scores: Float32) -> tuple[float, float, float] | None:
    """Place and height of the best score, by parabolas through its neighbours; None at the border or if it is low."""
    _, best, _, (x, y) = cv2.minMaxLoc(scores)
    if best < MIN_CORRELATION or not (0 < x < scores.shape[1] - 1 and 0 < y < scores.shape[0] - 1):
        return None
    offsets = []
    for before, after in ((scores[y, x - 1], scores[y, x + 1]), (scores[y - 1, x], scores[y + 1, x])):
        bend = float(before + after) - 2 * best
        offsets.append(float(before - after) / (2 * bend) if bend < 0 else 0.0)
    return x + offsets[0], y + offsets[1], best


def _fit(band: str, reference: str, places: Sequence[Places], to_original: Matrix) -> Alignment:
    """Fit one homography to the places of several captures."""
    here, there, correlation = (np.concatenate(parts) for parts in zip(*places, strict=True))
    estimate = estimate_homography(there, here, correlation, rng=np.random.default_rng(0))
    agreeing = int(np.count_nonzero(estimate.inliers))
    failed = f"band {band} cannot be aligned with band {reference}:"
    if estimate.homography is None or agreeing < max(MIN_PLACES, MIN_AGREEING * len(here)):
        raise RegistrationError(
            f"{failed} {agreeing} of {len(here)} places in {len(places)} captures agree; name another "
            "`band`, or leave its files out"
        )
    errors = [
        float(np.median(transfer_error(estimate.homography, other, own)))
        for own, other, _ in places
        if len(own) >= MIN_PLACES_PER_CAPTURE
    ]
    if not errors:
        raise RegistrationError(
            f"{failed} none of {len(places)} captures shows {MIN_PLACES_PER_CAPTURE} places in both; name another "
            "`band`, or leave its files out"
        )
    if max(errors) > MAX_DRIFT_PX:
        raise RegistrationError(
            f"{failed} it lies {max(errors):.1f} px off in one capture; the cameras of a rig must be "
            "fixed to each other and expose at the same time"
        )
    homography = rescale(to_original @ estimate.homography @ np.linalg.inv(to_original))
    return Alignment(homography, float(np.median(errors) * to_original[0, 0]))
