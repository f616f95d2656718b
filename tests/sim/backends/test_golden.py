"""The golden backend's memory of frames changes nothing but the time."""

import numpy as np
import pytest

from golden_model.config import preset_config
from golden_model.front_end import extract
from sim.backends.golden import REMEMBERED_FRAMES, GoldenBackend
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
