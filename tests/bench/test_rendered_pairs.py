import numpy as np
import pytest

from bench.rendered_pairs import SIZE_PX, SMALL_PX, flat_pair
from skymosaic.geometry.acceptance import hull_area, overlap
from skymosaic.geometry.ground import Sight
from skymosaic.geometry.horizon import ahead
from skymosaic.registration.confidence import correlate_overlap


@pytest.mark.parametrize(
    ("kind", "step", "share"),
    [("horizon", 80, (0.03, 0.5)), ("overlap", 10, (0.05, 0.15)), ("small", 35, (0.2, 0.5)), ("dark", 2, (0.45, 0.65))],
)
def test_hard_pairs_show_what_their_name_says(kind: str, step: float, share: tuple[float, float]) -> None:
    left, right, truth = flat_pair(kind, step, 2)
    size = SMALL_PX if kind == "small" else SIZE_PX
    assert left.shape == right.shape == size[::-1]
    # The truth lays the photographs on each other.
    assert correlate_overlap(Sight(left), Sight(right), truth) > 0.3
    assert share[0] < hull_area(overlap(truth, size, size)) / (size[0] * size[1]) < share[1]
    corners = np.array([[0.0, 0], [size[0], 0], [size[0], size[1]], [0, size[1]]])
    assert bool(ahead(truth, corners).min() < 0) is (kind == "horizon")
    assert bool(max(left.mean(), right.mean()) < 30) is (kind == "dark")
