"""Payloads of the painter's streams, from arrays of the golden model."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.painting.pose import elements


def corner_payload(corners: NDArray[np.int64]) -> list[dict[str, int]]:
    """The nine corners (3, 3, 2) of a tile, row by row."""
    return [{"x": int(x), "y": int(y)} for x, y in corners.reshape(-1, 2)]


def pixel_payload(colour: NDArray[np.integer], weight: int) -> dict[str, Any]:
    return {"colour": [int(channel) for channel in colour], "weight": int(weight)}


def pose_columns(pose: NDArray[np.int64]) -> list[list[int]]:
    """What is constant, then the factors of X and Y."""
    columns: list[list[int]] = elements(pose)[:, [2, 0, 1]].T.tolist()
    return columns
