"""What moves with the camera, an on-screen display or dirt on the lens, is not taken for the ground."""

import re
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic import mosaics, register
from skymosaic.common.errors import RegistrationError
from skymosaic.geometry.ground import Sight, find_ground, measure_agreement
from skymosaic.geometry.homography import apply
from skymosaic.imagery.key_frames import select_key_frames
from skymosaic.mosaicking.live.mosaic import LiveMosaic
from skymosaic.tracking.template import Roi
from skymosaic.tracking.tracker import Tracker

SIZE = (640, 480)


def with_display(image: np.ndarray) -> np.ndarray:
    """A drone's display: text in the corners and along the borders, a cross in the middle."""
    shown = image.copy()
    for y, line in ((25, "H 120.4 m  D 381 m  REC 00:41"), (465, "HS 5.2 m/s VS 0.0 GPS 17 ISO 100"), (50, "BAT 61 %")):
        cv2.putText(shown, line, (12, y), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)
    cv2.drawMarker(shown, (320, 240), (255, 255, 255), cv2.MARKER_CROSS, 30, 2)
    return shown


def with_dirt(image: np.ndarray) -> np.ndarray:
    """Dirt on the glass before the lens, dark and sharp."""
    shown, rng = image.copy(), np.random.default_rng(4)
    for x, y in rng.integers(30, (SIZE[0] - 30, SIZE[1] - 30), (20, 2)).tolist():
        cv2.fillPoly(shown, [np.array((x, y)) + rng.integers(-22, 23, (9, 2))], (5, 5, 5))
    return shown


def with_jittering_display(image: np.ndarray) -> np.ndarray:
    """A display that is not always drawn at the same pixel: lines of text over half of the picture."""
    shown = image.copy()
    jitter = int(image[0, 0, 0]) % 3
    for line in range(10):
        text = f"ALT {100 + 7 * line} M  SPD {line}.4 GPS 12"
        cv2.putText(shown, text, (15 + jitter, 30 + 22 * line + jitter), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255,) * 3, 2)
    return shown


def with_lines(site: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Ground of half the contrast behind eight lines of text."""
    shown = np.asarray(36 + 0.5 * site.astype(np.float64), dtype=np.uint8)
    for line in range(8):
        text = f"ALT {100 + 7 * line} M SPD {line}.4 GPS 12 BAT 14.{line}V LAT 4{line}.2{line}"
        cv2.putText(shown, text, (5, 25 + 40 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 2)
    return shown


def at_night(image: np.ndarray, number: int, contrast: float = 0.25) -> np.ndarray:
    """Little contrast, under the pattern of a sensor, and with the noise of a photograph."""
    pattern, rng = np.random.default_rng(0).normal(0, 5, image.shape[:2]), np.random.default_rng(number + 1)
    dark = 100 + contrast * image.mean(axis=2) + pattern + rng.normal(0, 1.5, image.shape[:2])
    return np.asarray(dark.clip(0, 255), dtype=np.uint8)


def ground(seed: int) -> np.ndarray:
    """A place from above: noise of four sizes, which costs a hundredth of a rendered scene."""
    rng, (width, height) = np.random.default_rng(seed), SIZE
    layers = [
        cv2.resize(rng.normal(0, 1, (height // size, width // size, 3)), (2 * width, 2 * height)) * np.sqrt(size)
        for size in (2, 5, 14, 40)
    ]
    return np.asarray(cv2.normalize(np.sum(layers, axis=0), None, 0, 255, cv2.NORM_MINMAX), dtype=np.uint8)


def seen(place: np.ndarray, x_px: float, y_px: float, degrees: float = 0.0) -> np.ndarray:
    """A photograph of a place, turned about its middle."""
    to_place = cv2.getRotationMatrix2D((SIZE[0] / 2, SIZE[1] / 2), degrees, 1.0)
    to_place[:, 2] += x_px, y_px
    return np.asarray(cv2.warpAffine(place, to_place, SIZE, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP))


@pytest.fixture(scope="module")
def sites() -> list[np.ndarray]:
    """Photographs of three places that have nothing in common."""
    return [seen(ground(seed), 300, 200) for seed in (5, 6, 7)]


@pytest.mark.parametrize("cover", [with_display, with_dirt, with_jittering_display])
def test_what_stands_still_joins_no_different_places(sites: list[NDArray[np.uint8]], cover: Callable[..., Any]) -> None:
    pair = register(cover(sites[0]), cover(sites[1]))
    assert not pair.accepted
    assert "of the ground" in pair.reason


def test_three_places_with_one_display_are_no_mosaic(sites: list[NDArray[np.uint8]]) -> None:
    with pytest.raises(
        RegistrationError, match=r"image 0: nothing links it to the others; what moves .*image 1: .*image 2: "
    ):
        list(mosaics([with_display(site) for site in sites]))


@pytest.mark.parametrize("cover", [with_display, with_dirt])
def test_the_ground_behind_it_is_registered(cover: Callable[..., Any]) -> None:
    place = ground(5)
    left, right = seen(place, 200, 150), seen(place, 330, 190, degrees=4)
    plain, covered = register(left, right), register(cover(left), cover(right))
    assert covered.accepted
    corners = np.array([(0, 0, 1), (640, 0, 1), (640, 480, 1), (0, 480, 1)], dtype=float).T
    one, other = ((h @ corners)[:2] / (h @ corners)[2] for h in (plain.homography, covered.homography))
    assert np.abs(one - other).max() < 3


def test_a_sensors_pattern_is_subtracted_from_a_pair() -> None:
    place = ground(5)
    left, right = seen(place, 200, 150), seen(place, 330, 190, degrees=4)
    plain, dark = register(left, right), register(at_night(left, 0), at_night(right, 1))
    assert plain.homography is not None
    assert dark.homography is not None
    grid = np.stack(np.meshgrid((200, 400, 600), (100, 300, 450)), axis=-1).reshape(-1, 2).astype(float)
    assert apply(dark.homography, grid) == pytest.approx(apply(plain.homography, grid), abs=1)
    # The matches are in the photographs' pixels, as the homography is; an inlier is 2 px of the half size off, at most.
    points = dark.points()
    assert np.percentile(np.linalg.norm(apply(plain.homography, points.left) - points.right, axis=1), 90) < 4
    assert dark.confidence is not None
    assert dark.confidence.ground.share > 0.8
    assert "moves with the camera" in dark.right.notes[-1]


@pytest.mark.parametrize(
    ("contrast", "reason"), [(0.25, "of the ground"), (0.12, "of the ground"), (0.02, "too little ground is seen")]
)
def test_a_sensors_pattern_joins_no_different_places(
    sites: list[NDArray[np.uint8]], contrast: float, reason: str
) -> None:
    pair = register(at_night(sites[0], 0, contrast), at_night(sites[1], 1, contrast))
    assert not pair.accepted
    assert reason in pair.reason


def test_a_sensors_pattern_is_subtracted_from_a_flight_and_a_live_mosaic() -> None:
    place = ground(5)
    photographs = [at_night(seen(place, 100 + 90 * k, 100 + 20 * k, degrees=3 * k), k, 0.2) for k in range(4)]
    (whole,) = mosaics(photographs)
    live = LiveMosaic()
    live.extend(photographs[:3])
    assert len(whole.placed) == 4
    assert len(live.transforms) == 3
    middle = np.array([[SIZE[0] / 2, SIZE[1] / 2]])
    for transforms in (whole.transforms, live.transforms):
        moved = apply(np.linalg.inv(transforms[0]) @ transforms[2], middle) - middle
        assert moved[0] == pytest.approx((180, 40), abs=8)


def test_copies_of_one_photograph_are_told(sites: list[NDArray[np.uint8]]) -> None:
    pair = register(sites[0], sites[0].copy())
    assert pair.accepted
    assert pair.right.notes == ("the same picture as left image",)


def test_a_camera_that_hovers_sees_the_ground(sites: list[NDArray[np.uint8]]) -> None:
    rng = np.random.default_rng(1)
    left, right = (np.clip(sites[0] + rng.normal(0, 4, sites[0].shape), 0, 255).astype(np.uint8) for _ in range(2))
    pair = register(left, right)
    assert pair.confidence is not None
    assert pair.confidence.verdict == "good"
    assert pair.confidence.ground.covered > 0.95
    assert not pair.right.notes


@pytest.mark.parametrize("gravel", [0, 3, 20])
def test_a_display_over_nothing_or_over_gravel_is_not_good_and_says_how_much_it_covers(gravel: int) -> None:
    rng, displays = np.random.default_rng(1), []
    for _ in range(2):
        shown = cv2.resize(rng.normal(90, gravel, (120, 160)).clip(0, 255), (640, 480)).astype(np.uint8)
        for line in range(8):
            text = f"ALT 1{line}7 M SPD {line}.4 GPS 12 BAT 14.{line}V"
            cv2.putText(shown, text, (5, 25 + 60 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)
        displays.append(shown)
    pair = register(*displays)
    assert pair.confidence is not None
    assert pair.confidence.verdict == "check"
    assert re.match(r"what agrees covers [2-6]\d % of the picture, which may be a display: ", pair.confidence.reason)
    assert pair.confidence.summary()["ground_covered"] == pytest.approx(pair.confidence.ground.covered, abs=1e-4)


def test_water_below_a_camera_that_hovers_is_refused_with_the_shares_and_delivered_on_request(
    sites: list[NDArray[np.uint8]],
) -> None:
    bank, later = sites[0], sites[0].copy()
    later[:, 250:] = sites[1][:, 250:]
    refused, delivered = register(bank, later), register(bank, later, accept_poor=True)
    assert not refused.accepted
    assert re.match(r"what agrees covers 4\d % of the ground, and .* 0 % of the picture needs 70 %: ", refused.reason)
    assert "`accept_poor`" in refused.reason
    assert delivered.homography == pytest.approx(np.eye(3), abs=0.01)
    assert delivered.confidence is not None
    assert delivered.confidence.verdict == "poor"
    assert delivered.confidence.reason.startswith("what agrees covers 4")


def test_a_shore_below_a_camera_that_hovers_is_delivered_but_not_good(sites: list[NDArray[np.uint8]]) -> None:
    later = sites[0].copy()
    later[:, 390:] = sites[1][:, 390:]
    pair = register(sites[0], later)
    assert pair.homography == pytest.approx(np.eye(3), abs=0.01)
    assert pair.confidence is not None
    assert pair.confidence.verdict == "check"
    assert pair.confidence.reason.startswith("what agrees covers 6")


def test_what_a_mask_hides_does_not_vote(sites: list[NDArray[np.uint8]]) -> None:
    moved = sites[0].copy()
    moved[:, 250:] = sites[1][:, 250:]
    visible = np.zeros(moved.shape[:2], np.uint8)
    visible[:, :250] = 255
    whole = measure_agreement(Sight(sites[0]), Sight(moved), np.eye(3))
    masked = measure_agreement(Sight(sites[0], visible), Sight(moved), np.eye(3))
    assert whole.share < 0.5
    assert masked.share == 1
    assert 0.3 * whole.blocks < masked.blocks < 0.45 * whole.blocks


def test_what_lies_between_the_lines_of_a_display_votes_in_finer_pictures(sites: list[NDArray[np.uint8]]) -> None:
    agreement = measure_agreement(Sight(with_lines(sites[0])), Sight(with_lines(sites[1])), np.eye(3))
    coarse = np.count_nonzero(agreement.agreeing) / agreement.blocks
    assert agreement.required - 0.2 < coarse < agreement.required
    assert agreement.share < 0.53
    assert agreement.is_refused


def test_between_the_lines_of_a_display_the_ground_of_a_moved_camera_is_good() -> None:
    place = ground(5)
    pair = register(with_lines(seen(place, 200, 150)), with_lines(seen(place, 260, 80)))
    assert pair.confidence is not None
    assert pair.confidence.verdict == "good"
    assert pair.confidence.correlation > 0.9
    assert pair.confidence.ground.share > 0.9


def test_the_farther_a_camera_moves_the_less_must_agree(sites: list[NDArray[np.uint8]]) -> None:
    sight = Sight(sites[0])
    moved = [measure_agreement(sight, sight, np.array([[1.0, 0, x], [0, 1, 0], [0, 0, 1]])) for x in (0, 64, 160)]
    assert [each.required for each in moved] == pytest.approx([0.7, 0.4, -0.05])
    assert [each.suffices for each in moved] == [True, False, True]
    assert measure_agreement(sight, Sight(~sites[0]), np.eye(3)).share == 0


def test_faint_ground_votes_in_the_coarsest_pictures_alone() -> None:
    """A third of the picture has strong texture, which stands still; the rest has faint one, of two places."""
    rng = np.random.default_rng(7)
    grain = [cv2.resize(rng.normal(size=(60, 80)), SIZE, interpolation=cv2.INTER_CUBIC) for _ in range(3)]
    strong = np.arange(SIZE[0]) < SIZE[0] // 3
    left, right = (
        Sight(np.rint(128 + np.where(strong, 15 * grain[0], 1.5 * each)).astype(np.uint8)) for each in grain[1:]
    )
    agreement = measure_agreement(left, right, np.eye(3))
    rows, columns = agreement.agreeing.shape
    assert agreement.blocks == pytest.approx(rows * columns / 3, abs=rows)
    assert agreement.decisive is not None
    assert agreement.share < 0.7 < agreement.agreeing.sum() / agreement.blocks


def test_a_homography_that_moves_all_but_its_matches_joins_no_ground(sites: list[NDArray[np.uint8]]) -> None:
    text = np.stack([np.linspace(30, 600, 12), np.linspace(440, 446, 12)], axis=1)
    # A line of text stands still, and one match above it has moved.
    left, right = np.vstack([text, [(320, 60)]]), np.vstack([text, [(320, 200)]])
    homography = np.asarray(cv2.findHomography(left, right)[0])
    corner = apply(homography, np.array([0.0, 0.0]))
    assert np.linalg.norm(corner) > 0.2 * SIZE[0]
    _, agreement, left_out = find_ground(
        lambda left_out: ("fit", None if left_out.rejected else homography, (left, right)),
        lambda _fit: (Sight(sites[0]), Sight(sites[1])),
    )
    assert agreement is not None
    assert agreement.is_refused
    assert len(left_out.rejected) == 1


def test_a_flight_behind_a_display_is_whole() -> None:
    place = ground(8)
    corners = ((50, 40), (300, 70), (330, 300), (60, 280))
    images = [with_display(seen(place, *corner, degrees=3 * turn)) for turn, corner in enumerate(corners)]
    (whole,) = mosaics(images)
    assert len(whole.placed) == 4


def test_a_live_mosaic_joins_no_different_places_and_says_why(sites: list[NDArray[np.uint8]]) -> None:
    live = LiveMosaic()
    assert [live.add(with_display(site)).submaps for site in sites] == [1, 2, 3]
    assert live.left_out_moving


@pytest.mark.parametrize("cover", [with_display, with_dirt])
def test_a_film_has_the_same_key_frames_behind_it(cover: Callable[..., Any]) -> None:
    place = ground(9)
    film = [np.ascontiguousarray(place[200:680, x : x + SIZE[0]]) for x in range(0, 600, 15)]
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
