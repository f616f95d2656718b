"""Features of one photograph: thresholds that are raised, and features that suit only the options that gave them."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from golden_model.config import preset_config
from golden_model.records import Cause
from sim.scene import make_pair
from skymosaic import extract, register
from skymosaic.common.errors import InputError
from skymosaic.registration.extraction import extract_within_capacity, share_features
from skymosaic.registration.options import FeatureOptions

AERIAL = preset_config("aerial")


@pytest.mark.parametrize(
    ("first", "fits_from", "tried"),
    [(100, 100, [100]), (30, 101, [30, 60, 120]), (100, 255, [100, 200, 254]), (254, 255, [254])],
)
def test_the_threshold_is_raised_until_every_frame_fits(first: int, fits_from: int, tried: list[int]) -> None:
    thresholds = list[int]()

    def run(frames: list[Any], config: Any) -> list[Any]:
        """Only the second frame may have too many features; the first one has other troubles."""
        thresholds.append(config.front_end.threshold)
        causes = (0xFF & ~Cause.TOO_MANY_FEATURES, Cause.TOO_MANY_FEATURES * (thresholds[-1] < fits_from))
        return [SimpleNamespace(status={"causes": each}) for each in causes[: len(frames)]]

    config = dataclasses.replace(
        AERIAL, front_end=dataclasses.replace(AERIAL.front_end, detector="fast", threshold=first)
    )
    front_end: Any = SimpleNamespace(run=run)
    results, used = extract_within_capacity(front_end, [np.zeros((64, 64), np.uint8)] * 2, config)
    assert (len(results), thresholds) == (2, tried)
    assert used.front_end.threshold == tried[-1]


def test_features_are_shared_where_the_options_are_the_same_but_for_a_raised_threshold() -> None:
    left, right = make_pair(seed=5, size=(320, 240)).images
    features = extract(left)
    raised = dataclasses.replace(AERIAL.front_end, threshold=2 * AERIAL.front_end.threshold)
    as_raised = dataclasses.replace(features, config=dataclasses.replace(AERIAL, front_end=raised))
    silent: Any = None
    assert share_features(as_raised, FeatureOptions(), silent) is as_raised
    # Each keeps its own.
    assert register(as_raised, right).accepted
    fewer = dataclasses.replace(AERIAL.front_end, max_features=100)
    others: tuple[dict[str, Any], ...] = (
        {"working_width_px": 300},
        {"detector": "fast"},
        {"config": dataclasses.replace(AERIAL, front_end=fewer)},
    )
    for changes in others:
        with pytest.raises(InputError, match="its features were extracted with other options"):
            share_features(features, FeatureOptions(**changes), silent)
