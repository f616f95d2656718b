import numpy as np

from golden_model.config import preset_config
from golden_model.front_end import extract
from skymosaic.features.guided_matching import match_guided
from skymosaic.features.positions import feature_points

CONFIG = preset_config("aerial")


def test_guided_matches_equal_an_exhaustive_search() -> None:
    """The KD-tree must find the same pairs as the table of all distances."""
    rng = np.random.default_rng(0)
    left = np.zeros(150, extract(np.zeros((64, 64), np.uint8), CONFIG.front_end).features.dtype)
    right = left.copy()
    for side in (left, right):
        side["x"], side["y"] = rng.integers(0, 60 * 16, (2, 150))
        side["descriptor"] = rng.integers(0, 4, side["descriptor"].shape)  # many equal distances
    i, j = match_guided(left, right, np.eye(3), 8.0)
    distance = np.bitwise_count(left["descriptor"][:, None] ^ right["descriptor"][None]).sum(axis=2).astype(int)
    far = np.linalg.norm(feature_points(left)[:, None] - feature_points(right)[None], axis=2) > 8.0
    distance[far] = 128
    nearest_right, nearest_left = distance.argmin(axis=1), distance.argmin(axis=0)
    expected = [
        (row, nearest_right[row])
        for row in range(150)
        if nearest_left[nearest_right[row]] == row and distance[row, nearest_right[row]] < 0.34 * 128
    ]
    assert len(expected) > 20
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == expected
