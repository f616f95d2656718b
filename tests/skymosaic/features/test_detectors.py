import dataclasses
import itertools

import cv2
import numpy as np
import pytest

from golden_model.config import PRESETS, preset_config
from golden_model.feature import ilbp
from golden_model.front_end import extract
from golden_model.pixel.smooth import binomial5
from golden_model.records import MATCH, feature_record
from sim.scene import make_pair
from skymosaic.errors import InputError
from skymosaic.evaluation.metrics import correct_matches
from skymosaic.features.descriptors import DESCRIPTORS, WINDOWS_PX, describe
from skymosaic.features.detectors import (
    DETECTORS,
    FRONT_END_DETECTORS,
    detect,
    keep_one_per_position,
    key_point_positions,
    to_key_points,
)
from skymosaic.features.methods import HostBackend, Method, choose_method, load_backend_for
from skymosaic.features.positions import match_points
from skymosaic.geometry.homography import apply
from skymosaic.registration.register import register

FLIGHT = make_pair(seed=1)
SOME_DESCRIPTORS = ("ilbp-128", "thesis-ilbp-4", "window-10", "sift", "orb", "brisk", "freak", "klt")


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return list(FLIGHT.images)


@pytest.fixture(scope="module")
def gray(images: list[np.ndarray]) -> np.ndarray:
    return cv2.cvtColor(images[0], cv2.COLOR_BGR2GRAY)


@pytest.mark.parametrize(("name", "opencv"), [
    ("sift", lambda: cv2.SIFT.create(1000, contrastThreshold=0.02)),
    ("orb", lambda: cv2.ORB.create(1000, fastThreshold=10)),
    ("akaze", lambda: cv2.xfeatures2d.AKAZE.create(threshold=1e-4)),
    ("brisk", lambda: cv2.xfeatures2d.BRISK.create(thresh=15)),
])  # fmt: skip
def test_features_are_those_of_opencv(gray: np.ndarray, name: str, opencv) -> None:
    points, values = opencv().compute(gray, detect(gray, name, 1000)[:1000])
    records = describe(gray, detect(gray, name, 1000)[:1000], name)
    np.testing.assert_array_equal(records["descriptor"], values.astype(np.uint8))
    np.testing.assert_allclose(records["x"] / 16, key_point_positions(points)[:, 0], atol=1 / 32)
    np.testing.assert_allclose(records["y"] / 16, key_point_positions(points)[:, 1], atol=1 / 32)


def test_ilbp_of_harris_corners_is_the_front_ends_own(gray: np.ndarray) -> None:
    config = dataclasses.replace(PRESETS["thesis"].front_end, threshold=30_000)
    features = extract(gray, config).features
    again = describe(gray, to_key_points(features), config.descriptor)
    whole = (features["x"] % 16 != 8) & (features["y"] % 16 != 8)  # half a pixel off, the nearest is either
    assert whole.sum() > 300
    for field in ("x", "y", "sector", "descriptor", "window"):
        np.testing.assert_array_equal(again[field][whole], features[field][whole])


@pytest.mark.parametrize("descriptor", [name for name in DESCRIPTORS if name not in ("akaze", "klt")])
def test_what_a_descriptor_drops_at_the_border_stays_in_step(gray: np.ndarray, descriptor: str) -> None:
    height, width = gray.shape
    pixels = list(itertools.product(range(0, width, 40), range(0, height, 40)))
    points = [cv2.KeyPoint(x, y, 7, 0, 1 + index) for index, (x, y) in enumerate(pixels)]
    records = describe(gray, points, descriptor)
    if descriptor != "sift":
        assert 0 < len(records) < len(points)
    assert set(zip(records["x"] // 16, records["y"] // 16, strict=True)) <= set(pixels)
    # Each survivor alone has the descriptor that it had among the others.
    for index in (0, len(records) // 2, len(records) - 1):
        pixel = int(records["x"][index]) // 16, int(records["y"][index]) // 16
        alone = describe(gray, [points[pixels.index(pixel)]], descriptor)
        np.testing.assert_array_equal(alone["descriptor"][0], records["descriptor"][index])


@pytest.mark.parametrize("descriptor", DESCRIPTORS)
def test_no_key_points_give_no_records_of_the_same_kind(gray: np.ndarray, descriptor: str) -> None:
    empty = describe(gray, [], descriptor)
    assert len(empty) == 0
    detector = "akaze" if descriptor == "akaze" else "orb"
    points = detect(gray, detector, 20)
    assert empty.dtype == describe(gray, points, descriptor).dtype


def test_ilbp_at_sift_key_points_reads_the_nearest_pixel(gray: np.ndarray) -> None:
    pattern = ilbp.PATTERNS["ilbp-128"]
    points = [cv2.KeyPoint(100.4, 120.6, 7)]
    record = describe(gray, points, "ilbp-128")
    expected = ilbp.describe(gray, binomial5(gray), np.array([100]), np.array([121]), pattern)
    np.testing.assert_array_equal(record["sector"], expected[0])
    np.testing.assert_array_equal(record["descriptor"], expected[1])


def test_orientations_of_one_place_count_once(gray: np.ndarray) -> None:
    points = detect(gray, "sift", 500)
    single = keep_one_per_position(points)
    assert len(single) == len({point.pt for point in points}) < len(points)
    assert [point.response for point in single] == sorted((point.response for point in single), reverse=True)


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("descriptor", SOME_DESCRIPTORS)
def test_every_combination_speaks_the_front_ends_language(images, detector: str, descriptor: str) -> None:
    config = PRESETS["aerial"]
    # Small crops: the language is tested here, not the quality.
    frames = [image[100:260, 100:300] for image in images]
    method, config = choose_method(config, detector, descriptor)
    left, right = load_backend_for(method, "golden").run(frames, config)
    assert right.matches.dtype == MATCH.dtype
    window_bytes = left.features.dtype["window"].shape[0] if "window" in left.features.dtype.names else 0
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
    {"detector": "sift"}, {"detector": "orb"}, {"detector": "akaze"}, {"detector": "brisk"}, {"detector": "surf"},
    {"detector": "fast"}, {"descriptor": "freak"}, {"detector": "sift", "descriptor": "ilbp-128"},
    {"detector": "harris", "descriptor": "freak"}, {"detector": "sift", "estimator": "magsac"},
    {"detector": "sift", "estimator": "ransac"}, {"detector": "sift", "estimator": "fuzzy-ransac"},
    {"detector": "sift", "descriptor": "ilbp-128", "estimator": "fuzzy-ransac"},
])  # fmt: skip
def test_a_rendered_pair_is_registered(images, options: dict[str, str]) -> None:
    pair = register(*images, **options)
    assert pair.accepted, pair.reason
    corners = np.array([[200, 100], [500, 100], [200, 400], [500, 400]])
    truth = FLIGHT.homography_between(0, 1)
    assert np.linalg.norm(apply(pair.homography, corners) - apply(truth, corners), axis=1).mean() < 2.0
    assert pair.summary()["detector"] == pair.method.detector


def test_tracking_and_windows_register_a_small_shift() -> None:
    rng = np.random.default_rng(0)
    scene = cv2.GaussianBlur(rng.integers(0, 256, (400, 500), dtype=np.uint8), (0, 0), 2)
    scene = cv2.normalize(scene, None, 0, 255, cv2.NORM_MINMAX)
    left, right = scene[20:340, 20:420], scene[26:346, 29:429]
    expected = np.array([[1.0, 0, -9], [0, 1, -6], [0, 0, 1]])
    for options in ({"detector": "klt"}, {"detector": "harris", "descriptor": "window-10"}):
        pair = register(left, right, **options)
        assert pair.accepted, pair.reason
        np.testing.assert_allclose(pair.homography, expected, atol=0.1)


def test_tracking_takes_images_of_different_size(images) -> None:
    left, right = images[0], images[0][:400, :560]
    pair = register(left, right, detector="klt")
    np.testing.assert_allclose(pair.homography, np.eye(3), atol=0.05)


def test_frames_are_matched_with_the_first_or_with_the_one_before(images) -> None:
    method, config = choose_method(PRESETS["aerial"], "orb")
    frames = [images[0], images[1], images[1]]
    held = HostBackend(method).run(frames, config)
    previous = HostBackend(method).run(frames, config, reference="previous")
    assert len(held[0].matches) == 0
    np.testing.assert_array_equal(held[1].matches, previous[1].matches)
    np.testing.assert_array_equal(held[2].matches[["left_x", "right_x"]], held[1].matches[["left_x", "right_x"]])
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


def test_without_rules_the_configuration_says_so() -> None:
    assert choose_method(preset_config("aerial"), "sift")[1].matcher.rule_base == "none"
    assert choose_method(preset_config("aerial"), "sift", "ilbp-128")[1].matcher.rule_base == "aerial"


@pytest.mark.parametrize(("options", "words"), [
    ({"detector": "surfing"}, "surf, sift, orb"),
    ({"descriptor": "brief"}, "sift, orb, akaze"),
    ({"estimator": "guess"}, "prosac, scored, ransac, magsac, fuzzy-ransac"),
    ({"detector": "freak"}, "not a detector"),
    ({"detector": "orb", "descriptor": "akaze"}, "scale space"),
    ({"detector": "sift", "backend": "rtl"}, "leave out --backend"),
    ({"preset": "thesis", "descriptor": "ilbp-128"}, "needs the gray window"),
    ({"detector": "orb", "refine": True}, "leave one out"),
])  # fmt: skip
def test_what_cannot_be_is_refused_with_the_reason(images, options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        register(*images, **options)


def test_good_matches_of_the_baselines(images) -> None:
    truth = FLIGHT.homography_between(0, 1)
    for detector in set(DETECTORS) - set(FRONT_END_DETECTORS) - {"klt", "surf"}:
        method, config = choose_method(preset_config("aerial"), detector)
        matches = HostBackend(method).run(images, config)[1].matches
        kept = matches[matches["verdict"] == 1]
        assert len(kept) > 200
        assert correct_matches(*match_points(kept), truth).mean() > 0.9


def test_window_names_carry_the_sides_of_table_iv_2() -> None:
    assert list(WINDOWS_PX.values()) == [3, 10, 22, 25, 30]
