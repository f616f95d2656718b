import pickle
from typing import Any

import numpy as np
import pytest

from skymosaic.imagery.parcel import Parcel

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    "pixels",
    [
        RNG.integers(0, 256, (7, 5, 3), np.uint8),
        RNG.integers(0, 65536, (7, 5, 4), np.uint16),
        RNG.random((6, 4)) > 0.5,
        RNG.integers(0, 256, (9, 8), np.uint8)[:, ::2],
        (RNG.random((9, 8)) > 0.5)[1:, ::2],
        RNG.integers(0, 65536, 9),
        np.zeros((0, 0), np.uint8),
    ],
    ids=lambda pixels: f"{pixels.dtype} {pixels.shape}",
)
def test_pixels_survive_the_way(pixels: Any) -> None:
    again = pickle.loads(pickle.dumps(Parcel(pixels))).pixels
    np.testing.assert_array_equal(again, pixels)
    assert again.dtype == pixels.dtype


def test_smooth_pictures_and_masks_shrink() -> None:
    ramp = np.add.outer(np.arange(256), np.arange(256)).astype(np.uint8)
    mask = np.zeros((256, 256), np.bool_)
    mask[50:90] = True
    assert len(pickle.dumps(Parcel(ramp))) < 2000
    assert len(pickle.dumps(Parcel(mask))) < 2000
    assert Parcel(mask).pixels is mask
