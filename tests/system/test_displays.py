"""Flights, films and tracks behind what moves with the camera, such as a display, are those of the ground."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from skymosaic import mosaics
from skymosaic.common.errors import RegistrationError
from skymosaic.geometry.homography import apply
from skymosaic.imagery.key_frames import select_key_frames
from skymosaic.mosaicking.live.mosaic import LiveMosaic
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import Tracker
from tests.skymosaic.geometry.covered import SIZE, at_night, ground, seen, with_dirt, with_display


def test_a_sensors_pattern_is_subtracted_from_a_flight_and_a_live_mosaic() -> None:
    place = ground(5)
    photographs = [at_night(seen(place, 100 + 90 * k, 100 + 20 * k, degrees=3 * k), k, 0.2) for k in range(3)]
    (whole,) = mosaics(photographs)
    live = LiveMosaic()
    live.extend(photographs)
    assert len(whole.placed) == 3
    assert len(live.transforms) == 3
    middle = np.array([[SIZE[0] / 2, SIZE[1] / 2]])
    for transforms in (whole.transforms, live.transforms):
        moved = apply(np.linalg.inv(transforms[0]) @ transforms[2], middle) - middle
        assert moved[0] == pytest.approx((180, 40), abs=8)


def test_different_places_behind_one_display_are_no_mosaic_and_a_flight_is() -> None:
    with pytest.raises(
        RegistrationError, match=r"image 0: nothing links it to the others; what moves .*image 1: .*image 2: "
    ):
        list(mosaics([with_display(seen(ground(seed), 300, 200)) for seed in (5, 6, 7)]))
    place = ground(8)
    corners = ((50, 40), (300, 70), (330, 300), (60, 280))
    images = [with_display(seen(place, *corner, degrees=3 * turn)) for turn, corner in enumerate(corners)]
    (whole,) = mosaics(images)
    assert len(whole.placed) == 4
    live = LiveMosaic()
    assert [live.add(with_display(seen(ground(seed), 300, 200))).parts for seed in (5, 6, 7)] == [1, 2, 3]
    assert live.left_out_moving


@pytest.mark.parametrize("cover", [with_display, with_dirt])
def test_a_film_has_the_same_key_frames_behind_it(cover: Callable[..., Any]) -> None:
    place = ground(9)
    film = [np.ascontiguousarray(place[200:680, x : x + SIZE[0]]) for x in range(0, 600, 30)]
    numbers = [frame.number for frame in select_key_frames(film)]
    assert len(numbers) > 3
    assert [frame.number for frame in select_key_frames(map(cover, film))] == numbers


def test_a_track_does_not_stay_with_a_cross_that_the_object_leaves() -> None:
    place, car = ground(10), ground(11)[:60, :90]

    def frame(x_px: int) -> np.ndarray:
        shown = place[: SIZE[1], 2 * x_px : 2 * x_px + SIZE[0]].copy()
        shown[210:270, 275 + x_px : 365 + x_px] = car
        return with_display(shown)

    with Tracker(Roi(275, 210, 90, 60)) as tracker:
        tracked = [tracker.follow(frame(x_px)) for x_px in range(0, 60, 4)]
    assert sum(each.pose is not None for each in tracked) >= 10
    for number, each in enumerate(tracked):
        if each.corners is not None:
            np.testing.assert_allclose(each.corners[0], (274.5 + 4 * number, 209.5), atol=1.5)
