"""The front end: `extract` computes the features of a frame, `trace` also returns all intermediate planes."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels, Records
from golden_model.config import FrontEndConfig
from golden_model.feature import ilbp, subpixel
from golden_model.formats import encode_response
from golden_model.matching.correlation import windows
from golden_model.pixel import fast, harris, nms, sobel
from golden_model.pixel.gray import to_gray
from golden_model.pixel.half import halve
from golden_model.pixel.smooth import binomial
from golden_model.records import FRAME_STATUS, Cause, Tag
from golden_model.selection import selection


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """Output of the front end for one frame."""

    features: Records
    """Records (N,) of `golden_model.records.feature_record` in the order of emission; none if the frame is bad."""
    status: np.void
    """`golden_model.records.FRAME_STATUS`; ``threshold`` is the response code that was used, ``features`` is N."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Output of a stage for a level: an array of the level's shape, unspecified within ``margin_px`` of its border."""

    values: NDArray[Any]
    margin_px: int

    @property
    def specified(self) -> NDArray[Any]:
        """The part that hardware must reproduce exactly."""
        height, width = self.values.shape
        return self.values[self.margin_px : height - self.margin_px, self.margin_px : width - self.margin_px]


@dataclass(frozen=True, eq=False)
class FrontEndTrace:
    """Result for one frame, and for each level the planes of its stages in the order of the data flow.

    Stages: ``gray``; for Harris ``smoothed``, ``gradient_x``, ``gradient_y``, ``tensor_a``, ``tensor_b``,
    ``tensor_c``, ``raw_response``; for both detectors ``response_code``, ``candidates`` (the code where it survived
    suppression and border, else 0) and, where the descriptor is smoothed, ``smoothed5``.
    """

    result: FrameFeatures
    levels: tuple[dict[str, Plane], ...]


class _Corners(NamedTuple):
    """The chosen corners of one level; each field is an array of shape (N,)."""

    x: NDArray[np.intp]
    y: NDArray[np.intp]
    response: NDArray[np.uint16]
    full_x: NDArray[np.uint16]
    full_y: NDArray[np.uint16]


BAND_PX = 64
"""Rows whose response is computed together: their planes stay in the cache, and in memory that is at hand already."""

Keep = Callable[[str, NDArray[Any], int], None]
"""Called with the name, plane and margin of each stage."""


def extract(image: Pixels, config: FrontEndConfig, *, frame: int = 0) -> FrameFeatures:
    """Features of one frame.

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W) or (H, W, 3) BGR
        64 to 4096 px a side.
    config : FrontEndConfig
        Cell size and features per cell, where None, are chosen by `FrontEndConfig.for_size`.
    frame : int
        Number of the frame, copied into the records.

    Returns
    -------
    FrameFeatures
        A frame with more corners than ``max_features`` is bad (`Cause.TOO_MANY_FEATURES`) and has no features.

    Raises
    ------
    ValueError
        If type, shape or size of the image is not supported.
    """
    return _extract(image, config, frame, lambda _level, _name, _values, _margin_px: None, BAND_PX)


def trace(image: Pixels, config: FrontEndConfig) -> FrontEndTrace:
    """Like `extract`, but also return the plane of every stage."""
    levels: tuple[dict[str, Plane], ...] = tuple({} for _ in range(config.levels))

    def keep(level: int, name: str, values: NDArray[Any], margin_px: int) -> None:
        levels[level][name] = Plane(values, margin_px)

    return FrontEndTrace(_extract(image, config, 0, keep, image.shape[0]), levels)


def _extract(
    image: Pixels, config: FrontEndConfig, frame: int, keep: Callable[[int, str, NDArray[Any], int], None], band_px: int
) -> FrameFeatures:
    full = to_gray(image)
    size_px = full.shape[1], full.shape[0]
    config = config.for_size(*size_px)
    # Levels do not depend on each other: the same stages run on each of them.
    pyramid = [full, halve(full)][: config.levels]
    chosen = [_choose_corners(gray, level, config, partial(keep, level), band_px) for level, gray in enumerate(pyramid)]
    if sum(len(corners.x) for corners in chosen) > config.max_features:
        no_features = np.zeros(0, config.pattern.record.dtype)
        return FrameFeatures(no_features, _status(config, frame, size_px, no_features, Cause.TOO_MANY_FEATURES))
    parts = [
        _describe_corners(gray, corners, level, config, partial(keep, level))
        for level, (gray, corners) in enumerate(zip(pyramid, chosen, strict=True))
    ]
    # `np.concatenate` drops the padding at the end of the records; the cast restores it.
    features = np.concatenate(parts).astype(config.pattern.record.dtype, copy=False)
    # Without selection there is one level, and its raster order is the order of emission.
    if config.cell_px:
        cell_row = np.concatenate([corners.y // config.cell_px for corners in chosen])
        features = features[selection.emission_order(features["level"], cell_row)]
    features["index"] = np.arange(len(features))
    features["frame"] = frame
    return FrameFeatures(features, _status(config, frame, size_px, features, Cause(0)))


def _choose_corners(gray: Pixels, level: int, config: FrontEndConfig, keep: Keep, band_px: int) -> _Corners:
    keep("gray", gray, 0)
    code = np.empty(gray.shape, np.uint16)
    support_px = config.response_support_px
    for top in range(0, len(gray), band_px):
        # Twice the support: a last band of one row still holds FAST's whole circle.
        above = min(top, 2 * support_px)
        band = gray[top - above : top + band_px + support_px]
        code[top : top + band_px] = _compute_response(band, config, keep)[above : above + band_px]
    keep("response_code", code, config.response_support_px)
    survivors = nms.suppress(code, *config.suppression)
    # After the suppression: a response in the border may still suppress one inside.
    candidates = np.zeros_like(survivors)
    rows, columns = (slice(config.border_px, max(side_px - config.border_px, 0)) for side_px in gray.shape)
    candidates[rows, columns] = survivors[rows, columns]
    keep("candidates", candidates, 0)
    if config.cell_px and config.per_cell:
        x, y = selection.best_of_cells(candidates, config.cell_px, config.per_cell)
    else:
        x, y = selection.raster(candidates)
    return _Corners(x, y, code[y, x], *subpixel.refine(code, x, y, level))


def _compute_response(gray: Pixels, config: FrontEndConfig, keep: Keep) -> NDArray[np.uint16]:
    if config.detector == "fast":
        return fast.response_code(gray, config.threshold)
    smoothed, margin_px = (binomial(gray, 3), 1) if config.smoothed_gradients else (gray, 0)
    keep("smoothed", smoothed, margin_px)
    gradients = sobel.gradients(smoothed)
    for name, gradient in zip(("gradient_x", "gradient_y"), gradients, strict=True):
        keep(name, gradient, margin_px + 1)
    tensor = harris.structure_tensor(*gradients, config.tensor_window_px)
    for name, plane in zip(("tensor_a", "tensor_b", "tensor_c"), tensor, strict=True):
        keep(name, plane, config.response_support_px)
    raw = harris.raw_response(*tensor, config.harris_k_numerator, config.harris_k_shift)
    keep("raw_response", raw, config.response_support_px)
    return harris.response_code(raw, config.threshold)


def _describe_corners(gray: Pixels, corners: _Corners, level: int, config: FrontEndConfig, keep: Keep) -> Records:
    pattern = config.pattern
    smoothed5 = gray
    if pattern.smoothed:
        smoothed5 = binomial(gray, 5)
        keep("smoothed5", smoothed5, 2)
    records = np.zeros(len(corners.x), config.pattern.record.dtype)
    records["tag"] = Tag.FEATURE
    records["level"] = level
    records["response"] = corners.response
    records["x"] = corners.full_x
    records["y"] = corners.full_y
    records["sector"], records["descriptor"] = ilbp.describe(gray, smoothed5, corners.x, corners.y, pattern)
    if pattern.carries_window:
        records["window"] = windows(gray, corners.x, corners.y, size_px=3)
    return records


def _status(config: FrontEndConfig, frame: int, size_px: tuple[int, int], features: Records, causes: Cause) -> np.void:
    status = np.zeros(1, FRAME_STATUS.dtype)
    status["tag"] = Tag.FRAME_STATUS
    status["good"] = causes == 0
    status["causes"] = causes
    status["frame"] = frame
    status["width"], status["height"] = size_px
    status["features"] = len(features)
    status["threshold"] = encode_response(np.array(config.threshold))
    record: np.void = status[0]
    return record
