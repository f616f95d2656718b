"""The refit to dense flow: it finds the plane of the overlap, and counts only where more of that fits."""

import dataclasses
import functools
import time

import cv2
import numpy as np
import pytest

from golden_model.arrays import Mask, Matrix, Pixels, Points
from sim.scene import make_pair
from skymosaic import register
from skymosaic.evaluation.metrics import grid_error
from skymosaic.geometry.homography import transfer_error
from skymosaic.registration.dense import match_densely, refit_pair
from skymosaic.registration.pair import Pair

FLIGHT = make_pair(seed=4, size=(480, 360))
TRUTH = FLIGHT.homography_between(0, 1)
OFF = np.array([[1.0, 0, 1.2], [0, 1, -0.9], [0, 0, 1]])


@functools.cache
def photographs() -> tuple[Pixels, Pixels]:
    left, right = FLIGHT.images
    return left, right


def everywhere(left: Points, right: Points) -> Mask:
    return np.ones(len(left), dtype=bool)


@pytest.fixture(scope="module")
def pair() -> Pair:
    return register(*photographs(), effort="fast")


def error_px(homography: Matrix | None) -> float:
    assert homography is not None
    return grid_error(homography, TRUTH, (480, 360), (480, 360))


def test_flow_ends_at_the_horizon_and_soon() -> None:
    left = cv2.cvtColor(photographs()[0], cv2.COLOR_BGR2GRAY)
    # It maps left row 100 to infinity.
    tilted = np.array([[-1.0, 2.4, 0], [0, 2, -100], [0, 0.01, -1]])
    right = np.asarray(cv2.warpPerspective(left, tilted, (480, 360), borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)
    start_s = time.process_time()
    points, moved = match_densely(left, right, tilted)
    assert time.process_time() - start_s < 10
    assert len(points) > 100
    assert points[:, 1].min() > 160
    assert np.median(transfer_error(tilted, points, moved)) < 0.5


def test_no_grid_in_an_overlap_that_is_too_narrow() -> None:
    image = np.zeros((240, 320), np.uint8)
    shift = np.array([[1.0, 0, 290], [0, 1, 0], [0, 0, 1]])
    assert [len(points) for points in match_densely(image, image, shift)] == [0, 0]


def test_a_homography_that_is_off_is_refitted(pair: Pair) -> None:
    off = pair.with_homography(OFF @ TRUTH, refined_inliers=0)
    # All matches together determine the homography as well as the flow does; so few do not.
    few = dataclasses.replace(off, kept=off.kept[::12])
    refitted = refit_pair(few, everywhere)
    assert refitted.refined_inliers > 200
    assert error_px(refitted.homography) < 0.3 < error_px(off.homography)
    assert len(refitted.inliers) > 0.8 * len(few.kept)


def test_the_plane_of_most_of_the_overlap_is_found_from_that_of_the_corners(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    # How much of the overlap fits is enough to decide.
    monkeypatch.setattr("skymosaic.registration.dense.held_out_agreement", lambda *_: 1.0)
    left = pair.working[0]
    right = left.copy()
    # The middle, which has all the corners, stands higher and is displaced: a third of the ground.
    middle = slice(60, 300), slice(120, 360)
    right[middle] = np.roll(left, 10, axis=1)[middle]
    of_corners = np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]])
    planes = dataclasses.replace(pair, working=(left, right)).with_homography(of_corners, refined_inliers=0)
    refitted = refit_pair(planes, everywhere)
    assert refitted.homography is not None
    assert grid_error(refitted.homography, np.eye(3), (480, 360), (480, 360)) < 0.3


def test_a_homography_that_the_flow_confirms_stays(pair: Pair) -> None:
    true = pair.with_homography(TRUTH, refined_inliers=0)
    found = refit_pair(true, everywhere)
    assert (found.homography is true.homography, found.refined_inliers) == (True, 0)


def test_what_does_not_show_the_ground_has_no_vote(pair: Pair) -> None:
    off = pair.with_homography(OFF @ TRUTH, refined_inliers=0)
    assert refit_pair(off, lambda left, _: left[:, 0] < 0) == off


def test_a_refused_pair_stays_refused(pair: Pair) -> None:
    refused = pair.refused("no overlap")
    assert refit_pair(refused, everywhere) == refused
    assert (refused.accepted, refused.reason) == (False, "no overlap")
