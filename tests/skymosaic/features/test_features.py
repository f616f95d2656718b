"""Frames as the front end takes them, and features of the host."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from golden_model.config import preset_config
from golden_model.records import FRAME_STATUS, HOMOGRAPHY, MATCH, Cause, Tag
from sim.backends.errors import BackendError
from sim.backends.golden import GoldenBackend
from sim.backends.interface import FrameResult
from sim.scene import make_pair
from skymosaic.features.backends import load_backend
from skymosaic.features.board_client import PORT, BoardBackend, _check_status
from skymosaic.features.contrast import find_shared, share_pattern
from skymosaic.features.frames import Change, ChangedImage, change_image, map_matches_to_images, swap_sides
from skymosaic.features.positions import MASK_MARGIN_PX, are_on_ground, match_points, raw_positions


@pytest.mark.parametrize("name", ["fpga", "fpga:here", "golden:here", "rtl:7"])
def test_unknown_backend_names_the_valid_ones(name: str) -> None:
    with pytest.raises(BackendError, match=f"unknown backend '{name}'; valid: golden, rtl, board"):
        load_backend(name)


@pytest.mark.parametrize("name", ["golden", "board:somewhere"])
def test_only_a_simulation_has_waves(tmp_path: Path, name: str) -> None:
    with pytest.raises(BackendError, match=f"the backend {name.partition(':')[0]} cannot write waves; use rtl"):
        load_backend(name, waves=tmp_path / "waves.vcd")
    assert not (tmp_path / "waves.vcd").exists()


TOO_MANY = int(Cause.TOO_MANY_FEATURES)


@pytest.mark.parametrize(
    ("address", "reached"),
    [("pynq", ("pynq", PORT)), ("pynq:", ("pynq", PORT)), ("10.0.0.7:0", ("10.0.0.7", 0)), ("b:65535", ("b", 65535))],
)
def test_a_port_may_be_left_out(address: str, reached: tuple[str, int]) -> None:
    assert BoardBackend(address).address == reached


@pytest.mark.parametrize("address", [":", ":7", "b:65536", "b:-1", "b:x", "b:7:8", ""])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(BackendError, match=r"is missing; give it with|is not the address of a board; give HOST or"):
        BoardBackend(address)


@pytest.mark.parametrize(
    ("where", "changed", "says"),
    [
        ("status", {}, ""),
        ("status", {"good": 0, "causes": TOO_MANY}, ""),
        ("match_status", {"good": 0, "causes": TOO_MANY}, ""),
        ("status", {"tag": Tag.MATCH}, "sent an answer without a frame's status; restart"),
        ("match_status", {"frame": 4}, "sent frame 4 instead of 0; restart"),
        ("match_status", {"width": 95}, "sent a frame of 95x64; restart"),
        ("status", {"height": 65}, "sent a frame of 96x65; restart"),
        ("status", {"causes": TOO_MANY}, r"sent a bad frame \(causes 0x10\); restart"),
        ("status", {"good": 0}, r"sent a bad frame \(causes 0x0\); restart"),
        ("match_status", {"good": 0, "causes": TOO_MANY | 1}, r"sent a bad frame \(causes 0x11\); restart"),
        ("homography", {}, ""),
        ("homography", {"tag": Tag.MATCH}, "sent another frame's homography; restart"),
        ("homography", {"frame": 5}, "sent another frame's homography; restart"),
    ],
)
def test_an_answer_has_to_be_of_the_frame_that_was_sent(where: str, changed: dict[str, int], says: str) -> None:
    """Its number wraps with the counter of the board."""
    config = preset_config("aerial")
    parts: dict[str, Any] = {name: np.zeros(1, FRAME_STATUS.dtype) for name in ("status", "match_status")}
    for status in parts.values():
        status["tag"], status["good"], status["width"], status["height"] = Tag.FRAME_STATUS, 1, 96, 64
    if where == "homography":
        parts["homography"] = np.zeros(1, HOMOGRAPHY.dtype)
        parts["homography"]["tag"] = Tag.HOMOGRAPHY
    for name, value in changed.items():
        parts[where][name] = value
    features, matches = np.zeros(0, config.front_end.pattern.record.dtype), np.zeros(0, MATCH.dtype)
    result = FrameResult(features, matches, cycles=0, **{name: part[0] for name, part in parts.items()})
    for shape in ((64, 96), (64, 96, 3)):
        if says:
            with pytest.raises(BackendError, match=f"the board at here {says} serve.py on it$"):
                _check_status(result, 1 << 32, shape, "here")
        else:
            _check_status(result, 1 << 32, shape, "here")


SHAPE = (120, 160)


@pytest.fixture
def pattern() -> Array:
    return np.random.default_rng(0).normal(0, 6, SHAPE)


def see(pattern: Array, place: int) -> Pixels:
    """Soft ground of a place under a pattern."""
    rows, columns = np.indices(SHAPE) / 15
    return np.rint(120 + 20 * np.sin(rows + place) * np.cos(columns * (1 + place / 9)) + pattern).astype(np.uint8)


def test_images_share_a_pattern_at_the_same_pixels_only(pattern: Array) -> None:
    assert share_pattern(see(pattern, 1), see(pattern, 2))
    assert not share_pattern(see(pattern, 1), see(np.roll(pattern, 3, axis=1), 2))
    assert not share_pattern(see(pattern, 1), see(pattern, 2)[:-8])
    # The upper half shares it, which the first quarter alone would not tell from the whole.
    upper = np.where(np.arange(SHAPE[0])[:, None] < SHAPE[0] // 2, pattern, np.roll(pattern, 3, axis=1))
    assert not share_pattern(see(pattern, 1), see(upper, 2))
    assert not share_pattern(see(pattern, 1)[::-1], see(upper, 2)[::-1])


def test_a_display_is_where_images_are_alike(pattern: Array) -> None:
    rng = np.random.default_rng(2)
    left, right = (rng.integers(0, 256, SHAPE, np.uint8) for _ in range(2))
    left[60:100, 20:140] = right[60:100, 20:140] = see(4 * pattern, 1)[60:100, 20:140]
    shared = find_shared(left, right)
    assert shared[60:100, 20:140].all()
    # The margin is half of the square that is compared, and half of one more.
    assert not shared[:38].any()


def test_points_count_that_are_far_enough_from_what_is_masked() -> None:
    visible = np.full((120, 200), 255, np.uint8)
    visible[60, 100] = 0
    assert MASK_MARGIN_PX == 40
    near = [(60, 60), (140, 60), (100, 20), (100, 100), (60.4, 60), (60, 20)]
    far = [(59, 60), (141, 60), (100, 19), (100, 101), (59.4, 60)]
    # The border of the picture is none of the mask; what lies beyond it is judged as its border is.
    far += [(0, 0), (199, 119), (-3, -9), (250, 300)]
    points = np.array([*near, *far], np.float64)
    assert are_on_ground(points, visible).tolist() == [False] * len(near) + [True] * len(far)
    assert are_on_ground(points, None).all()


CONFIG = preset_config("aerial")
SIZE = (320, 240)


@pytest.fixture(scope="module")
def image() -> Pixels:
    return make_pair(seed=1, size=SIZE).images[0][..., 1].copy()


@pytest.mark.parametrize(
    "change",
    [
        Change(2.0),
        Change(0.5),
        Change(1.0, 2**0.5, 60.0),
        Change(2.0, margin_px=20),
        Change(2.0, quarter=(1, 0)),
        Change(2.0, quarter=(0, 1)),
    ],
)
def test_a_changed_frame_matches_its_image_in_place(image: Pixels, change: Change) -> None:
    frame = change_image(image, change)
    matches = GoldenBackend().run([image, frame.pixels], CONFIG)[1].matches
    identity = change_image(image, Change())
    assert identity
    assert frame
    left, right = match_points(map_matches_to_images(matches, (identity, frame), (image, image)))
    close = np.linalg.norm(left - right, axis=1) < 1.5
    assert close.sum() >= 12
    assert np.median(np.linalg.norm(left - right, axis=1)[close]) < 0.6


@pytest.mark.parametrize("side", ["left", "right"])
def test_matches_outside_their_images_are_dropped(image: Pixels, side: str) -> None:
    (width, height), moved = SIZE, np.array([[1.0, 0, -20], [0, 1, -10], [0, 0, 1]])
    frames = {"left": ChangedImage(image, np.eye(3)), "right": ChangedImage(image, np.eye(3))}
    frames[side] = ChangedImage(image, moved)
    inside, outside = [(20, 10), (width + 19, height + 9)], [(width + 20, 50), (50, height + 10), (19, 50), (50, 9)]
    matches = np.zeros(6, MATCH.dtype)
    matches[f"{side}_x"], matches[f"{side}_y"] = raw_positions(np.array(inside + outside, np.float64)).T
    found = map_matches_to_images(matches, (frames["left"], frames["right"]), (image, image))
    np.testing.assert_array_equal(match_points(found)[side == "right"], [(0, 0), (width - 1, height - 1)])


def test_frames_outside_the_range_of_the_front_end_are_refused(image: Pixels) -> None:
    assert change_image(image, Change(0.2)) is None
    assert change_image(image, Change(20.0)) is None
    assert change_image(image, Change(12.7)) is not None
    assert change_image(image, Change(12.7, margin_px=20)) is None


def test_a_tilt_compresses_along_its_direction(image: Pixels) -> None:
    frame = change_image(image, Change(1.0, 2.0, 0.0))
    assert frame.pixels.shape == (SIZE[1], SIZE[0] // 2 + 1)
    np.testing.assert_allclose(frame.to_image[:2, :2], [[2, 0], [0, 1]], atol=1e-12)
    coloured = change_image(np.stack([image] * 3, axis=2), Change(1.0, 2.0, 0.0))
    np.testing.assert_array_equal(coloured.pixels, np.stack([frame.pixels] * 3, axis=2))


def test_swapping_twice_changes_nothing(image: Pixels) -> None:
    matches = GoldenBackend().run([image, image[:200]], CONFIG)[1].matches
    assert len(matches) > 20
    other = swap_sides(matches)
    np.testing.assert_array_equal(other["left_x"], matches["right_x"])
    np.testing.assert_array_equal((other["turn"] + matches["turn"]) % 16, 0)
    np.testing.assert_array_equal(swap_sides(other), matches)
