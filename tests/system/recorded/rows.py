"""Holds what is computed against `rows.json`: a row of numbers by its name.

The other tests say what each step must do, and allow for what it may. These notice what none of them thinks of: a
result that is another one. Where one is meant to be, look at it, and put the row that the failing test prints there.
"""

import functools
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from golden_model.arrays import Array, Pixels

WIDTH_PX, HEIGHT_PX = 320, 240
RECORDED = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
Picture = NDArray[np.float32]


def check_recorded(name: str, values: ArrayLike, tolerance: float) -> None:
    """Compare numbers with a row; without vector instructions all pass, too."""
    found = np.asarray(values, np.float64).ravel()
    decimals = max(0, 1 - int(np.floor(np.log10(tolerance))))
    assert RECORDED.get(name) == pytest.approx(found, abs=tolerance), f'"{name}": {np.round(found, decimals).tolist()}'


def check_picture(
    name: str, picture: NDArray[np.generic], shown: NDArray[np.bool_], *, tolerance: float = 0.03
) -> None:
    """Compare the mean and the detail of 3 x 4 parts of a picture, and how much of it shows ground, per cent."""
    whole = picture.astype(np.float32)
    planes = whole.mean(axis=2), np.abs(cv2.Laplacian(whole, cv2.CV_32F)).mean(axis=2)
    parts = [cv2.resize(plane, (4, 3), interpolation=cv2.INTER_AREA) for plane in planes]
    check_recorded(name, [*np.ravel(parts), 100 * shown.mean()], tolerance)


@functools.cache
def _grain() -> Picture:
    """Ground of three scales of grain, (700, 900, 3)."""
    rng, size = np.random.default_rng(1), (900, 700)
    grains = (rng.uniform(0, 75, (size[1] // px, size[0] // px, 3)) for px in (3, 9, 40))
    whole = sum(cv2.resize(grain, size, interpolation=cv2.INTER_CUBIC) for grain in grains)
    return np.asarray(whole, dtype=np.float32)


def view(x: float, y: float, turn: float = 0.0, zoom: float = 1.0, tilt: float = 0.0) -> tuple[Picture, Array]:
    """The ground from above a place, or from the side; and where the view lies, (3, 3)."""
    cos, sin = zoom * np.cos(turn), zoom * np.sin(turn)
    place = np.array([[cos, -sin, x], [sin, cos, y], [tilt, 0, 1]])
    place = place @ np.array([[1.0, 0, -WIDTH_PX / 2], [0, 1, -HEIGHT_PX / 2], [0, 0, 1]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = WIDTH_PX, HEIGHT_PX
    return cv2.warpPerspective(_grain(), place, size, flags=flags, borderMode=cv2.BORDER_REFLECT), place


def with_hills(picture: Picture, height_px: float) -> Picture:
    """The view of ground with relief, which no homography follows."""
    y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float32)
    moved = x + np.float32(height_px) * np.sin(x / 60) * np.cos(y / 45)
    return cv2.remap(picture, moved, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


def as_pixels(picture: NDArray[np.floating]) -> Pixels:
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)
