"""Photographs of places, and what a camera shows before all of them: a display, dirt, the pattern of its sensor."""

import cv2
import numpy as np

from golden_model.arrays import Pixels

SIZE = (640, 480)


def with_display(image: np.ndarray) -> np.ndarray:
    """A drone's display: text in the corners and along the borders, a cross in the middle."""
    shown = image.copy()
    for y, line in ((25, "H 120.4 m  D 381 m  REC 00:41"), (465, "HS 5.2 m/s VS 0.0 GPS 17 ISO 100"), (50, "BAT 61 %")):
        cv2.putText(shown, line, (12, y), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)
    cv2.drawMarker(shown, (320, 240), (255, 255, 255), cv2.MARKER_CROSS, 30, 2)
    return shown


def with_dirt(image: np.ndarray) -> np.ndarray:
    """Dirt on the glass before the lens, dark and sharp."""
    shown, rng = image.copy(), np.random.default_rng(4)
    for x, y in rng.integers(30, (SIZE[0] - 30, SIZE[1] - 30), (20, 2)).tolist():
        cv2.fillPoly(shown, [np.array((x, y)) + rng.integers(-22, 23, (9, 2))], (5, 5, 5))
    return shown


def with_jittering_display(image: np.ndarray) -> np.ndarray:
    """A display that is not always drawn at the same pixel: lines of text over half of the picture."""
    shown = image.copy()
    jitter = int(image[0, 0, 0]) % 3
    for line in range(10):
        text = f"ALT {100 + 7 * line} M  SPD {line}.4 GPS 12"
        cv2.putText(shown, text, (15 + jitter, 30 + 22 * line + jitter), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255,) * 3, 2)
    return shown


def with_lines(site: Pixels) -> Pixels:
    """Ground of half the contrast behind eight lines of text."""
    shown = np.asarray(36 + 0.5 * site.astype(np.float64), dtype=np.uint8)
    for line in range(8):
        text = f"ALT {100 + 7 * line} M SPD {line}.4 GPS 12 BAT 14.{line}V LAT 4{line}.2{line}"
        cv2.putText(shown, text, (5, 25 + 40 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 2)
    return shown


def at_night(image: np.ndarray, number: int, contrast: float = 0.25) -> np.ndarray:
    """Little contrast, under the pattern of a sensor, and with the noise of a photograph."""
    pattern, rng = np.random.default_rng(0).normal(0, 5, image.shape[:2]), np.random.default_rng(number + 1)
    dark = 100 + contrast * image.mean(axis=2) + pattern + rng.normal(0, 1.5, image.shape[:2])
    return np.asarray(dark.clip(0, 255), dtype=np.uint8)


def ground(seed: int) -> np.ndarray:
    """A place from above: noise of four sizes, which costs a hundredth of a rendered scene."""
    rng, (width, height) = np.random.default_rng(seed), SIZE
    layers = [
        cv2.resize(rng.normal(0, 1, (height // size, width // size, 3)), (2 * width, 2 * height)) * np.sqrt(size)
        for size in (2, 5, 14, 40)
    ]
    return np.asarray(cv2.normalize(np.sum(layers, axis=0), None, 0, 255, cv2.NORM_MINMAX), dtype=np.uint8)


def seen(place: np.ndarray, x_px: float, y_px: float, degrees: float = 0.0) -> np.ndarray:
    """A photograph of a place, turned about its middle."""
    to_place = cv2.getRotationMatrix2D((SIZE[0] / 2, SIZE[1] / 2), degrees, 1.0)
    to_place[:, 2] += x_px, y_px
    return np.asarray(cv2.warpAffine(place, to_place, SIZE, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP))
