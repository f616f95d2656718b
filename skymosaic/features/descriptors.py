"""Describes key points in feature records: by OpenCV's descriptors, ILBP, gray windows, or nothing (for KLT)."""

import itertools
from collections.abc import Callable
from functools import cache
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels, Records
from golden_model.feature import ilbp
from golden_model.feature.ilbp import PATTERNS
from golden_model.feature.orientation import SECTORS
from golden_model.formats import encode_response
from golden_model.matching.correlation import windows
from golden_model.pixel.smooth import binomial
from golden_model.records import Tag, feature_record
from skymosaic.features.detectors import KeyPoints, key_point_positions
from skymosaic.features.positions import raw_positions

Bytes = NDArray[np.uint8]
Descriptor = Literal[
    "ilbp-128", "ilbp-256", "ilbp-128-upright", "ilbp-256-upright",
    "thesis-ilbp-1", "thesis-ilbp-2", "thesis-ilbp-3", "thesis-ilbp-4",
    "window-3", "window-10", "window-22", "window-25", "window-30",
    "sift", "orb", "akaze", "brisk", "freak", "klt",
]  # fmt: skip
DESCRIPTORS: tuple[Descriptor, ...] = get_args(Descriptor)

_OPENCV: dict[str, Callable[[], cv2.Feature2D]] = {
    # nfeatures (0: all), octave layers, contrast and edge thresholds, sigma. SIFT's descriptors are whole numbers
    # from 0 to 255, so CV_8U loses nothing.
    "sift": lambda: cv2.SIFT.create(0, 3, 0.02, 10, 1.6, cv2.CV_8U, False),
    "orb": cv2.ORB.create,
    "akaze": cv2.xfeatures2d.AKAZE.create,
    "brisk": cv2.xfeatures2d.BRISK.create,
    "freak": cv2.xfeatures2d.FREAK.create,
}
WINDOWS_PX = {f"window-{size}": size for size in (3, 10, 22, 25, 30)}
"""Gray windows for correlation, with the sides of Table IV-2."""
TRACKED = "klt"
ANGLE_IGNORED = ("brisk", "freak", *PATTERNS, *WINDOWS_PX)
"""Descriptors that ignore a key point's angle. SIFT's key points at one position differ in nothing else, so these
descriptors would describe all of them alike."""
STRONGEST_RESPONSE = 1 << 30
"""Stored response of an image's strongest key point; the others are in proportion."""


def describe(gray: Pixels, key_points: KeyPoints, descriptor: str) -> Records:
    """Describe key points; the records keep their order.

    Key points nearer to the border than the descriptor's support are dropped. ILBP and windows are taken at the nearest
    pixel of the full-size image. The sector of a record (`golden_model.records.feature_record`) is ILBP's own, else
    that of the key point's angle.
    """
    if descriptor in _OPENCV:
        extractor = _extractor(descriptor)
        key_points, values = extractor.compute(gray, key_points)
        if values is None:
            values = np.empty((0, extractor.descriptorSize()), np.uint8)
        return _make_records(key_points, values)
    if descriptor in WINDOWS_PX:
        size_px = WINDOWS_PX[descriptor]
        key_points, x, y = _keep_inside(gray, key_points, -(-size_px // 2))
        return _make_records(key_points, windows(gray, x, y, size_px))
    if descriptor == TRACKED:
        return _make_records(key_points, np.empty((len(key_points), 0), np.uint8))
    return _describe_by_ilbp(gray, key_points, descriptor)


@cache
def _extractor(descriptor: str) -> cv2.Feature2D:
    """Create OpenCV's extractor, once: building BRISK's tables takes longer than describing an image."""
    return _OPENCV[descriptor]()


def _describe_by_ilbp(gray: Pixels, key_points: KeyPoints, descriptor: str) -> Records:
    pattern = PATTERNS[descriptor]
    key_points, x, y = _keep_inside(gray, key_points, pattern.support_px)
    sector, values = ilbp.describe(gray, binomial(gray, 5), x, y, pattern)
    window = windows(gray, x, y, size_px=3) if pattern.carries_window else None
    records = _make_records(key_points, values, window)
    records["sector"] = sector
    return records


def _keep_inside(
    gray: Pixels, key_points: KeyPoints, support_px: int
) -> tuple[KeyPoints, NDArray[np.intp], NDArray[np.intp]]:
    """Keep the key points at least ``support_px`` from the border; returns them with x and y (N,) of their pixels."""
    # Halves are rounded up, as in `raw_positions`.
    pixels = np.floor(key_point_positions(key_points) + 0.5).astype(np.intp)
    limits = np.array(gray.shape[::-1]) - support_px
    inside = ((pixels >= support_px) & (pixels < limits)).all(axis=1)
    return list(itertools.compress(key_points, inside)), *pixels[inside].T


def _make_records(key_points: KeyPoints, descriptors: Bytes, window: Bytes | None = None) -> Records:
    record = feature_record(descriptors.shape[1], 0 if window is None else window.shape[1])
    records = np.zeros(len(key_points), record.dtype)
    records["tag"] = Tag.FEATURE
    records["index"] = np.arange(len(records))
    records["x"], records["y"] = raw_positions(key_point_positions(key_points)).T
    angle = np.array([point.angle for point in key_points])
    records["sector"] = np.rint(angle * (SECTORS / 360)).astype(int) % SECTORS
    response = np.array([point.response for point in key_points], dtype=np.float64)
    scale = STRONGEST_RESPONSE / response.max(initial=1e-30)
    records["response"] = encode_response((np.maximum(response, 0) * scale).astype(np.int64))
    records["descriptor"] = descriptors
    if window is not None:
        records["window"] = window
    return records
