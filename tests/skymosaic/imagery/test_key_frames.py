from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.scene import Camera, CameraPose, Flight, Photometry
from skymosaic.common.errors import InputError
from skymosaic.imagery.key_frames import MIN_CORNERS, _motion, flight_sources, select_key_frames
from skymosaic.imagery.video import DEFAULT_RATE, write_video


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
    assert list(select_key_frames([])) == []


@pytest.mark.parametrize("noise", [0, 0.5])
def test_one_frame_a_second_is_a_key_frame_where_nothing_can_be_tracked(noise: float) -> None:
    rng = np.random.default_rng(1)
    fog = [np.clip(rng.normal(190, noise, (240, 320)), 0, 255).astype(np.uint8) for _ in range(25)]
    told: list[str] = []
    assert [frame.number for frame in select_key_frames(fog, 10, told.append)] == [0, 10, 20, 24]
    assert told == ["frames in which nothing can be tracked (dark, fog, smooth water?): 25; one a second is used"]
    # What comes out of the fog is a key frame at once.
    ground = list(_flight([CameraPose(x_px=x, y_px=0, altitude_px=260) for x in (0, 2, 4)]).images)
    frames = [np.dstack([frame] * 3) for frame in fog[:13]]
    assert [frame.number for frame in select_key_frames([*ground, *frames, *ground], 10)] == [0, 2, 3, 13, 16, 18]
    told.clear()
    list(select_key_frames(ground, 10, told.append))
    assert not told


@pytest.mark.parametrize(
    ("moving", "still", "moved"),
    [(60, 40, True), (21, 79, True), (19, 81, False), (MIN_CORNERS, 0, True), (MIN_CORNERS - 1, 0, None)],
)
def test_corners_of_a_display_are_no_ground(moving: int, still: int, moved: bool | None) -> None:
    """They drift a little; where few corners move, it is a car below a camera that hovers."""
    key = np.random.default_rng(1).uniform(0, 300, (moving + still, 1, 2)).astype(np.float32)
    now = key + np.where(np.arange(moving + still) < moving, 20, 3)[:, None, None].astype(np.float32)
    motion = _motion(key, now)
    assert (motion is None) == (moved is None)
    if motion is not None:
        np.testing.assert_allclose(motion, [[1, 0, 20 if moved else 3], [0, 1, 20 if moved else 3]], atol=0.01)


def test_gray_frames_are_taken_and_others_are_named() -> None:
    flat = np.full((240, 320), 90, np.uint8)
    assert [frame.number for frame in select_key_frames([flat, flat])] == [0, 1]
    others: list[Any] = ["frame.png", flat[:200], flat / 255, None]
    for other in others:
        with pytest.raises(InputError, match=r"^frame 1: "):
            list(select_key_frames([flat, other]))
    with pytest.raises(InputError, match=r"^frame 0: no array"):
        list(select_key_frames(others))


def test_a_folder_named_like_a_video_is_a_folder(tmp_path: Path) -> None:
    (folder := tmp_path / "clip.mov").mkdir()
    for name in ("1.png", "2.png"):
        (folder / name).write_bytes(b"a picture")
    with flight_sources(folder) as sources:
        assert [source.content for source in sources] == [folder / "1.png", folder / "2.png"]


def test_a_video_that_is_too_small_is_named_itself(tmp_path: Path) -> None:
    with write_video(video := tmp_path / "small.mp4", DEFAULT_RATE) as write_frame:
        for _ in range(2):
            write_frame(np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(InputError, match=rf"^{video}/frame 0: 64x48 pixels is too small"), flight_sources(video):
        pass
