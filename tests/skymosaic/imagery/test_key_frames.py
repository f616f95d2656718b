from itertools import pairwise

import numpy as np

from sim.scene import Camera, CameraPose, Flight, Photometry
from skymosaic.imagery.key_frames import select_key_frames


def _flight(poses: list[CameraPose]) -> Flight:
    camera = Camera(width_px=320, height_px=240, focal_px=260)
    return Flight(3, camera, tuple(poses), (Photometry(noise_sigma=2),) * len(poses))


def test_key_frames_overlap_enough_and_not_too_much() -> None:
    flight = _flight(
        [
            CameraPose(
                x_px=6.0 * t,
                y_px=20 * np.sin(t / 9),
                altitude_px=260 * (1 + 0.1 * np.sin(t / 20)),
                heading_deg=8 * np.sin(t / 15),
            )
            for t in range(60)
        ]
    )
    numbers = [frame.number for frame in select_key_frames(flight.images)]
    assert numbers[0] == 0
    assert numbers[-1] == 59
    overlaps = [flight.overlap_between(*pair) for pair in pairwise(numbers)]
    assert len(overlaps) >= 3
    assert all(0.6 < overlap < 0.8 for overlap in overlaps[:-1])
    assert overlaps[-1] > 0.6


def test_a_hovering_camera_gives_its_first_and_its_last_frame() -> None:
    flight = _flight([CameraPose(x_px=x, y_px=0, altitude_px=260) for x in np.linspace(0, 2, 12)])
    assert [frame.number for frame in select_key_frames(flight.images)] == [0, 11]


def test_every_frame_is_a_key_frame_where_the_flow_is_lost() -> None:
    flight = _flight([CameraPose(x_px=x, y_px=0, altitude_px=260) for x in (0, 200, 400)])
    assert [frame.number for frame in select_key_frames(flight.images)] == [0, 1, 2]
    flat = [np.full((240, 320, 3), 90, np.uint8)] * 3
    assert [frame.number for frame in select_key_frames(flat)] == [0, 1, 2]
    assert list(select_key_frames([])) == []
