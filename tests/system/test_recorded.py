"""What boards send and compute that were built earlier: the model changes with the hardware, but they do not.

A digest that changes is a new version of the hardware: say so in CHANGELOG.md.
"""

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from golden_model.config import PRESETS, Config, EstimatorConfig, FrontEndConfig
from golden_model.front_end import extract
from golden_model.geometry.estimator import FrameMatches, estimate, homography_record
from golden_model.matching.matcher import match
from golden_model.pixel.threshold import next_code

WIDTH_PX, HEIGHT_PX = 180, 132


def digest(*contents: Any) -> str:
    """Of integers and texts, and of the fields of records: nobody fills the bytes between them."""
    whole = hashlib.sha256()
    for each in contents:
        if isinstance(each, np.ndarray):
            for part in [each] if each.dtype.names is None else [each[name] for name in each.dtype.names]:
                whole.update(np.ascontiguousarray(part).tobytes())
        else:
            whole.update(repr(each).encode())
    return whole.hexdigest()[:12]


def picture(seed: int) -> np.ndarray:
    """Squares of several sizes, made of integers alone: no processor rounds them otherwise."""
    rng = np.random.default_rng(seed)
    layers = (
        np.kron(rng.integers(0, 86, (HEIGHT_PX // s + 1, WIDTH_PX // s + 1)), np.ones((s, s), int)) for s in (3, 7, 16)
    )
    return sum(layer[:HEIGHT_PX, :WIDTH_PX] for layer in layers).astype(np.uint8)


FAST = replace(PRESETS["aerial"], front_end=FrontEndConfig(detector="fast", threshold=20))


@pytest.mark.parametrize(
    ("config", "features", "matches"),
    [
        (PRESETS["aerial"], "56d3c85f117a", "63e2a849f3ec"),
        (FAST, "31a505ba0d72", "4fb84a4deae3"),
        (PRESETS["thesis"], "0039663a39bb", "bfb745265de6"),
    ],
    ids=["aerial", "fast", "thesis"],
)
def test_features_and_matches_are_the_recorded_ones(config: Config, features: str, matches: str) -> None:
    whole = picture(1)
    # Seen again a little farther to the right and below, and somewhat brighter.
    frames = whole[:-4, :-5], np.minimum(whole[4:, 5:] + 9, 255).astype(np.uint8)
    left, right = (extract(frame, config.front_end, frame=n).features for n, frame in enumerate(frames))
    found = match(left, right, config.front_end.pattern, config.matcher)
    assert min(len(left), len(found), np.ptp(found["weight"])) > 20
    assert (digest(left, right), digest(found)) == (features, matches)


def test_thresholds_and_estimates_are_the_recorded_ones() -> None:
    counts = range(0, 4001, 250)
    codes = [next_code(code, n, 1500, name) for code in (1, 40, 9000) for n in counts for name in ("harris", "fast")]
    assert digest(codes) == "55ad55db0d1e"
    rng = np.random.default_rng(5)
    left = rng.integers(1000, (9000, 6500), (150, 2))
    # Turned, sheared and shrunk by integers; every third one is wrong.
    right = left @ np.array([[30, -3], [4, 29]]) // 32 + (300, 700)
    right[::3] = rng.integers(0, 7000, right[::3].shape)
    given = FrameMatches(left, right, rng.integers(70, 256, 150), (640, 480))
    result = estimate(given, EstimatorConfig(passes=3))
    assert result.inliers == 100
    assert digest(homography_record(result)) == "34d2a84387f8"
