"""Copies of an image at other scales and simulated tilts, for further passes of the front end.

The front end describes two octaves of an image. Copies at other scales fill the gaps between octaves and extend
their range; copies compressed in one direction imitate a camera that looks from the side (Morel and Yu, ASIFT: a new
framework for fully affine invariant image comparison, 2009). To front end and matcher they are ordinary frames.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from golden_model.arrays import Matrix, Pixels, Records
from golden_model.config import MAX_FRAME_PX, MIN_FRAME_PX, Config, FrontEndConfig
from golden_model.feature.orientation import SECTORS
from golden_model.records import MATCH
from sim.backends.interface import Backend
from skymosaic.features.positions import feature_points, match_points, raw_positions
from skymosaic.geometry.homography import apply, resize_matrix

EDGE_PX = 20
"""The front end has no room for a descriptor within so many pixels of an edge."""
TILT_BLUR = 0.8
"""Blur before a compression by t, in sqrt(t² - 1) px (ASIFT's value): the aliasing limit of a camera's own blur."""


@dataclass(frozen=True)
class Change:
    """What is done to an image: resized by ``scale``, compressed by ``tilt`` along ``direction_deg``, or inverted.

    Reflected into a margin, it keeps the corners near its edges, where the front end has no room for a descriptor. Of a
    ``quarter``, by its column and row, only that part is resized, with as much of its neighbours.
    """

    scale: float = 1.0
    tilt: float = 1.0
    direction_deg: float = 0.0
    inverted: bool = False
    margin_px: int = 0
    quarter: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class ChangedImage:
    """A changed copy of an image, and the affine map (3, 3) from its pixels to the image's."""

    pixels: Pixels
    to_image: Matrix


@dataclass(eq=False)
class DescribedImage:
    """An image that keeps the features of its changed copies, so that pairs share them."""

    image: Pixels
    kept: dict[tuple[Change, FrontEndConfig], tuple[ChangedImage, Records] | None] = field(
        default_factory=dict, repr=False
    )
    """What `describe` returned so far; at most 100 kB each, and four dozen. Not pickled."""

    def describe(self, change: Change, front_end: Backend, config: Config) -> tuple[ChangedImage, Records] | None:
        """The changed copy, without its pixels, and its features; None as of `change_image`."""
        key = change, config.front_end
        if key not in self.kept:
            frame = change_image(self.image, change)
            self.kept[key] = None
            if frame is not None:
                features = front_end.run([frame.pixels], config)[0].features
                self.kept[key] = replace(frame, pixels=frame.pixels[:0]), features
        return self.kept[key]

    def __getstate__(self) -> dict[str, Any]:
        return {"image": self.image, "kept": {}}


def change_image(image: Pixels, change: Change) -> ChangedImage | None:
    """Make a changed copy of an image; None where a side would leave the front end's range."""
    if change.quarter is not None:
        return _change_quarter(image, change, *change.quarter)
    image = ~image if change.inverted else image
    height_px, width_px = image.shape[:2]
    size = round(width_px * change.scale), round(height_px * change.scale)
    if not all(MIN_FRAME_PX <= side_px <= MAX_FRAME_PX - 2 * change.margin_px for side_px in size):
        return None
    pixels, to_image = image, np.eye(3)
    if size != (width_px, height_px):
        # Averaging prevents aliasing; enlarged, it would give blocks.
        filtering = cv2.INTER_AREA if change.scale < 1 else cv2.INTER_CUBIC
        pixels = np.asarray(cv2.resize(image, size, interpolation=filtering), dtype=np.uint8)
        to_image = resize_matrix(width_px / size[0], height_px / size[1])
    if margin_px := change.margin_px:
        pixels = np.asarray(
            cv2.copyMakeBorder(pixels, margin_px, margin_px, margin_px, margin_px, cv2.BORDER_REFLECT), dtype=np.uint8
        )
        to_image = to_image @ np.array([[1, 0, -margin_px], [0, 1, -margin_px], [0, 0, 1]])
    if change.tilt == 1:
        return ChangedImage(pixels, to_image)
    compressed = _compress(pixels, change.tilt, math.radians(change.direction_deg))
    if min(compressed.pixels.shape[:2]) < MIN_FRAME_PX:
        return None
    return ChangedImage(compressed.pixels, to_image @ compressed.to_image)


def _change_quarter(image: Pixels, change: Change, column: int, row: int) -> ChangedImage | None:
    """Cut out a quarter, with the strip of its neighbours in which its own frame has no corners, and change that."""
    strip_px = math.ceil(EDGE_PX / change.scale)
    (x, right), (y, bottom) = (
        (max(0, i * side_px // 2 - strip_px), min(side_px, (i + 1) * side_px // 2 + strip_px))
        for i, side_px in ((column, image.shape[1]), (row, image.shape[0]))
    )
    frame = change_image(image[y:bottom, x:right], replace(change, quarter=None))
    if frame is None:
        return None
    return replace(frame, to_image=np.array([[1, 0, x], [0, 1, y], [0, 0, 1]]) @ frame.to_image)


def _compress(image: Pixels, tilt: float, direction_rad: float) -> ChangedImage:
    """Compress an image by ``tilt`` along a direction, in the smallest frame that holds it; blurs it first."""
    cosine, sine = math.cos(direction_rad), math.sin(direction_rad)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    linear = turn.T @ np.diag([1 / tilt, 1.0]) @ turn
    height_px, width_px = image.shape[:2]
    corners = np.array([[0, 0], [width_px - 1, 0], [width_px - 1, height_px - 1], [0, height_px - 1]]) @ linear.T
    low = np.floor(corners.min(axis=0))
    width, height = (np.ceil(corners.max(axis=0) - low) + 1).astype(int).tolist()
    forward = np.eye(3)
    forward[:2, :2], forward[:2, 2] = linear, -low
    blurred = cv2.filter2D(image, -1, _line_blur(tilt, cosine, sine), borderType=cv2.BORDER_REFLECT)
    # A reflection outside the image keeps its edges from making corners. `map_matches_to_images` drops what is found
    # out there.
    pixels = cv2.warpAffine(
        blurred, forward[:2], (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    return ChangedImage(np.asarray(pixels, dtype=np.uint8), np.asarray(np.linalg.inv(forward)))


def _line_blur(tilt: float, cosine: float, sine: float) -> Matrix:
    """A Gaussian kernel along a direction, one pixel wide across it."""
    # Across the direction, 0.35 px leaves next to nothing outside one pixel.
    along_px, across_px = TILT_BLUR * math.sqrt(tilt**2 - 1), 0.35
    # The tails beyond hold 2 % of the weight, and a kernel larger than 15x15 takes OpenCV five times as long.
    radius = math.ceil(2.25 * along_px)
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    along, across = x * cosine + y * sine, y * cosine - x * sine
    kernel = np.exp(-0.5 * ((along / along_px) ** 2 + (across / across_px) ** 2))
    return np.asarray(kernel / kernel.sum())


def map_to_image(features: Records, to_image: Matrix) -> Records:
    """Move feature records of a frame to their positions in the image."""
    moved = features.copy()
    moved["x"], moved["y"] = raw_positions(apply(to_image, feature_points(features))).T
    return moved


def map_matches_to_images(
    matches: Records, frames: tuple[ChangedImage, ChangedImage], images: tuple[Pixels, Pixels]
) -> Records:
    """Move match records of two frames to their positions in the images; drops those outside the images."""
    moved = matches.copy()
    inside = np.ones(len(matches), dtype=bool)
    for side, frame, image, points in zip(("left", "right"), frames, images, match_points(matches), strict=True):
        mapped = apply(frame.to_image, points)
        inside &= ((mapped >= 0) & (mapped <= np.array(image.shape[1::-1]) - 1)).all(axis=1)
        moved[f"{side}_x"], moved[f"{side}_y"] = raw_positions(mapped).T
    return moved[inside]


def swap_sides(matches: Records) -> Records:
    """Swap left and right of match records, which then turn the other way."""
    other = np.zeros(len(matches), dtype=MATCH.dtype)
    for name in matches.dtype.names or ():
        side, _, rest = name.partition("_")
        source = {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)
        other[name] = matches[source]
    for name in ("turn", "peak_turn"):
        other[name] = -other[name].astype(np.int16) % SECTORS
    return other
