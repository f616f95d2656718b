from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sim.scene import Camera, CameraPose, Flight, Photometry
from skymosaic.common.errors import InputError
from skymosaic.imagery.exif import Position
from skymosaic.imagery.key_frames import (
    DEFAULT_RATE,
    MIN_CORNERS,
    _motion,
    flight_sources,
    read_key_frames,
    select_key_frames,
)
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.subtitles import read_track
from skymosaic.imagery.video import write_video


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


def test_a_camera_that_hovers_or_whose_flow_is_lost() -> None:
    flight = _flight([CameraPose(x_px=x, y_px=0, altitude_px=260) for x in np.linspace(0, 2, 12)])
    assert [frame.number for frame in select_key_frames(flight.images)] == [0, 11]
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


def test_a_video_that_is_too_small_is_named_itself(tmp_path: Path) -> None:
    with write_video(video := tmp_path / "small.mp4", DEFAULT_RATE) as write_frame:
        for _ in range(2):
            write_frame(np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(InputError, match=rf"^{video}/frame 0: 64x48 pixels is too small"), flight_sources(video):
        pass


PLACE = Position(41.4247, -2.2341)
FORMATS = {
    # As an Air 2S, a Mavic 2, a Matrice 300 and a Mini 2 write them.
    "[iso : 100] [latitude: {lat}] [longitude: {lon}] [altitude: 117.0]</font>": PLACE,
    "[latitude : {lat}] [longtitude : {lon}] [altitude: 117.0]": PLACE,
    "2022.06.21 16:06:17\nGPS({lat},{lon},0.0M) BAROMETER:0.3M": PLACE,
    "HOME(9,9) 2017.07.29 15:18:50\nGPS({lon},{lat},14) BAROMETER:0.0": PLACE,
    "F/2.8, SS 206.14, EV 0, GPS ({lon}, {lat}, 26), D 224.78m, H 15.30m": PLACE,
    "[latitude: 0.000000] [longitude: 0.000000]": None,
    "[latitude: 1.2.3] [longitude: 4]": None,
    "GPS(n/a,n/a)": None,
    "And now for something completely different": None,
}


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds over ground that moves by a hundred pixels in each."""
    texture = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (240, 960, 3), dtype=np.uint8), (0, 0), 3)
    path = tmp_path_factory.mktemp("film") / "DJI_0001.MP4"
    with write_video(path, Fraction(25)) as write_frame:
        for number in range(75):
            write_frame(texture[:, 4 * number : 4 * number + 320])
    return path


def _subtitle(video: Path, line: str, seconds: int = 3) -> None:
    """Write the places of a drone that flies 0.001 degrees to the north a second."""
    cues = [
        f"{s + 1}\n00:00:{s:02},000 --> 00:00:{s + 1:02},000\n"
        + line.format(lat=f"{PLACE.latitude_deg + s / 1000:.4f}", lon=PLACE.longitude_deg)
        for s in range(seconds)
    ]
    video.with_suffix(".SRT").write_text("\n\n".join(cues))


@pytest.mark.parametrize("line", FORMATS)
def test_places_in_subtitles_of_drones_are_read(tmp_path: Path, line: str) -> None:
    _subtitle(video := tmp_path / "v.mp4", line)
    told: list[str] = []
    track = read_track(video, 3.5, told.append)
    if FORMATS[line] is None:
        assert track is None
        assert told == [f"{tmp_path / 'v.SRT'} has no positions"]
    else:
        assert track is not None
        assert track(0.5).degrees == pytest.approx((PLACE.longitude_deg, PLACE.latitude_deg + 0.0005), abs=1e-9)


def test_key_frames_have_the_places_of_the_subtitles_of_their_video(filmed: Path) -> None:
    _subtitle(filmed, next(iter(FORMATS)))
    told: list[str] = []
    frames = [(frame.number, taken.position) for _, frame, taken, _ in read_key_frames(filmed, told.append)]
    assert len(frames) > 2
    for number, position in frames:
        assert position is not None
        north_deg = min(number / 25, 2) / 1000
        assert position.degrees == pytest.approx((PLACE.longitude_deg, PLACE.latitude_deg + north_deg), abs=1e-9)
    assert told == [f"note {filmed}: positions are those of {filmed.with_suffix('.SRT')}"]
    with flight_sources(filmed) as sources:
        assert [source.read_metadata().position for source in sources] == [position for _, position in frames]
    _subtitle(filmed, next(iter(FORMATS)), seconds=6)
    told.clear()
    assert not any(taken.position for *_, taken, _ in read_key_frames(filmed, told.append))
    srt = filmed.with_suffix(".SRT")
    assert told == [f"note {filmed}: {srt} lasts 6 s, the video 3 s: it is of another, and gives no positions"]


@pytest.mark.parametrize("border", [0, 255])
def test_the_border_of_a_stabilised_frame_is_no_ground(tmp_path: Path, border: int) -> None:
    """The later frames are moved and turned; a pond or glare at the side of the others is ground."""
    rng, moved = np.random.default_rng(3), []
    ground = cv2.resize(rng.integers(30, 220, (60, 90, 3), dtype=np.uint8), (900, 600), interpolation=cv2.INTER_CUBIC)
    for number in range(12):
        frame = ground[100:340, 30 * number : 30 * number + 320].copy()
        if not (turned := number // 6):
            cv2.ellipse(frame, (0, 120), (40, 25), 0, 0, 360, (border,) * 3, -1)
        shift = cv2.getRotationMatrix2D((160, 120), 3.0 * turned, 1.0)
        shift[:, 2] += 9 * turned
        moved.append(cv2.warpAffine(frame, shift, (320, 240), borderValue=(border,) * 3))
    with write_video(tmp_path / "steady.mp4", Fraction(2)) as write:
        for frame in moved:
            write(frame)
    with flight_sources(tmp_path / "steady.mp4") as sources:
        assert {"png", "jpg"} == {source.files[0].suffix[1:] for source in sources}
        for source in sources:
            number = int(source.name.rsplit(" ", 1)[1])
            read = source.read_photograph(Lens())
            assert (read.visible is not None) == bool(number // 6)
            if read.visible is not None:
                warped = cv2.warpAffine(np.full((240, 320), 255, np.uint8), shift, (320, 240))
                inside = cv2.erode(warped, np.ones((15, 15)), borderType=cv2.BORDER_REPLICATE) == 255
                assert read.visible[warped == 0].mean() < 0.005 * 255
                assert read.visible[inside].mean() > 0.97 * 255
