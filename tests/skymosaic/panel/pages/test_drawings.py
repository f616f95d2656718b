import numpy as np

from skymosaic.panel.pages import drawings


def test_the_nearest_line_is_found_only_within_the_distance() -> None:
    lines = np.array([[0, 0, 100, 0], [0, 50, 100, 50], [200, 0, 200, 0]], dtype=np.float64)
    assert drawings.find_nearest(lines, 50, 10, within=12) == 0
    assert drawings.find_nearest(lines, 50, 41, within=12) == 1
    assert drawings.find_nearest(lines, 50, 25, within=12) is None
    assert drawings.find_nearest(lines, 110, 50, within=12) == 1
    assert drawings.find_nearest(lines, 203, 4, within=6) == 2
    assert drawings.find_nearest(lines[:0], 0, 0, within=1e9) is None
