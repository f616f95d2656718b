import dataclasses
import itertools
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from golden_model.config import PRESETS, RuleBase, preset_config
from golden_model.records import MATCH, feature_record
from sim.scene import make_pair
from skymosaic.common.errors import InputError
from skymosaic.features.detectors import DETECTORS
from skymosaic.features.methods import HostBackend, Method, choose_method
from skymosaic.geometry.homography import apply
from skymosaic.registration.options import FeatureOptions
from skymosaic.registration.register import register

FLIGHT = make_pair(seed=1)
SOME_DETECTORS = {"harris", "sift", "klt"}
SOME_DESCRIPTORS = ("ilbp-128", "thesis-ilbp-4", "window-10", "sift", "orb", "brisk", "freak", "klt")


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return list(FLIGHT.images)


@pytest.mark.parametrize(
    ("detector", "descriptor"),
    [
        pytest.param(
            *each, marks=[pytest.mark.slow] * (each[0] not in SOME_DETECTORS and each[1] not in {"ilbp-128", "orb"})
        )
        for each in itertools.product(DETECTORS, SOME_DESCRIPTORS)
    ],
)
def test_every_combination_speaks_the_front_ends_language(images: list[Pixels], detector: str, descriptor: str) -> None:
    config = PRESETS["aerial"]
    # Small crops: the language is tested here, not the quality.
    frames = [image[100:260, 100:300] for image in images]
    method, config = choose_method(config, detector, descriptor)
    left, right = FeatureOptions().open_backend(method).run(frames, config)
    assert right.matches.dtype == MATCH.dtype
    window_bytes = left.features.dtype["window"].shape[0] if "window" in (left.features.dtype.names or ()) else 0
    record = feature_record(left.features.dtype["descriptor"].shape[0], window_bytes)
    assert left.features.dtype == record.dtype == right.features.dtype
    assert int(left.status["features"]) == len(left.features)
    for side, result in (("left", left), ("right", right)):
        index = right.matches[f"{side}_index"]
        for axis in ("x", "y"):
            np.testing.assert_array_equal(right.matches[f"{side}_{axis}"], result.features[axis][index])
    assert np.all(np.diff(right.matches["left_index"].astype(int)) > 0)
    assert len(method.rule_names(config)) > right.matches["rule"].max(initial=0)


@pytest.mark.parametrize("options", [
    {"detector": "orb"}, {"detector": "akaze"}, {"detector": "surf"}, {"detector": "fast", "estimator": "magsac"},
    {"detector": "harris", "descriptor": "freak", "estimator": "ransac"}, {"detector": "brisk"},
    {"detector": "sift", "descriptor": "ilbp-128", "estimator": "fuzzy-ransac"},
])  # fmt: skip
def test_a_rendered_pair_is_registered(images: list[Pixels], options: dict[str, Any]) -> None:
    left, right = images
    pair = register(left, right, **options)
    assert pair.accepted, pair.reason
    assert pair.homography is not None
    corners = np.array([[200.0, 100], [500, 100], [200, 400], [500, 400]])
    truth = FLIGHT.homography_between(0, 1)
    assert np.linalg.norm(apply(pair.homography, corners) - apply(truth, corners), axis=1).mean() < 2.0
    assert pair.summary()["detector"] == pair.method.detector


def test_tracking_and_windows_register_a_small_shift() -> None:
    rng = np.random.default_rng(0)
    scene = cv2.GaussianBlur(rng.integers(0, 256, (400, 500), dtype=np.uint8), (0, 0), 2)
    scene = cv2.normalize(scene, None, 0, 255, cv2.NORM_MINMAX)
    left, right = scene[20:340, 20:420], scene[26:346, 29:429]
    expected = np.array([[1.0, 0, -9], [0, 1, -6], [0, 0, 1]])
    choices: tuple[dict[str, Any], ...] = ({"detector": "klt"}, {"detector": "harris", "descriptor": "window-10"})
    for options in choices:
        pair = register(left, right, **options)
        assert pair.accepted, pair.reason
        assert pair.homography is not None
        np.testing.assert_allclose(pair.homography, expected, atol=0.1)


def test_tracking_takes_images_of_different_size(images: list[Pixels]) -> None:
    left, right = images[0], images[0][:400, :560]
    pair = register(left, right, detector="klt")
    assert pair.homography is not None
    np.testing.assert_allclose(pair.homography, np.eye(3), atol=0.05)


def test_frames_are_matched_with_the_first_or_with_the_one_before(images: list[Pixels]) -> None:
    method, config = choose_method(PRESETS["aerial"], "orb")
    frames = [images[0], images[1], images[1]]
    first = HostBackend(method).run(frames, config)
    previous = HostBackend(method).run(frames, config, reference="previous")
    assert len(first[0].matches) == 0
    np.testing.assert_array_equal(first[1].matches, previous[1].matches)
    np.testing.assert_array_equal(first[2].matches[["left_x", "right_x"]], first[1].matches[["left_x", "right_x"]])
    same = previous[2].matches
    np.testing.assert_array_equal(same["left_x"], same["right_x"])


def test_a_choice_is_completed_by_what_suits() -> None:
    aerial = preset_config("aerial")
    assert choose_method(aerial)[0] == Method("harris", "ilbp-128")
    assert choose_method(aerial, "sift")[0] == Method("sift", "sift")
    assert choose_method(aerial, "surf")[0] == Method("surf", "ilbp-128")
    assert choose_method(aerial, descriptor="freak")[0] == Method("brisk", "freak")
    assert choose_method(aerial, descriptor="akaze")[0] == Method("akaze", "akaze")
    method, config = choose_method(aerial, "fast", "ilbp-256")
    assert method.on_accelerator
    assert (config.front_end.detector, config.front_end.descriptor) == ("fast", "ilbp-256")
    assert config.front_end.border_px >= config.front_end.min_border_px
    assert choose_method(preset_config("aerial"), "sift")[1].matcher.rule_base == "none"
    assert choose_method(preset_config("aerial"), "sift", "ilbp-128")[1].matcher.rule_base == "aerial"


@pytest.mark.parametrize(
    ("detector", "descriptor", "rule_base", "rules", "on_accelerator"),
    [
        ("harris", "ilbp-128", "aerial", 8, True),
        ("fast", "ilbp-128", "none", 1, True),
        ("sift", "ilbp-128", "aerial", 8, False),
        ("sift", "ilbp-128", "none", 2, False),
        ("harris", "sift", "aerial", 2, False),
        ("harris", "window-10", "aerial", 27, False),
        ("harris", "klt", "aerial", 2, False),
        ("fast", "thesis-ilbp-4", "ilbp", 4, True),
    ],
)
def test_matches_are_explained_by_the_rules_of_their_method(
    detector: str, descriptor: str, rule_base: RuleBase, rules: int, on_accelerator: bool
) -> None:
    own = preset_config("thesis" if rule_base == "ilbp" else "aerial")
    given = dataclasses.replace(own, matcher=dataclasses.replace(own.matcher, rule_base=rule_base))
    method, config = choose_method(given, detector, descriptor)
    assert (len(method.rule_names(config)), method.on_accelerator) == (rules, on_accelerator)
    # A threshold is one of its detector.
    assert config.front_end.threshold == {"fast": 10}.get(detector, own.front_end.threshold)
    config = dataclasses.replace(config, matcher=dataclasses.replace(config.matcher, rule_base="none"))
    _, changed = choose_method(config, "harris", "ilbp-256-upright")
    assert changed.front_end.threshold == own.front_end.threshold
    assert changed.front_end.border_px == max(config.front_end.border_px, changed.front_end.min_border_px)


@pytest.mark.parametrize(("options", "words"), [
    ({"detector": "surfing"}, "surf, sift, orb"),
    ({"descriptor": "brief"}, "sift, orb, akaze"),
    ({"estimator": "guess"}, "prosac, fabric, ransac, magsac, fuzzy-ransac"),
    ({"detector": "freak"}, "no detector"),
    ({"detector": "orb", "descriptor": "akaze"}, "scale space"),
    ({"detector": "sift", "backend": "rtl"}, "leave out `backend`"),
    ({"preset": "thesis", "descriptor": "ilbp-128"}, "needs the gray window"),
])  # fmt: skip
def test_what_cannot_be_is_refused_with_the_reason(images: list[Pixels], options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        register(images[0], images[1], **options)
