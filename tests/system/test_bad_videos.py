"""Objects that are not there, or not alone: lost, and said, never found elsewhere."""

from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from sim.scene import render_ground
from skymosaic.common.errors import InputError
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import TrackedFrame, Tracker

WIDTH, HEIGHT = 320, 240
ROI = Roi(60, 80, 80, 60)


@pytest.fixture(scope="module")
def ground() -> Pixels:
    return render_ground(11, 900, 500)


def fly(ground: Pixels, step_px: int, frames: int) -> list[Pixels]:
    """Views of the ground from a camera that moves to the right."""
    noise = np.random.default_rng(1)
    views = [ground[:HEIGHT, x : x + WIDTH].astype(float) for x in step_px * np.arange(frames)]
    return [np.clip(view + noise.normal(0, 2, view.shape), 0, 255).astype(np.uint8) for view in views]


def follow(template: Roi | Pixels, frames: list[Pixels]) -> list[TrackedFrame]:
    with Tracker(template) as tracker:
        return [tracker.follow(frame) for frame in frames]


def places(tracked: list[TrackedFrame]) -> list[Any]:
    """Where the left edge is in each frame."""
    return [None if each.corners is None else float(each.corners[0, 0]) for each in tracked]


def test_an_object_that_is_not_there_is_lost_and_said_to_be(ground: Pixels) -> None:
    tracked = follow(render_ground(5, 100, 80), fly(ground, 10, 3))
    assert places(tracked) == [None] * 3
    assert all("not found yet" in each.reason for each in tracked)
    tracked = follow(ROI, fly(ground, 25, 9))
    found = [place is not None for place in places(tracked)]
    assert found[:3] == [True] * 3
    # All of it is out of the frame.
    assert found[6:] == [False] * 3
    assert "left the frame" in tracked[-1].reason


def test_a_twin_is_not_taken_for_an_object_that_is_hidden(ground: Pixels) -> None:
    both = ground.copy()
    cut = render_ground(5, ROI.width_px, ROI.height_px)
    for x in (ROI.x_px, ROI.x_px + 110):
        both[ROI.y_px : ROI.y_px + ROI.height_px, x : x + ROI.width_px] = cut
    frames = fly(both, 2, 8)
    for number, frame in enumerate(frames[3:], 3):
        cv2.rectangle(frame, (50 - 2 * number, 70), (150 - 2 * number, 150), (90, 90, 90), cv2.FILLED)
    tracked = follow(ROI, frames)
    assert [place is not None for place in places(tracked)] == [True] * 3 + [False] * 5
    assert any("another object looks like it" in each.reason for each in tracked[3:])


def test_a_small_picture_is_a_template_and_a_tiny_one_is_refused(ground: Pixels) -> None:
    frames = fly(ground, 5, 3)
    small = ground[ROI.y_px : ROI.y_px + 40, ROI.x_px : ROI.x_px + 50]
    np.testing.assert_allclose(places(follow(small, frames)), ROI.x_px - 0.5 - 5 * np.arange(3), atol=1)
    with pytest.raises(InputError, match="template: 40x12 pixels is too small; at least 16x16 needed"):
        Tracker(small[:12, :40])


def test_a_caption_over_the_rectangle_is_not_followed(ground: Pixels) -> None:
    frames = fly(ground, 4, 7)
    cut, caption = render_ground(5, 60, 60), render_ground(8, 70, 60)
    for number, frame in enumerate(frames):
        frame[90:150, 110 + 8 * number : 170 + 8 * number] = cut
        frame[90:150, 40:110] = caption
    tracked = follow(Roi(40, 90, 130, 60), frames)
    np.testing.assert_allclose(places(tracked), 39.5 + 8 * np.arange(7), atol=2)


def test_an_object_that_jumps_and_changes_its_look_is_followed_by_its_last_view(ground: Pixels) -> None:
    x_px = np.array([80, 92, 83, 100, 88, 105, 90, 110, 95])
    first, last = render_ground(5, 80, 60), render_ground(8, 80, 60)
    frames = fly(ground, 4, len(x_px))
    for number, (frame, x) in enumerate(zip(frames, x_px, strict=True)):
        frame[90:150, x : x + 80] = cv2.addWeighted(first, 1 - number / 8, last, number / 8, 0)
    tracked = follow(Roi(80, 90, 80, 60), frames)
    # Frames that were predicted badly are smoothed by 15 %.
    np.testing.assert_allclose(places(tracked), x_px - 0.5, atol=6)
    assert tracked[-1].pose is not None
    np.testing.assert_allclose(tracked[-1].pose.homography[:2, 2], (95, 90), atol=2)
