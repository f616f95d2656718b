from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.rendered_pairs import flat_pair
from golden_model.config import Config
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameResult, Reference, load_backend
from sim.scene import CameraPose
from skymosaic import register
from skymosaic.common.errors import InputError
from skymosaic.evaluation.metrics import grid_error
from skymosaic.geometry.prosac import MIN_INLIERS
from skymosaic.registration.front_end_runs import LARGER_OF_SMALL, TILTED
from skymosaic.registration.passes import MAX_PROMISING, MIN_PLACES, Evidence, Search, SearchState, explain_refusal
from tests.skymosaic.registration.rendering import CAMERA, view

SIZE = (CAMERA.width_px, CAMERA.height_px)


@pytest.fixture(scope="module")
def near() -> tuple[CameraPose, NDArray[np.uint8]]:
    pose = CameraPose(x_px=60, y_px=40, altitude_px=384)
    return pose, view(pose, 0)


@pytest.fixture(scope="module")
def far() -> tuple[CameraPose, NDArray[np.uint8]]:
    """Three times as high, turned by 40 degrees: the first pass alone cannot match it."""
    pose = CameraPose(x_px=70, y_px=30, altitude_px=3 * 384, heading_deg=40)
    return pose, view(pose, 1)


class Counting(GoldenBackend):
    """Counts the frames that the front end sees, and keeps their widths."""

    frames = 0

    def __init__(self) -> None:
        super().__init__()
        self.widths_px: set[int] = set()

    def run(
        self, frames: Sequence[NDArray[np.uint8]], config: Config, *, reference: Reference = "held"
    ) -> list[FrameResult]:
        self.frames += len(frames)
        self.widths_px |= {frame.shape[1] for frame in frames}
        return super().run(frames, config, reference=reference)


@pytest.mark.parametrize("swapped", [False, True])
def test_a_zoom_of_three_needs_the_ladder(
    near: tuple[CameraPose, NDArray[np.uint8]], far: tuple[CameraPose, NDArray[np.uint8]], swapped: bool
) -> None:
    one, other = (far, near) if swapped else (near, far)
    truth = other[0].homography(CAMERA) @ np.linalg.inv(one[0].homography(CAMERA))
    assert not register(one[1], other[1], effort="fast").accepted
    pair = register(one[1], other[1])
    assert pair.effort == "normal"
    assert pair.accepted, pair.reason
    assert pair.passes > 2
    assert grid_error(pair.homography, truth, SIZE, SIZE) < 2
    for side in ("left", "right"):
        features, index = pair.features[side == "right"], pair.inliers[f"{side}_index"]
        np.testing.assert_array_equal(features["x"][index], pair.inliers[f"{side}_x"])


def test_a_strong_first_pass_is_enough(near: tuple[CameraPose, NDArray[np.uint8]]) -> None:
    backend = Counting()
    pair = register(near[1], near[1], backend=backend)
    assert (pair.passes, backend.frames) == (1, 2)
    assert register(near[1], near[1], effort="thorough").passes == 3


def test_unrelated_images_are_refused_at_every_effort(near: tuple[CameraPose, NDArray[np.uint8]]) -> None:
    other = view(CameraPose(x_px=4000, y_px=5000, altitude_px=384), 2)
    for effort in ("fast", "normal", "thorough"):
        backend = Counting()
        pair = register(near[1], other, effort=effort, backend=backend)
        assert not pair.accepted
        # Half an octave smaller and larger.
        assert ({339, 679} <= backend.widths_px) is (effort != "fast")
        assert pair.confidence is None
        assert "too few" in pair.reason
        # One number everywhere, though several inliers at one place count once.
        assert f"kept {len(pair.kept)}, inliers {len(pair.inliers)} at " in pair.reason


def test_the_seed_hardly_matters(
    near: tuple[CameraPose, NDArray[np.uint8]], far: tuple[CameraPose, NDArray[np.uint8]]
) -> None:
    shapes = [register(near[1], far[1], seed=seed).homography for seed in range(3)]
    corners = np.array([[0.0, 0, 1], [479, 0, 1], [479, 359, 1], [0, 359, 1]])
    mapped = [(corners @ H.T)[:, :2] / (corners @ H.T)[:, 2:] for H in shapes]
    assert np.ptp(mapped, axis=0).max() < 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effort": "heroic"}, "fast, normal, thorough"),
        ({"effort": "thorough", "preset": "thesis"}, "oriented ILBP"),
        ({"effort": "normal", "estimator": "magsac"}, "magsac"),
        ({"effort": "normal", "backend": "board", "address": "somewhere"}, "a board takes one"),
        ({"effort": "normal", "backend": load_backend("board:somewhere")}, "a board takes one"),
        ({"detector": "sift", "backend": load_backend("golden")}, "runs on the host"),
    ],
)
def test_an_effort_that_cannot_apply_is_refused(
    near: tuple[CameraPose, NDArray[np.uint8]], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        register(near[1], near[1], **options)


def test_other_methods_take_one_pass_by_default(near: tuple[CameraPose, NDArray[np.uint8]]) -> None:
    assert register(near[1], near[1], detector="orb").effort == "fast"


def test_a_tilt_of_65_degrees_is_found_from_either_side(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right, truth = flat_pair("tilt", 65, 11)
    for one, other, matrix in ((left, right, truth), (right, left, np.asarray(np.linalg.inv(truth), dtype=np.float64))):
        pair = register(one, other)
        assert pair.accepted, pair.reason
        assert grid_error(pair.homography, matrix, (640, 480), (640, 480)) < 1
        assert len(pair.inliers) > 100
        # The usual pass, six for zooms, one at twice the size, small ones with either photograph tilted, and the
        # promising ones at full size.
        assert pair.passes == 1 + 6 + 1 + 2 * len(TILTED) + MAX_PROMISING
    monkeypatch.setattr("skymosaic.registration.passes.PROMISING_PLACES", 1000)
    assert not register(left, right).accepted


@pytest.mark.parametrize(("number", "passes", "otherwise"), [(0, 2, (True, 10)), (10, 3, (False, 37))])
def test_small_photographs_are_enlarged_with_a_margin(
    number: int, passes: int, otherwise: tuple[bool, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    left, right, truth = flat_pair("small", 25, number)
    pair = register(left, right)
    assert (pair.accepted, pair.passes) == (True, passes)
    assert grid_error(pair.homography, truth, (240, 180), (240, 180)) < 1
    monkeypatch.setattr("skymosaic.registration.passes.SMALL_PX", 200)
    pair = register(left, right)
    assert (pair.accepted, pair.passes) == otherwise


def test_what_lies_outside_the_overlap_makes_no_pass_weak(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right, truth = flat_pair("horizon", 70, 1)
    pair = register(left, right)
    assert (pair.passes, len(pair.inliers) < 60, len(pair.inliers) < 0.5 * len(pair.kept)) == (1, True, True)
    assert grid_error(pair.homography, truth, (640, 480), (640, 480)) < 0.5
    everywhere = np.full(left.shape, 255, np.uint8)
    monkeypatch.setattr("skymosaic.registration.passes.acceptance.overlap_mask", lambda *_: everywhere)
    assert register(left, right).passes == 2


def test_an_overlap_of_a_few_percent_is_found_at_twice_the_size() -> None:
    left, right, truth = flat_pair("horizon", 80, 43)
    pair = register(left, right)
    # The usual pass, one larger and one smaller, six for zooms, and this one.
    assert pair.passes == 1 + 2 + 6 + 1
    assert grid_error(pair.homography, truth, (640, 480), (640, 480)) < 0.5


def test_photographs_whose_fine_detail_is_noise_are_reduced(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right, truth = flat_pair("dark", 4, 1)
    backend = Counting()
    pair = register(left, right, backend=backend)
    assert (pair.passes, backend.widths_px) == (2, {640, 453})
    assert grid_error(pair.homography, truth, (640, 480), (640, 480)) < 0.5
    monkeypatch.setattr("skymosaic.registration.passes.COARSE_SHARE", 1.0)
    assert len(register(left, right).inliers) < len(pair.inliers)


def test_a_small_frame_that_misses_the_turn_learns_it_from_the_others() -> None:
    left, _, _ = flat_pair("small", 25, 0)
    pair = register(left, left, effort="fast")
    matches = pair.matches.copy()
    matches["peak_turn"], matches["verdict"] = 8, 0
    search = Search(GoldenBackend(), pair.working, pair.config, np.random.default_rng(0), lambda matches: matches)
    missed = search.accept(Evidence(pair.features, matches), None, matches["verdict"] == 1, passes=1)
    found = search._search_together(missed, LARGER_OF_SMALL).evidence.matches[: len(matches)]
    np.testing.assert_array_equal(found, pair.matches)


def test_a_negative_is_registered_and_said_to_be_one(near: tuple[CameraPose, NDArray[np.uint8]]) -> None:
    pose = CameraPose(x_px=90, y_px=60, altitude_px=400, heading_deg=10)
    truth = pose.homography(CAMERA) @ np.linalg.inv(near[0].homography(CAMERA))
    right = view(pose, 1)
    pair = register(near[1], 255 - right)
    assert pair.accepted, pair.reason
    assert grid_error(pair.homography, truth, SIZE, SIZE) < 0.5
    assert pair.inverted
    assert pair.summary()["inverted"]
    assert any("negative" in note for note in pair.right.notes)
    np.testing.assert_array_equal(pair.working[1], right)
    assert not register(near[1], right).inverted


def test_further_passes_do_not_replace_what_predicts_held_out_matches_better(
    near: tuple[CameraPose, NDArray[np.uint8]], monkeypatch: pytest.MonkeyPatch
) -> None:
    pose = CameraPose(x_px=90, y_px=60, altitude_px=400, heading_deg=10)
    truth = pose.homography(CAMERA) @ np.linalg.inv(near[0].homography(CAMERA))
    pair = register(near[1], view(pose, 1))
    agreement = "skymosaic.registration.passes.held_out_agreement"
    monkeypatch.setattr(agreement, lambda homography, *_: 10.0 if homography is truth else 5.0)
    search = Search(GoldenBackend(), pair.working, pair.config, np.random.default_rng(0), lambda matches: matches)
    evidence = Evidence(pair.features, pair.matches)
    inliers = np.asarray(pair.matches["verdict"] == 1)
    right = SearchState(evidence, truth, inliers, 100, passes=1)
    wrong = SearchState(evidence, np.array([[1.0, 0, 80], [0, 1, 50], [0, 0, 1]]) @ truth, inliers, 100, passes=2)
    chosen = search.choose(right, wrong)
    assert chosen.homography is right.homography
    assert chosen.passes == 2
    assert np.count_nonzero(chosen.inliers) == len(pair.inliers)
    assert search.choose(wrong, right) is right
    assert search.choose(replace(right, homography=None), wrong) is wrong


def test_the_zoom_is_that_in_the_middle_of_the_left_photograph(
    near: tuple[CameraPose, NDArray[np.uint8]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The right one is smaller."""
    images, sizes = (near[1], near[1][:200, :300]), list[tuple[int, int]]()
    pair = register(near[1], near[1], effort="fast")
    weak = SearchState(Evidence(pair.features, pair.matches), np.eye(3), pair.matches["verdict"] == 1, 19, passes=1)
    passes = "skymosaic.registration.passes"
    monkeypatch.setattr(f"{passes}.Search._search_together", lambda _, state, __: state)
    monkeypatch.setattr(f"{passes}.choose_run_between_octaves", lambda _, size: sizes.append(size))
    search = Search(GoldenBackend(), images, pair.config, np.random.default_rng(0), lambda matches: matches)
    assert search.run("normal", weak) is weak
    assert sizes == [SIZE]


@pytest.mark.parametrize(
    ("features", "kept", "places", "cause"),
    [
        ((900, 11), 11, 0, "too few features (flat or blurred image?)"),
        ((11, 900), 11, 0, "too few features (flat or blurred image?)"),
        ((900, 12), 11, 0, "too few matches (do the images overlap?)"),
        ((900, 800), 12, MIN_PLACES - 1, f"too few inliers, {MIN_PLACES} needed (do the images overlap?)"),
        ((900, 800), 12, MIN_PLACES, "the inliers cover too little of the overlap"),
    ],
)
def test_why_a_pair_is_refused_is_said_with_the_counts(
    features: tuple[int, int], kept: int, places: int, cause: str
) -> None:
    assert MIN_INLIERS == 12
    matches = np.zeros(40, [("verdict", "u1")])
    matches["verdict"][:kept] = 1
    left, right = (np.zeros(count, "u1") for count in features)
    state = SearchState(Evidence((left, right), matches), None, np.arange(40) < 7, places, passes=1)
    counts = f"features {features[0]} and {features[1]}, matches 40, kept {kept}, inliers 7 at {places} places"
    assert explain_refusal(state) == f"{cause}: {counts}"
