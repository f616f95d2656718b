"""Images that several golden tests share."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import strategies as st

Texture = Callable[..., np.ndarray]


def _texture(height_px: int, width_px: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    blobs = sum(
        cv2.resize(rng.normal(0, 60, (height_px // s + 2, width_px // s + 2)), (width_px, height_px))
        for s in (3, 7, 19)
    )
    return np.clip(128 + blobs, 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def texture() -> Texture:
    """``texture(height_px, width_px, seed)``: an image with corners at several scales, uint8."""
    return _texture


def _content(height_px: int, width_px: int, kind: str, seed: int) -> np.ndarray:
    image = np.zeros((height_px, width_px), np.uint8)
    rng = np.random.default_rng(seed)
    if kind == "white":
        image[:] = 255
    elif kind == "checkerboard":
        image[np.indices(image.shape).sum(axis=0) % 2 == 0] = 255
    elif kind == "hot pixel":
        image[rng.integers(height_px), rng.integers(width_px)] = 255
    elif kind == "noise":
        image[:] = rng.integers(0, 256, image.shape)
    elif kind == "few levels":
        image[:] = rng.integers(0, 3, image.shape) * 127
    elif kind == "texture":
        image[:] = _texture(height_px, width_px, seed)
    return image


KINDS = ("black", "white", "checkerboard", "hot pixel", "noise", "few levels", "texture")


@pytest.fixture(scope="session")
def contents() -> Callable[..., st.SearchStrategy[np.ndarray]]:
    """``contents(least_px, most_px)``: gray images of any size in that range, extremes and odd sizes included."""

    def strategy(least_px: int, most_px: int) -> st.SearchStrategy[np.ndarray]:
        side = st.integers(least_px, most_px)
        return st.builds(_content, side, side, st.sampled_from(KINDS), st.integers(0, 99))

    return strategy
