"""Whether a homography joins the ground, or what moves with the camera.

A display, the border of scanned film, dirt on the lens or a sensor's pattern agree in any two photographs of a camera,
also in those of different places. A camera that has hardly moved sees no parallax: then nearly all of the ground must
agree, not only what the matches lie on. The farther it has moved, the more of the ground may differ by relief. So both
pictures are reduced until a sensor's pattern averages out, one is warped onto the other, and blocks vote, each once,
whether they fit best where the homography says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from golden_model.arrays import Array, Float32, Mask, Matrix, Pixels, Points
from golden_model.pixel.gray import to_gray
from skymosaic.geometry.homography import apply, resize_matrix, transfer_error

LONGER_SIDE_PX = 160
"""Longer side of the reduced pictures, in whose pixels the sizes below are."""
BLOCK_PX = 12
SEARCH_PX, NEAR_PX = 4, 1
"""A block agrees if its best place within the first distance, along both axes, is within the second: by chance, one in
nine does."""
FINE_PX, COARSE_PX = 1.0, 5.0
"""Sigmas of the band-pass: what is finer is noise, what is coarser light."""
MIN_CONTRAST, MIN_WARPED_CONTRAST = 1.0, 0.3
"""Gray levels (standard deviation) of a block that can vote. In the warped picture it may be blurred."""
MIN_BLOCKS = 12
"""Fewer tell nothing."""
STILL_SHARE, SHARE_PER_SIDE = 0.7, 3.0
"""Share of the blocks that must agree where the camera stood still, and how much less for each longer side that it
moved."""
FAR = STILL_SHARE / SHARE_PER_SIDE
"""From here on, nothing must agree."""
DOUBT = 0.2
"""What lacks more of the share is refused; what lacks less is in doubt."""
GOOD_SHARE, RIVAL_SHARE = 0.4, 0.25
"""Share without which no pair is good, and without which no other homography is taken instead of a rejected one."""
MAX_RIVALS = 3
EXPLAINED_PX, APART_PX = 3.0, 16.0
"""A match that a rejected homography explains to the first distance, or that has an inlier of it within the second, may
move with the camera, too. Working px."""
MOVES_WITH_CAMERA = "what moves with the camera (a display, a border, dirt on the lens) is not counted"
"""Note of a result that leaves such matches out."""


@dataclass(frozen=True, eq=False)
class Sight:
    """A photograph, reduced: gray and where it shows ground (255), (H, W), and the map (3, 3) to its working pixels."""

    gray: Pixels
    visible: Pixels
    to_working: Array

    @classmethod
    def of(cls, pixels: Pixels, visible: Pixels | None = None, to_working: Array | None = None) -> Sight:
        """Reduce a picture, (H, W) or (H, W, 3) BGR; by default a working image that shows ground everywhere."""
        height, width = pixels.shape[:2]
        factor = min(LONGER_SIDE_PX / max(width, height), 1.0)
        size = max(round(width * factor), 1), max(round(height * factor), 1)
        small = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        shown = np.full(size[::-1], 255, np.uint8)
        if visible is not None:
            shown = np.asarray(cv2.resize(visible, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        to_picture = resize_matrix(width / size[0], height / size[1])
        return cls(to_gray(small), shown, to_picture if to_working is None else to_working @ to_picture)

    def inverted(self) -> Sight:
        """Its negative."""
        return Sight(~self.gray, self.visible, self.to_working)


@dataclass(frozen=True, eq=False)
class GroundAgreement:
    """How much of the ground agrees with a homography.

    Attributes
    ----------
    agreeing : ndarray of bool, shape (rows, columns)
        The blocks of the left picture that agree.
    blocks : int
        How many voted.
    motion : float
        Mean motion of the picture's corners, as a share of its longer side.
    """

    agreeing: Mask
    blocks: int
    motion: float

    @property
    def share(self) -> float:
        """Share of the blocks that agree; 1 where too few can tell."""
        return float(np.count_nonzero(self.agreeing)) / self.blocks if self.blocks >= MIN_BLOCKS else 1.0

    @property
    def required(self) -> float:
        """Share that must agree, at least; 0 and less where the camera moved too far for that to tell anything."""
        return STILL_SHARE - SHARE_PER_SIDE * self.motion

    @property
    def suffices(self) -> bool:
        """Whether as much agrees as must."""
        return self.share >= self.required

    @property
    def wins(self) -> bool:
        """Whether enough agrees that it is taken instead of a homography that was rejected."""
        return self.blocks >= MIN_BLOCKS and self.share >= RIVAL_SHARE

    @property
    def is_good(self) -> bool:
        """Whether a pair may be good."""
        return self.share >= max(GOOD_SHARE, self.required)

    @property
    def is_refused(self) -> bool:
        """Whether far less agrees than must."""
        return self.share < self.required - DOUBT

    def explain(self) -> str:
        """What agrees, how much of the ground it covers, how much it should, and what may be the cause."""
        covers = f"what agrees covers {100 * self.share:.0f} % of the ground"
        if self.suffices:
            return covers
        moved = f"a camera that moved by {100 * self.motion:.0f} % of the picture needs {100 * self.required:.0f} %"
        return f"{covers}, and {moved}: mask what moves with it (display, border, dirt); or water or cars move"


def measure_agreement(left: Sight, right: Sight, homography: Matrix, explained: Mask | None = None) -> GroundAgreement:
    """Measure how much of the ground agrees with a homography (3, 3) between working images, left to right.

    Blocks (rows, columns) that are ``explained`` otherwise do not vote.
    """
    to_right = _between(left, right, homography)
    (height, width), to_left = left.gray.shape, cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    covered = cv2.warpPerspective(right.visible, to_right, (width, height), flags=to_left)
    # A reflection beyond the overlap has no edge that would look like ground.
    warped = cv2.warpPerspective(right.gray, to_right, (width, height), flags=to_left, borderMode=cv2.BORDER_REFLECT)
    own, other = _band_pass(left.gray), _band_pass(warped)
    votes = _blocks(np.minimum(covered, left.visible)).mean(axis=(1, 3)) > 0.98 * 255
    votes &= _blocks(own).std(axis=(1, 3)) > MIN_CONTRAST
    votes &= _blocks(other).std(axis=(1, 3)) > MIN_WARPED_CONTRAST
    if explained is not None:
        votes &= ~explained
    agreeing = np.zeros_like(votes)
    around = np.pad(other, SEARCH_PX)
    for row, column in np.argwhere(votes).tolist():
        agreeing[row, column] = _fits_best_here(own, around, BLOCK_PX * row, BLOCK_PX * column)
    return GroundAgreement(agreeing, int(np.count_nonzero(votes)), _motion(to_right, width, height))


def _between(left: Sight, right: Sight, homography: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(right.to_working) @ homography @ left.to_working)


def _motion(to_right: Matrix, width: int, height: int) -> float:
    """Mean motion of the corners, as a share of the longer side."""
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    return float(np.linalg.norm(apply(to_right, corners) - corners, axis=1).mean() / max(width, height))


def _band_pass(gray: NDArray[np.number]) -> Float32:
    values = gray.astype(np.float32)
    return np.asarray(cv2.GaussianBlur(values, (0, 0), FINE_PX) - cv2.GaussianBlur(values, (0, 0), COARSE_PX))


def _blocks(values: NDArray[np.number]) -> NDArray[np.number]:
    """The whole blocks of a picture, (rows, height, columns, width)."""
    rows, columns = (side // BLOCK_PX for side in values.shape)
    return values[: rows * BLOCK_PX, : columns * BLOCK_PX].reshape(rows, BLOCK_PX, columns, BLOCK_PX)


def _fits_best_here(own: Float32, around: Float32, y: int, x: int) -> bool:
    """Whether a block of a picture fits best where it is in the other one, which has a border of `SEARCH_PX`."""
    window = around[y : y + BLOCK_PX + 2 * SEARCH_PX, x : x + BLOCK_PX + 2 * SEARCH_PX]
    likeness = cv2.matchTemplate(window, own[y : y + BLOCK_PX, x : x + BLOCK_PX], cv2.TM_CCOEFF_NORMED)
    return bool(np.abs(np.subtract(cv2.minMaxLoc(likeness)[3], SEARCH_PX)).max() <= NEAR_PX)


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Homographies that do not join the ground, each with its inliers, (N, 2) left and right."""

    rejected: tuple[tuple[Matrix, Points, Points], ...] = ()

    def are_apart(self, left: Points, right: Points) -> Mask:
        """Which points (N, 2) of both images may be ground, (N,)."""
        apart = np.ones(len(left), np.bool_)
        for homography, *inliers in self.rejected:
            apart &= ~(transfer_error(homography, left, right) <= EXPLAINED_PX)
            for points, moving in zip((left, right), inliers, strict=True):
                apart &= KDTree(moving).query(points)[0] > APART_PX
        return apart


class Fit(Protocol):
    """What a search finds."""

    @property
    def homography(self) -> Matrix | None:
        """Left to right working px; None where there is none."""

    @property
    def inlier_points(self) -> tuple[Points, Points]:
        """The matches that agree with it, (N, 2) left and right."""


AnyFit = TypeVar("AnyFit", bound=Fit)


def find_ground(
    search: Callable[[LeftOut], AnyFit], see: Callable[[AnyFit], tuple[Sight, Sight]]
) -> tuple[AnyFit, GroundAgreement | None, LeftOut]:
    """Search until a homography joins the ground.

    One that does not is rejected, and the search is made again without what may move with the camera. A rival needs
    ground that no rejected homography explains. Where none is found, the first fit is returned, which lacks agreement.

    Parameters
    ----------
    search : callable
        Searches the matches that may be ground.
    see : callable
        The pictures, left and right, that a fit compares.

    Returns
    -------
    The fit, how much of the ground agrees (None where that tells nothing), and what was rejected.
    """
    left_out, explained, first = LeftOut(), None, None
    for _ in range(1 + MAX_RIVALS):
        fit = search(left_out)
        if fit.homography is None:
            break
        sights = see(fit)
        if first is None and _motion(_between(*sights, fit.homography), *sights[0].gray.shape[::-1]) >= FAR:
            return fit, None, left_out
        agreement = measure_agreement(*sights, fit.homography, explained)
        if agreement.suffices and (first is None or agreement.wins):
            return fit, agreement, left_out
        first = first or (fit, agreement)
        explained = agreement.agreeing if explained is None else explained | agreement.agreeing
        left_out = LeftOut((*left_out.rejected, (fit.homography, *fit.inlier_points)))
    return (*(first or (fit, None)), left_out)
