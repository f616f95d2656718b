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
from golden_model.geometry.estimator import EstimateCause, FrameMatches, estimate, homography_record
from golden_model.geometry.fixed_point import quantise
from golden_model.matching.matcher import match
from golden_model.painting.painter import Painter
from golden_model.painting.pose import Placement, Poses
from golden_model.pixel.threshold import next_code
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Cause, Record, Tag, feature_record

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


@pytest.mark.parametrize(
    ("record", "recorded"),
    [
        (feature_record(16, 9), "2c9131dd89fc"),
        (MATCH, "9c73403469bc"),
        (FRAME_STATUS, "c3f2b0bcdc13"),
        (HOMOGRAPHY, "0fd6bc638aaf"),
    ],
)
def test_records_have_their_fields_where_they_were(record: Record, recorded: str) -> None:
    fields = [(field.name, field.bits, field.storage_bytes, offset) for field, offset in record.offsets()]
    assert digest(int(record.tag), record.record_bytes, fields) == recorded


def test_numbers_of_causes_and_tags_stay() -> None:
    numbers = [(each.name, each.value) for names in (Tag, Cause, EstimateCause) for each in names]
    assert digest(numbers) == "2f70e3e1d450"


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


def test_thresholds_follow_the_counts_as_recorded() -> None:
    counts = range(0, 4001, 250)
    codes = [next_code(code, n, 1500, name) for code in (1, 40, 9000) for n in counts for name in ("harris", "fast")]
    assert digest(codes) == "55ad55db0d1e"


def test_an_estimate_is_the_recorded_one() -> None:
    rng = np.random.default_rng(5)
    left = rng.integers(1000, (9000, 6500), (150, 2))
    # Turned, sheared and shrunk by integers; every third one is wrong.
    right = left @ np.array([[30, -3], [4, 29]]) // 32 + (300, 700)
    right[::3] = rng.integers(0, 7000, right[::3].shape)
    given = FrameMatches(left, right, rng.integers(70, 256, 150), (640, 480))
    result = estimate(given, EstimatorConfig(passes=3))
    assert result.inliers == 100
    assert digest(homography_record(result)) == "34d2a84387f8"


def test_a_painted_canvas_is_the_recorded_one() -> None:
    painter, poses = Painter(6, 5), Poses()
    colours = np.stack([picture(seed) for seed in range(3)], axis=-1)
    for frame, move_px in enumerate((0, 37)):
        # All of these are exact in floating point.
        H = np.array([[0.875, 0.125, 5 + move_px], [-0.125, 1.0, 9], [2**-13, -(2**-14), 1]])
        pose, causes = poses.place(Placement(frame, 0, quantise(H[np.newaxis])[0], composed=False))
        assert pose is not None, causes
        counts = painter.paint(colours, pose)
        assert counts.painted
    assert digest(painter.memory) == "284b919ec27b"
