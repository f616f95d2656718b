"""Benches: what they measure on little, and what they refuse."""

import json
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from bench import camera, confidence, rendered_pairs
from bench.methods import REFERENCE
from bench.painter import DELAY, STEP_PX, find_owners, find_seams, place_frames
from bench.patches import confirmed_share
from bench.registration import Outcome, group_rows, method_row
from golden_model.arrays import Array
from golden_model.geometry.fixed_point import quantise
from golden_model.records import HOMOGRAPHY
from sim.scene import Camera, make_lawnmower
from skymosaic.evaluation.metrics import MISSING_ERROR_PX
from skymosaic.geometry.acceptance import hull_area, overlap
from skymosaic.geometry.ground import Sight, measure_ground
from skymosaic.geometry.horizon import ahead
from skymosaic.registration.confidence import Evidence

FLOWN_PX = (160, 120)
FRAMES = 16


@pytest.mark.slow
def test_a_flight_and_a_host_that_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    # Nine frames come meanwhile, and the rings have eight slots.
    monkeypatch.setattr(camera, "PAUSE_EVERY", 4)
    images = make_lawnmower(2, FRAMES, FLOWN_PX, forward_overlap=0.9).images
    flight = [cv2.cvtColor(images[n], cv2.COLOR_BGR2GRAY) for n in range(FRAMES)]
    figures = camera.fly(flight, FLOWN_PX, seed=2)
    delivered = figures["delivered"]
    assert figures["of these, equal to the golden model in every record"] == delivered < FRAMES
    assert figures["reported as dropped"] == figures["really missing"] == FRAMES - delivered
    assert figures["the chip's homographies, accepted"] > delivered // 2
    assert (figures["the chip's homographies, lost"], figures["AXI rules broken"]) == (0, 0)
    assert json.loads(json.dumps(figures)) == figures, "they are written to a file"


CAMERA = Camera(width_px=160, height_px=120, focal_px=130)


def shift(x: float, y: float) -> Array:
    return np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]])


def test_a_seam_is_as_wide_as_its_frames_are_apart() -> None:
    """Frames that overlap by 16 px; the last is painted 3 px too far to the right and 4 px too low."""
    exact = [shift(1000 + 144 * number, 500) for number in range(4)]
    poses = {number: shift(144 * number, 0) for number in range(3)} | {3: shift(435, 4)}
    seams = find_seams(CAMERA, poses, exact)
    assert {frozenset(pair) for pair in seams} == {frozenset((number, number + 1)) for number in range(3)}
    widths = np.concatenate([*seams.values()]).round(6).tolist()
    assert set(widths) == {0, 5}
    # Neighbours meet over the height of a frame.
    assert widths.count(0) == pytest.approx(2 * 120 / STEP_PX, rel=0.1)
    assert widths.count(5) == pytest.approx(120 / STEP_PX, rel=0.1)


def test_the_frame_with_the_farthest_border_is_shown() -> None:
    owners, low = find_owners(CAMERA, {4: shift(10, 0), 7: shift(90, 0)})
    at = (np.array([[60, 60], [200, 60], [120, 60], [140, 60]]) - low) // STEP_PX
    assert [owners[y, x] for x, y in at.astype(int)] == [4, 7, 4, 7]
    assert set(np.unique(owners)) <= {-1, 4, 7}


def test_an_anchor_counts_from_the_frame_after_the_delay() -> None:
    """Each link of the chip is half a pixel too long."""
    records = []
    for number in range(8):
        record = np.zeros(1, HOMOGRAPHY.dtype)[0]
        record["causes"], record["frame"], record["reference"] = number == 0, number, max(number - 1, 0)
        for (row, column), element in np.ndenumerate(quantise(shift(10.5, 0)[np.newaxis])[0].astype(np.uint32)):
            record[f"h{row}{column}"] = element
        records.append(SimpleNamespace(homography=record))
    anchors = {number: shift(10 * number, 0) for number in (1, 4)}
    placed = place_frames(records, anchors)  # type: ignore[arg-type]
    off = {number: -pose[0, 2] - 10 * number for number, pose in placed.items()}
    first, second = 1 + DELAY + 1, 4 + DELAY + 1
    assert min(placed) == first
    expected = {number: 0.5 * (number - (4 if number >= second else 1)) for number in range(first, 8)}
    assert off == pytest.approx(expected, abs=0.01)


def test_patches_tell_which_of_two_planes_is_the_ground() -> None:
    """The right half of the ground has moved 8 px farther than the left one, and a corner shows something else."""
    grain = np.random.default_rng(3).uniform(0, 255, (240, 560))
    ground = cv2.GaussianBlur(grain, (0, 0), 1.5)
    ground = np.clip(128 + 8 * (ground - 128), 0, 255).astype(np.uint8)
    left, right = ground[:, 40:520], np.hstack([ground[:, 10:250], ground[:, 258:498]])
    right[:120, :200] = right[120:, 280:]
    planes = shift(-30, 0), shift(-22, 0)
    near, far = (confirmed_share(left, right, plane, planes[0]) or 0 for plane in planes)
    assert near + far == pytest.approx(1, abs=0.05)
    assert 0.2 < near < far, "the corner is of the near plane, and tells nothing"
    assert confirmed_share(left, right, shift(-33, 0), planes[0]) == 0, (
        "the truth's plane tells what the answer's does not"
    )
    assert confirmed_share(left, right, None, planes[0]) == 0
    assert confirmed_share(left, right, planes[0], shift(-400, 0)) == near
    assert confirmed_share(left, left[::-1], planes[0], planes[0]) is None


OURS = [
    Outcome("dark_2", (0.5, 2.0), 0.1, ()),
    Outcome("dark_2", (0.5, 21.0), 0.2, ()),
    Outcome("small_55", (4.0, 4.0), 0.3, (0.25, None)),
]
SIFT = [Outcome(name, (px,), 0.4, ()) for name, px in (("dark_2", MISSING_ERROR_PX), ("dark_2", 0.2))]
SIFT.append(Outcome("small_55", (0.2,), 0.2, ()))


def test_a_group_has_shares_what_was_wrong_and_the_time_beside_sift() -> None:
    dark, small = group_rows({"ours": OURS, REFERENCE: SIFT})
    assert dark["ours"] == "50 (0-100) / 75 (50-100) / 75 (50-100), 1.25 px"
    # The refused pair is not wrong, and has no share.
    assert dark[REFERENCE] == "50 / 50 / 50, 500.10 px"
    assert (dark["pairs"], dark["wrong"], dark["time"]) == ("dark 2", 1, "0.38")
    assert (small["ours"], small["wrong"], small["time"]) == ("0 / 0 / 100, 4.00 px", 0, "1.50")


def test_a_method_without_a_reference_has_its_time_in_ms() -> None:
    row = method_row({"ours": OURS}, "ours")
    shares = "50 (0-100) / 75 (50-100) / 75 (50-100)"
    assert (row["dark_2"], row["wrong"], row["refused"], row["time"]) == (shares, 1, 0.0, "200 ms")
    assert row["patches"] == "25.0 %"


@pytest.mark.parametrize(
    ("kind", "step", "share"),
    [("horizon", 80, (0.03, 0.5)), ("overlap", 10, (0.05, 0.15)), ("small", 35, (0.2, 0.5)), ("dark", 2, (0.45, 0.65))],
)
def test_hard_pairs_show_what_their_name_says(kind: str, step: float, share: tuple[float, float]) -> None:
    left, right, truth = rendered_pairs.flat_pair(kind, step, 2)
    size = rendered_pairs.SMALL_PX if kind == "small" else rendered_pairs.SIZE_PX
    assert left.shape == right.shape == size[::-1]
    # The truth lays the photographs on each other.
    assert measure_ground(Sight(left), Sight(right), truth).share > 0.3
    assert share[0] < hull_area(overlap(truth, size, size)) / (size[0] * size[1]) < share[1]
    corners = np.array([[0.0, 0], [size[0], 0], [size[0], size[1]], [0, size[1]]])
    assert bool(ahead(truth, corners).min() < 0) is (kind == "horizon")
    assert bool(max(left.mean(), right.mean()) < 30) is (kind == "dark")


def test_the_fitted_table_is_monotone_and_states_what_nine_of_ten_stay_below() -> None:
    rng = np.random.default_rng(4)
    shares = rng.uniform(0, 1, (900, 2))
    errors_px = np.exp(rng.normal(4 - 5 * shares[:, 0], 0.5))
    best = Evidence(1, 1, 1, 999, 0.1, 1, 0, 0)
    steps = confidence.expand(
        [replace(best, ground_share=ground, hull_share=hull) for ground, hull in shares.tolist()]
    )  # fmt: skip
    fit = confidence.fit_steps(steps, errors_px)
    assert fit.odds[:-1].max() <= 0
    assert fit.error[:-1].max() <= 0
    doubt, predicted_px = confidence.predict_held_out(steps, errors_px)
    assert 0.84 < np.mean((errors_px <= predicted_px)[errors_px < 30]) < 0.94
    assert doubt[errors_px > 30].mean() > 0.75
    assert doubt[errors_px < 3].mean() < 0.05
