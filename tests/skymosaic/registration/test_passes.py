from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.rendered_pairs import flat_pair
from golden_model.config import Config, preset_config
from golden_model.records import MATCH
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameResult, Reference
from sim.scene import CameraPose
from skymosaic import register
from skymosaic.evaluation.metrics import grid_error
from skymosaic.features.frames import Change, DescribedImage
from skymosaic.features.positions import match_points
from skymosaic.registration.front_end_runs import FrontEndRun
from skymosaic.registration.passes import MIN_PLACES, PooledMatches, Search, SearchState, explain_refusal, is_coarse
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
        # `fast` was asked for, and `thorough` has tried everything.
        assert pair.reason.endswith("; `effort` thorough tries more") is (effort == "normal")


def test_what_lies_outside_the_overlap_makes_no_pass_weak(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right, truth = flat_pair("horizon", 70, 1)
    pair = register(left, right)
    assert (pair.passes, len(pair.inliers) < 60, len(pair.inliers) < 0.5 * len(pair.kept)) == (1, True, True)
    assert grid_error(pair.homography, truth, (640, 480), (640, 480)) < 0.5
    everywhere = np.full(left.shape, 255, np.uint8)
    monkeypatch.setattr("skymosaic.registration.passes.acceptance.overlap_mask", lambda *_: everywhere)
    assert register(left, right).passes == 2


def test_photographs_whose_fine_detail_is_noise_are_reduced(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right, truth = flat_pair("dark", 4, 1)
    backend = Counting()
    pair = register(left, right, backend=backend)
    assert (pair.passes, backend.widths_px) == (2, {640, 453})
    assert grid_error(pair.homography, truth, (640, 480), (640, 480)) < 0.5
    monkeypatch.setattr("skymosaic.registration.passes.COARSE_SHARE", 1.0)
    assert len(register(left, right).inliers) < len(pair.inliers)


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
    pooled = PooledMatches(pair.features, pair.matches)
    inliers = np.asarray(pair.matches["verdict"] == 1)
    right = SearchState(pooled, truth, inliers, 100, passes=1)
    wrong = SearchState(pooled, np.array([[1.0, 0, 80], [0, 1, 50], [0, 0, 1]]) @ truth, inliers, 100, passes=2)
    chosen = search.choose(right, wrong)
    assert chosen.homography is right.homography
    assert chosen.passes == 2
    assert np.count_nonzero(chosen.inliers) == len(pair.inliers)
    assert search.choose(wrong, right) is right
    assert search.choose(replace(right, homography=None), wrong) is wrong


@pytest.mark.parametrize(
    ("features", "kept", "places", "cause"),
    [
        ((900, 11), 11, 0, "too few features (flat or blurred image?)"),
        ((11, 900), 11, 0, "too few features (flat or blurred image?)"),
        ((900, 12), 11, 0, "too few matches (do the images overlap?)"),
        ((900, 800), 12, MIN_PLACES - 1, f"inliers at too few places, {MIN_PLACES} needed (do the images overlap?)"),
        ((900, 800), 12, MIN_PLACES, "the inliers cover too little of the overlap"),
    ],
)
def test_why_a_pair_is_refused_is_said_with_the_counts(
    features: tuple[int, int], kept: int, places: int, cause: str
) -> None:
    matches = np.zeros(40, [("verdict", "u1")])
    matches["verdict"][:kept] = 1
    left, right = (np.zeros(count, "u1") for count in features)
    state = SearchState(PooledMatches((left, right), matches), None, np.arange(40) < 7, places, passes=1)
    counts = f"features {features[0]} and {features[1]}, matches 40, kept {kept}, inliers 7 at {places} places"
    assert explain_refusal(state) == f"{cause}: {counts}"


def state_of(kept: int, inliers: int, places: int, part: float = 1.0, levels: int = 0) -> SearchState:
    """Matches that stand still, spread over a part of the image; so many are of half the size in both."""
    matches = np.zeros(kept, MATCH.dtype)
    points = np.random.default_rng(0).uniform((0, 0), np.array(SIZE) - 1, (kept, 2)) * part
    for side in ("left", "right"):
        matches[f"{side}_x"], matches[f"{side}_y"] = (16 * points).astype(int).T
        matches[f"{side}_index"] = np.arange(kept)
    matches["verdict"] = 1
    features = [np.zeros(kept, [("level", "u1")]) for _ in range(2)]
    features[0]["level"], features[1]["level"] = np.arange(kept) < 3 * levels, np.arange(kept) < levels
    pooled = PooledMatches((features[0], features[1]), matches)
    return SearchState(pooled, np.eye(3), np.arange(kept) < inliers, places, passes=1)


@pytest.mark.parametrize(("levels", "coarse"), [(3, False), (4, True)])
def test_coarse_is_where_a_third_of_the_inliers_are_at_half_the_size(levels: int, coarse: bool) -> None:
    assert is_coarse(state_of(12, 9, 9, levels=levels)) is coarse
    assert not is_coarse(replace(state_of(12, 9, 9, levels=levels), homography=None))


@pytest.mark.parametrize("shared", [False, True])
def test_frames_that_the_front_end_does_not_take_are_no_passes(
    near: tuple[CameraPose, NDArray[np.uint8]], shared: bool
) -> None:
    images = near[1][:100, :200], near[1][:100, 30:230]
    kept = (DescribedImage(images[0]), DescribedImage(images[1])) if shared else None
    rng, config = np.random.default_rng(0), preset_config("aerial")
    search = Search(GoldenBackend(), images, config, rng, lambda matches: matches, shared=kept)
    small, whole, large = Change(0.5), Change(), Change(2.0)
    for swapped in (False, True):
        tried = (FrontEndRun(small, (whole,), swapped), FrontEndRun(whole, (small,), swapped))
        assert not list(search._match_frames(tried))
        passes = list(search._match_frames([FrontEndRun(whole, (small, whole, large), swapped)]))
        assert [change for change, _ in passes] == [whole, large]
        left, right = match_points(passes[0][1].kept)
        assert np.median(left - right, axis=0).tolist() == [30, 0]


@pytest.mark.parametrize(("moving", "moved", "accepted"), [(10, 0.05, True), (9, 0.05, False), (20, 0.04, False)])
def test_what_stands_still_in_quarters_alone_is_no_ground(
    monkeypatch: pytest.MonkeyPatch, moving: int, moved: float, accepted: bool
) -> None:
    found = replace(state_of(20, 20, 20, 0.5), passes=17)
    found.pooled.matches["right_x"][:moving] += np.uint16(16 * moved * SIZE[0])
    monkeypatch.setattr("skymosaic.registration.passes.Search._search_separately", lambda *_: found)
    images = np.zeros(SIZE[::-1], np.uint8), np.zeros(SIZE[::-1], np.uint8)
    before = replace(found, homography=None, passes=1)
    state = Search(None, images, None, None, None)._search_quarters(before)  # type: ignore[arg-type]
    assert state.passes == 17
    assert (state.homography is not None) == accepted
