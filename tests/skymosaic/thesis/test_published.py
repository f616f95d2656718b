import numpy as np

from skymosaic.thesis import published


def test_published_recall_is_inliers_over_matched() -> None:
    ratios = [round(row[5] / row[2], 2) for row in published.FUZZY_RANSAC.values()]
    np.testing.assert_allclose(ratios, [*published.RECALL["scenes"], *published.RECALL["tests"]], atol=0.011)
