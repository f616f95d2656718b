"""What the numbers tab says of a pair."""

import numpy as np
import pytest

from sim.scene import make_pair
from skymosaic import register
from skymosaic.geometry.homography import transfer_error
from skymosaic.panel.pages.numbers_tab import _describe, _list_quality


def test_a_homography_is_described_by_its_turn_scale_and_shift() -> None:
    cos, sin = np.cos(np.radians(30)), np.sin(np.radians(30))
    turned = np.array([[1.5 * cos, -1.5 * sin, 7], [1.5 * sin, 1.5 * cos, -3], [0, 0, 1]])
    assert _describe(turned).endswith("rotates by 30.00°, scales by 1.5000, shifts by 7.0, -3.0 px")


def test_quality_is_measured_on_inliers_and_correct_matches() -> None:
    left, right = make_pair(9, size=(320, 240)).images
    pair = register(left, right)
    assert pair.homography is not None
    found = _list_quality(pair)
    ends = pair.points("inliers")
    rmse_px = np.sqrt(np.mean(transfer_error(pair.homography, ends.left, ends.right) ** 2))
    assert float(found["RMSE of the inliers"].removesuffix(" px")) == pytest.approx(rmse_px, abs=0.05)
    assert float(found["recall of the rules"]) > 0.8
    assert float(found["1 - precision"]) < 0.2
    assert found["computed by"] == "golden"
    assert found["confidence"].startswith("good: ")
    refined = [_list_quality(pair.with_homography(pair.homography, refined_inliers=n))["refined by"] for n in (0, 7)]
    assert refined == ["no dense flow", "7 points of dense flow"]
