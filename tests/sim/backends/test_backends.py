"""Backends: the golden model's, and what all of them answer."""

from dataclasses import replace

import numpy as np
import pytest

from golden_model.config import preset_config
from golden_model.front_end import extract
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH
from sim.backends.golden import REMEMBERED_FRAMES, GoldenBackend
from sim.backends.interface import FrameResult
from sim.scene import make_pair

CONFIG = preset_config("aerial")


def test_a_frame_that_comes_again_is_not_extracted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = make_pair(seed=1, size=(160, 120)).images
    fresh = GoldenBackend().run([right, left], CONFIG)
    backend, extracted = GoldenBackend(), []

    def count(*arguments: object) -> object:
        extracted.append(arguments)
        return extract(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("sim.backends.golden.extract", count)
    backend.run([left, right], CONFIG)
    again = backend.run([right, left], CONFIG)
    assert len(extracted) == 2
    for one, other in zip(again, fresh, strict=True):
        np.testing.assert_array_equal(one.features, other.features)
        np.testing.assert_array_equal(one.matches, other.matches)
        assert one.status == other.status
    backend.run([np.full((64, 64), gray, np.uint8) for gray in range(REMEMBERED_FRAMES)], CONFIG)
    backend.run([left], CONFIG)
    assert len(extracted) == 3 + REMEMBERED_FRAMES


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
