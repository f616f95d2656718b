"""A rendered flight of three bands, whose cameras are turned and shifted against each other by known homographies."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower

CAPTURES, SIZE, MARGIN_PX = 5, (400, 300), 24
WHOLE = (SIZE[0] + 2 * MARGIN_PX, SIZE[1] + 2 * MARGIN_PX)
INTO_FRAME = np.array([[1, 0, -MARGIN_PX], [0, 1, -MARGIN_PX], [0, 0, 1.0]])
RIG = {"RED": (7.3, -4.6, 0.6), "NIR": (-9.2, 5.1, -0.8)}
"""Pixels to the right, pixels down, degrees."""


def homography(band: str) -> np.ndarray:
    """Pixels of a band to those of the green one."""
    if band not in RIG:
        return np.eye(3)
    x, y, degrees = RIG[band]
    turn = cv2.getRotationMatrix2D(((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2), degrees, 1.0)
    turn[:, 2] += x, y
    return np.vstack([turn, [2e-6, -1e-6, 1]])


@pytest.fixture(scope="session")
def band_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """16 bits; what is dark in green is bright in near infrared, where each capture has an exposure of its own."""
    folder = tmp_path_factory.mktemp("bands")
    rng = np.random.default_rng(0)
    for number, image in enumerate(make_lawnmower(5, CAPTURES, WHOLE, forward_overlap=0.7, side_overlap=0.6).images):
        green, red = (cv2.GaussianBlur(image[..., k].astype(np.float32), (0, 0), 0.7) for k in (1, 2))
        shown = {"GRE": 4000 + 120 * green, "RED": 3000 + 90 * red, "NIR": (1 + 0.1 * number) * (45_000 - 150 * green)}
        for band, values in shown.items():
            matrix = np.linalg.inv(homography(band)) @ INTO_FRAME
            seen = cv2.warpPerspective(values, matrix, SIZE, flags=cv2.INTER_CUBIC)
            noisy = np.clip(seen + rng.normal(0, 60, seen.shape), 0, 65_535)
            cv2.imwrite(str(folder / f"IMG_{number:04}_{band}.TIF"), noisy.astype(np.uint16))
    return folder
