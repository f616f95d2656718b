"""What a result says of its frame."""

from dataclasses import replace

import numpy as np
import pytest

from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH
from sim.backends.interface import FrameResult


@pytest.mark.parametrize(
    ("good", "causes", "accepted"), [(1, 0, True), (1, 2, False), (0, 0, None), (1, None, None), (0, None, None)]
)
def test_the_homography_of_a_good_frame_is_accepted_without_causes(
    good: int, causes: int | None, accepted: bool | None
) -> None:
    status, homography = np.zeros(1, FRAME_STATUS.dtype)[0], np.zeros(1, HOMOGRAPHY.dtype)[0]
    matches = np.zeros(5, MATCH.dtype)
    status["good"], homography["causes"], matches["verdict"] = good, causes or 0, (1, 0, 1, 1, 0)
    result = FrameResult.count_matches(matches[:0], matches, status)
    result = replace(result, homography=None if causes is None else homography)
    assert result.accepted is accepted
    assert (result.match_status["matches"], result.match_status["kept"], result.status["kept"]) == (5, 3, 0)
