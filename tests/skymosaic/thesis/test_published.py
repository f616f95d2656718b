import pytest

from skymosaic.thesis.published import PUBLISHED


def test_published_recall_is_inliers_over_matched() -> None:
    ratios = [round(PUBLISHED.number("IV-4", s, "inliers / matched"), 2) for s in PUBLISHED.settings("IV-4")]
    recall = [each for setting in ("scenes", "tests") for each in PUBLISHED.values("IV-6", setting, "recall")]
    assert ratios == pytest.approx(recall, abs=0.011)
