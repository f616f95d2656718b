"""Pictures of the documentation: where they lie, and how they are written."""

from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Pixels

PICTURES = Path(__file__).parents[1] / "docs" / "images"
SEED = 9
"""The built-in pair, which they show, has this seed."""
QUALITY = 70


def save(path: Path, pixels: Pixels) -> None:
    """Write a picture as WebP."""
    cv2.imwrite(str(path), pixels, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


def decode(png: bytes) -> Pixels:
    """The pixels of a PNG."""
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)
