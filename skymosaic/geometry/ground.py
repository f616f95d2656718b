"""Whether a homography joins the ground, or what moves with the camera.

A display, the border of scanned film, dirt on the lens or a sensor's pattern agree in any two photographs of a camera,
also in those of different places. A camera that has hardly moved sees no parallax: then nearly all of the ground must
agree, not only what the matches lie on. The farther it has moved, the more of the ground may differ by relief. So both
pictures are reduced until a sensor's pattern averages out, one is warped onto the other, and blocks vote, each once,
whether they fit best where the homography says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

from golden_model.arrays import Array, Float32, Mask, Matrix, Pixels, Points
from golden_model.pixel.gray import to_gray
from skymosaic.common.later import Later
from skymosaic.geometry.acceptance import overlap_mask
from skymosaic.geometry.homography import apply, resize_matrix, transfer_error
from skymosaic.geometry.horizon import Size, warp_reflected

SIDES_PX = COARSEST_SIDE_PX, COARSE_SIDE_PX, FINE_SIDE_PX = 80, 160, 480
"""Longer sides of the reduced pictures, in whose pixels the sizes below are. In the coarsest ones, nothing is left of a
sensor's pattern; they are compared, too, where it may be what agrees. In the finest ones, what lies between the lines
of a display has blocks of its own; they are compared where the others leave a doubt."""
BLOCK_PX = 12
SEARCH_PX, NEAR_PX, SHIFTS = 4, 1, 9
"""A block agrees if its best place within the first distance, along both axes, is within the second: by chance, one in
nine does. The last is the number of places along an axis."""
NOISE_PX, LIGHT_PX = 1.0, 5.0
"""Sigmas of the band-pass: what is finer than the first is noise, what is coarser than the second light."""
MIN_CONTRAST, LOW_CONTRAST = 1.0, 0.3
"""Gray levels (standard deviation) of a block that can vote. In the warped picture it may be blurred, and in the
coarsest ones there is no noise: there, the second is enough."""
MIN_BLOCKS = 12
"""Fewer tell nothing, but that nothing of the ground is seen to agree where the camera stood still."""
STILL_SHARE, SHARE_PER_SIDE = 0.7, 3.0
"""Share of the blocks that must agree where the camera stood still, and how much less for each longer side that it
moved."""
STILL, FAR = 0.01, STILL_SHARE / SHARE_PER_SIDE
"""Below the first motion the camera stood still, or a sensor's pattern is what agrees; from the second on, nothing must
agree."""
DOUBT = 0.2
"""Where more of the share is lacking, no finer pictures are asked."""
RIVAL_SHARE = 0.25
"""Share without which no other homography is taken instead of a rejected one."""
ALIKE, ELSEWHERE_PX = 0.8, 8
"""Correlation of a rival, and how far away it is, at least, in pixels of the coarse pictures."""
MAX_RIVALS = 3
EXPLAINED_PX, APART_PX = 3.0, 16.0
"""A match that a rejected homography explains to the first distance, or that has an inlier of it within the second, may
move with the camera, too. Working px."""
Fit = TypeVar("Fit")
spatial = Later("scipy.spatial")
MOVES_WITH_CAMERA = "what moves with the camera (a display, a border, dirt, a sensor's pattern) is not counted"
"""Note of a result that leaves such matches out."""


class Sight(NamedTuple):
    """A picture of the ground, (H, W) or (H, W, 3) BGR: a working image, or a reduced one."""

    pixels: Pixels
    visible: Pixels | None = None
    """255 where it shows ground, (H, W); None: everywhere."""
    to_working: Array = np.eye(3)
    """Its pixels to working ones, (3, 3)."""

    @property
    def size(self) -> Size:
        """Width and height, px."""
        return self.pixels.shape[1], self.pixels.shape[0]

    def reduced(self, side_px: int) -> Sight:
        """The same in gray, with the longer side at most so long."""
        width, height = self.size
        factor = min(side_px / max(width, height), 1.0)
        size = max(round(width * factor), 1), max(round(height * factor), 1)
        gray = to_gray(np.asarray(cv2.resize(self.pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8))
        visible = self.visible
        if visible is not None:
            visible = np.asarray(cv2.resize(visible, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return Sight(gray, visible, self.to_working @ resize_matrix(width / size[0], height / size[1]))


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
    covered : float
        Share of the overlap whose blocks vote and agree.
    voted : float or None
        Share of the votes that agree, in the size of pictures that decides; None where too few blocks voted.
    """

    agreeing: Mask
    blocks: int
    motion: float
    covered: float
    voted: float | None

    @property
    def tells(self) -> bool:
        """Whether enough blocks vote."""
        return self.blocks >= MIN_BLOCKS

    @property
    def share(self) -> float:
        """Share of the blocks that agree; where too few can tell, 1, or 0 if the camera stood still."""
        return float(self.motion >= STILL) if self.voted is None else self.voted

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
        return self.tells and self.share >= RIVAL_SHARE


def measure_ground(left: Sight, right: Sight, homography: Matrix, explained: Mask | None = None) -> GroundAgreement:
    """Measure how much of the ground agrees with a homography (3, 3) between working images, left to right.

    Blocks (rows, columns) that are ``explained`` otherwise do not vote.
    """
    coarse = count_agreeing(lay_over(COARSE_SIDE_PX, left, right, homography), explained)
    if explained is not None or (coarse.tells and coarse.share < coarse.required - DOUBT):
        return coarse
    sides = [COARSEST_SIDE_PX] * (coarse.motion < STILL) + [FINE_SIDE_PX] * (coarse.tells and not coarse.suffices)
    others = [count_agreeing(lay_over(side, left, right, homography)) for side in sides]
    decisive = min((other for other in others if other.tells), key=lambda other: other.share, default=coarse)
    return coarse if coarse.suffices and decisive.suffices else replace(coarse, voted=decisive.voted)


class Overlay(NamedTuple):
    """Two pictures reduced to a longer side and band-passed, on the left one's pixels, and left to right."""

    side_px: int
    own: Float32
    other: Float32
    shown: Pixels
    """255 where both show ground."""
    to_right: Matrix


def lay_over(side_px: int, left: Sight, right: Sight, homography: Matrix) -> Overlay:
    """Lay the right picture over the left one, by a homography (3, 3) between working images."""
    left, right = left.reduced(side_px), right.reduced(side_px)
    to_right = np.asarray(np.linalg.inv(right.to_working) @ homography @ left.to_working)
    warped = warp_reflected(right.pixels, to_right, left.size)
    own, other = band_pass(left.pixels, LIGHT_PX), band_pass(warped, LIGHT_PX)
    return Overlay(side_px, own, other, _mask_common(left, right, to_right), to_right)


def count_agreeing(overlay: Overlay, explained: Mask | None = None) -> GroundAgreement:
    """`measure_ground` in pictures of one size; of the finest ones, a quarter of the blocks is asked."""
    side_px, own, other, shown, to_right = overlay
    blocks = tuple(slice(0, side // BLOCK_PX * BLOCK_PX, BLOCK_PX) for side in own.shape)
    common = cv2.blur(shown, (BLOCK_PX, BLOCK_PX), anchor=(0, 0))[blocks] > 250
    if side_px == FINE_SIDE_PX:
        common[1::2] = common[:, 1::2] = False
    contrast = MIN_CONTRAST if side_px > COARSEST_SIDE_PX else LOW_CONTRAST
    votes = common & (_block_variances(own)[blocks] > contrast**2)
    votes &= _block_variances(other)[blocks] > LOW_CONTRAST**2
    if explained is not None:
        votes &= ~explained
    agreeing = votes.copy()
    agreeing[votes] = _fit_best_here(own, other, votes)
    agreed, count, within = (int(np.count_nonzero(each)) for each in (agreeing, votes, common))
    voted = agreed / count if count >= MIN_BLOCKS else None
    return GroundAgreement(agreeing, count, _motion(to_right, own.shape[::-1]), agreed / max(within, 1), voted)


def find_unmoved(overlay: Overlay, left: Sight, right: Sight) -> Mask:
    """The blocks (rows, columns) that agree at the same pixels, although the homography moves them away from there."""
    agreeing = count_agreeing(lay_over(overlay.side_px, left, right, np.eye(3))).agreeing
    rows, columns = (np.arange(0, side // BLOCK_PX * BLOCK_PX, BLOCK_PX) for side in overlay.own.shape)
    middles = np.stack(np.meshgrid(columns, rows), axis=-1) + (BLOCK_PX - 1) / 2
    # Around the middle of a turn, a block agrees at both places, and is ground.
    return np.asarray(agreeing & (np.abs(apply(overlay.to_right, middles) - middles).max(axis=-1) > 2 * NEAR_PX))


def _mask_common(left: Sight, right: Sight, to_right: Matrix) -> Pixels:
    """The left picture's mask of the ground that both show, 255 there, by a homography between the pictures."""
    shown = overlap_mask(to_right, left.size, right.size)
    if left.visible is not None:
        shown = np.minimum(shown, left.visible)
    if right.visible is not None:
        to_left = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        shown = np.minimum(shown, cv2.warpPerspective(right.visible, to_right, left.size, flags=to_left))
    return shown


def _motion(to_right: Matrix, size: Size) -> float:
    """Mean motion of the corners, as a share of the longer side."""
    width, height = size
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    return float(np.linalg.norm(apply(to_right, corners) - corners, axis=1).mean() / max(width, height))


def _motion_of_most(left: Sight, right: Sight, homography: Matrix, inliers: tuple[Points, Points]) -> float:
    """Motion of the corners by a homography, or the median one of its inliers, working px, where they stand still.

    Text that stands still, with one match beside it, fits a homography that moves all else far.
    """
    from_working = [np.asarray(np.linalg.inv(sight.to_working)) for sight in (left, right)]
    start, end = (apply(to_picture, points) for to_picture, points in zip(from_working, inliers, strict=True))
    moved = np.linalg.norm(end - start, axis=1) / max(left.size)
    stood = float(np.median(moved))
    return stood if stood < STILL else _motion(from_working[1] @ homography @ left.to_working, left.size)


def band_pass(gray: Pixels, coarsest_px: float) -> Float32:
    """The image without what is finer than `NOISE_PX`, which does not correlate, and what is coarser than a sigma."""
    values = gray.astype(np.float32)
    return np.asarray(cv2.GaussianBlur(values, (0, 0), NOISE_PX) - cv2.GaussianBlur(values, (0, 0), coarsest_px))


def _block_variances(values: Float32) -> Float32:
    """Variance of the block that begins at each pixel, (H, W)."""
    mean, square = (cv2.blur(each, (BLOCK_PX, BLOCK_PX), anchor=(0, 0)) for each in (values, values * values))
    return np.asarray(square - mean * mean)


def _windows(values: Float32, votes: Mask, side_px: int) -> Float32:
    """The square that begins where each block that votes does, (N, side_px, side_px)."""
    strides = BLOCK_PX * values.strides[0], BLOCK_PX * values.strides[1], *values.strides
    # A tenth of the time of `sliding_window_view`, which a pair would notice.
    squares: Float32 = np.ndarray((*votes.shape, side_px, side_px), values.dtype, values, strides=strides)
    return squares[votes]


def _fit_best_here(own: Float32, other: Float32, votes: Mask) -> Mask:
    """Which blocks that vote fit best, by `cv2.TM_CCOEFF_NORMED`, where they are in the other picture, (N,)."""
    around = np.asarray(cv2.copyMakeBorder(other, SEARCH_PX, SEARCH_PX, SEARCH_PX, SEARCH_PX, cv2.BORDER_CONSTANT))
    templates, windows = _windows(own, votes, BLOCK_PX), _windows(around, votes, BLOCK_PX + 2 * SEARCH_PX)
    templates -= templates.mean(axis=(1, 2), keepdims=True)
    side = windows.shape[1:]
    alike = np.fft.irfft2(np.fft.rfft2(windows) * np.conj(np.fft.rfft2(templates, side)), side)[:, :SHIFTS, :SHIFTS]
    # Where nothing varies, only rounding fits.
    spread = np.sqrt(np.maximum(_windows(_block_variances(around), votes, SHIFTS), 1e-4))
    best = np.array(np.divmod((alike / spread).reshape(-1, SHIFTS**2).argmax(axis=1), SHIFTS))
    return np.asarray((np.abs(best - SEARCH_PX) <= NEAR_PX).all(axis=0))


def measure_rival(overlay: Overlay) -> float:
    """How well the overlap correlates at its best place elsewhere, as a share of how well it does where it is.

    Only places where half of the overlap still lies on itself count. In pictures of 160 px, photographs of ground reach
    0.7; where it repeats itself so far that nothing tells a place from the next, as in an empty form, 0.99 and more.
    """
    x, y, width, height = cv2.boundingRect(overlay.shown)
    box = slice(y, y + height), slice(x, x + width)
    shown = (overlay.shown[box] > 0).astype(np.float32)
    own, other = overlay.own[box] * shown, overlay.other[box] * shown
    # What is moved by half of the box, along either axis, leaves half of the overlap, or less.
    size = [cv2.getOptimalDFTSize(side + side // 2 + 1) for side in shown.shape]
    one, two, one_energy, two_energy, common = (
        np.fft.rfft2(each, size) for each in (own, other, own * own, other * other, shown)
    )
    products = ((one, two), (one_energy, common), (common, two_energy), (common, common))
    both, own_energy, other_energy, count = (np.fft.irfft2(a * np.conj(b), size) for a, b in products)
    # Where nothing varies, only rounding correlates.
    alike = np.abs(both) / np.sqrt(np.maximum(own_energy * other_energy, 1e-3))
    alike[count < count[0, 0] / 2] = 0
    down, along = (np.abs(np.fft.fftfreq(side, 1 / side)) for side in size)
    elsewhere = float(alike[np.maximum(down[:, None], along) > ELSEWHERE_PX].max(initial=0))
    # Under a display or over cars, little correlates anywhere.
    return elsewhere / float(alike[0, 0]) if elsewhere >= ALIKE else 0.0


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
                apart &= spatial.KDTree(moving).query(points)[0] > APART_PX
        return apart


def find_ground(
    search: Callable[[LeftOut], tuple[Fit, Matrix | None, tuple[Points, Points]]],
    see: Callable[[Fit], tuple[Sight, Sight]],
) -> tuple[Fit, GroundAgreement | None, LeftOut]:
    """Search until a homography joins the ground.

    One that does not is rejected, and the search is made again without what may move with the camera. A rival needs
    ground that no rejected homography explains. Where none is found, the first fit is returned, which lacks agreement.

    Parameters
    ----------
    search : callable
        Searches the matches that may be ground: what it finds, of any type, the homography, and its inliers, (N, 2)
        left and right.
    see : callable
        The pictures, left and right, that a fit compares.

    Returns
    -------
    The fit, how much of the ground agrees (None where that tells nothing), and what was rejected.
    """
    left_out, explained, first = LeftOut(), None, None
    for _ in range(1 + MAX_RIVALS):
        fit, homography, inliers = search(left_out)
        if homography is None:
            break
        sights = see(fit)
        motion = _motion_of_most(*sights, homography, inliers)
        if first is None and motion >= FAR:
            return fit, None, left_out
        agreement = replace(measure_ground(*sights, homography, explained), motion=motion)
        if agreement.suffices and (first is None or agreement.wins):
            return fit, agreement, left_out
        first = first or (fit, agreement)
        explained = agreement.agreeing if explained is None else explained | agreement.agreeing
        left_out = LeftOut((*left_out.rejected, (homography, *inliers)))
    return (*(first or (fit, None)), left_out)
