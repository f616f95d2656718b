"""Tracking a rendered car whose corners are known, through a bridge, by the golden model and by hardware."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.backends.interface import Reference, load_backend
from sim.scene.target import Pursuit
from sim.simulators.scoreboard import find_mismatch
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply
from skymosaic.tracking.template import Roi, TemplatePose
from skymosaic.tracking.tracker import COASTED_FRAMES, LEARNING_FRAMES, SEARCH_SCALES, TrackedFrame, Tracker, _Track
from tests.skymosaic.tracking.conftest import true_corners

HIDDEN = 0.05
"""A car of which the bridge leaves no more than this share is not to be found."""


def test_a_car_is_tracked_and_found_again_after_a_bridge_hides_it(
    film: Pursuit, film_frames: list[NDArray[np.uint8]], roi: Roi
) -> None:
    truth = true_corners(film, roi)
    tracked = list(map(Tracker(roi).follow, film_frames))
    found = np.array([each.corners is not None for each in tracked])
    errors = [
        np.linalg.norm(each.corners - truth[each.number], axis=1).mean() for each in tracked if found[each.number]
    ]
    assert np.mean(errors) < 0.5
    assert np.max(errors) < 2.0
    hidden = np.flatnonzero(film.visible <= HIDDEN)
    assert len(hidden) >= 8
    assert not found[hidden].any()
    # Before the bridge it is never lost; behind it, it is found as soon as all of it is seen again.
    assert found[: np.flatnonzero(film.visible < 1)[0]].all()
    assert found[hidden[-1] :][film.visible[hidden[-1] :] >= 1].all()
    assert (film.visible[hidden[-1] :] >= 1).any()


def test_a_template_of_larger_scale_is_found(
    film: Pursuit, film_frames: list[NDArray[np.uint8]], roi: Roi, tmp_path: Path
) -> None:
    cut = film_frames[0][roi.y_px : roi.y_px + roi.height_px, roi.x_px : roi.x_px + roi.width_px]
    cv2.imwrite(str(tmp_path / "car.png"), cv2.resize(cut, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))
    truth = true_corners(film, roi)[3:]
    tracked = list(map(Tracker(tmp_path / "car.png").follow, film_frames[3:15]))
    errors = [np.linalg.norm(each.corners - truth[each.number], axis=1).mean() for each in tracked if each.pose]
    assert len(errors) >= 6
    assert np.mean(errors) < 2.0


def test_a_flat_template_is_refused(film_frames: list[NDArray[np.uint8]]) -> None:
    with pytest.raises(RegistrationError, match="features, 12 needed"):
        list(map(Tracker(np.full((80, 80, 3), 120, np.uint8)).follow, film_frames[:1]))
    with pytest.raises(InputError, match="template"):
        list(map(Tracker(np.zeros((10, 10), np.uint16)).follow, film_frames[:1]))


class Recorded:
    """A front end that keeps what it was asked and what it answered."""

    def __init__(self, backend: str) -> None:
        self._front_end = load_backend(backend)
        self.runs: list[tuple] = []

    def run(self, film_frames: Any, config: Any, *, reference: Reference = "held") -> Any:
        results = self._front_end.run(film_frames, config, reference=reference)
        self.runs.append((film_frames, reference, results))
        return results


@pytest.mark.slow
def test_hardware_with_a_held_reference_tracks_the_same_corners(
    film_frames: Any, roi: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiles the accelerator the first time."""
    tracked, recorded = {}, {}
    for backend in ("golden", "rtl"):
        recorded[backend] = Recorded(backend)
        monkeypatch.setattr("skymosaic.tracking.tracker.load_backend", lambda name: recorded[name])
        tracked[backend] = list(map(Tracker(roi, backend=backend).follow, film_frames[:6]))
    assert {reference for _, reference, _ in recorded["rtl"].runs} == {"held"}
    assert sum(len(results[-1].matches) for *_, results in recorded["rtl"].runs) > 100
    for (*_, wanted), (*_, got) in zip(recorded["golden"].runs, recorded["rtl"].runs, strict=True):
        assert find_mismatch(wanted, got) is None
    for wanted, got in zip(tracked["golden"], tracked["rtl"], strict=True):
        np.testing.assert_array_equal(wanted.corners, got.corners)


def test_what_a_callback_raises_does_not_end_the_track(roi: Roi, film_frames: list[NDArray[np.uint8]]) -> None:
    def break_at_the_second(tracked: TrackedFrame) -> None:
        assert tracked.number != 1, "broken"

    with Tracker(roi, on_frame=break_at_the_second) as tracker:
        assert not tracker.follow(film_frames[0]).reason
        with pytest.raises(AssertionError, match="broken"):
            tracker.follow(film_frames[1])
        assert tracker.follow(film_frames[2]).corners is not None
    with pytest.raises(InputError, match="ended"):
        tracker.follow(film_frames[3])


class Seen:
    """A template of twenty features that is where a list says, frame by frame; it keeps what it was asked."""

    corners = np.array([(0.0, 0), (100, 0), (100, 80), (0, 80)])
    zoom = 2.0
    weight = np.ones(20)

    def __init__(self, poses: list[Any], features: list[int] | None = None) -> None:
        self._poses = iter(poses)
        self._features = np.array(features or range(20))
        self.expected: list[NDArray[np.float64]] = []
        self.searched: list[tuple[float, Any]] = []
        self.weights: list[NDArray[np.float64]] = []

    def find_near(self, _frame: Any, expected: Any, weight: Any, *, min_inliers: int, rng: Any) -> TemplatePose | None:
        assert rng is not None
        self.expected.append(apply(expected, self.corners))
        self.weights.append(weight)
        found = next(self._poses)
        return None if found is None else TemplatePose(found, "similarity", min_inliers, self._features)

    def guess_within(self, _frame: Any, part: Any, zoom: float, weight: Any, *, min_inliers: int) -> None:
        assert min_inliers < 6
        assert len(weight) == 20
        self.searched.append((zoom, part))


WIDTH, HEIGHT = 900, 700
FRAME: Any = np.zeros((HEIGHT, WIDTH), np.uint8)


def moved(x: float, y: float, scale: float = 1.0) -> NDArray[np.float64]:
    return np.array([[scale, 0, x], [0, scale, y], [0, 0, 1]])


def begun(seen: Seen, place: NDArray[np.float64] | None = None) -> _Track:
    track = _Track(seen, np.random.default_rng(0))  # type: ignore[arg-type]
    if place is not None:
        track.begin(place)
    return track


def test_an_object_that_grows_is_expected_to_grow_until_it_is_lost() -> None:
    poses = [moved(100 + 5 * n, 100 - 3 * n, 1 + 0.05 * n) for n in range(1, 9)]
    seen = Seen([*poses, None, None, None])
    track = begun(seen, moved(100, 100))
    assert all(track.follow(FRAME) is not None for _ in poses)
    # The first step becomes the velocity, so that all later ones are predicted.
    for pose, expected in list(zip(poses, seen.expected, strict=False))[1:]:
        np.testing.assert_allclose(expected, apply(pose, seen.corners), atol=1e-6)
    corners: list[Any] = []
    for _ in range(3):
        assert track.follow(FRAME) is None
        corners.append(track.corners)
    # From where it was expected, it keeps its shape, and moves as its middle did.
    np.testing.assert_allclose(corners[0], apply(moved(145, 73, 1.45), seen.corners), atol=1e-6)
    np.testing.assert_allclose(np.diff(corners, axis=0), np.broadcast_to((7.5, -1.0), (2, 4, 2)), atol=1e-6)


def test_a_lost_object_is_expected_for_a_while_and_then_only_searched() -> None:
    seen = Seen([None] * (COASTED_FRAMES + 1))
    track = begun(seen, moved(20, 300))
    for _ in range(COASTED_FRAMES + 5):
        assert track.follow(FRAME) is None
    assert len(seen.expected) == COASTED_FRAMES + 1
    assert len(seen.searched) == COASTED_FRAMES + 5
    # At one size, that of the object when it was lost; of the parts, the nearest to it first.
    assert_parts_by_distance(seen.searched, [2.0], (70, 340))


def test_an_object_that_was_never_seen_is_searched_at_every_size_from_the_middle() -> None:
    seen = Seen([])
    track = begun(seen)
    for _ in range(60):
        assert track.follow(FRAME) is None
    assert seen.expected == []
    assert_parts_by_distance(seen.searched, [2.0 / scale for scale in SEARCH_SCALES], (WIDTH / 2, HEIGHT / 2))


def assert_parts_by_distance(searched: list[tuple[float, Canvas]], zooms: list[float], middle: Any) -> None:
    """The parts of each size cover the frame, and begin with the nearest."""
    assert list(dict.fromkeys(zoom for zoom, _ in searched)) == pytest.approx(zooms)
    for zoom in dict.fromkeys(zoom for zoom, _ in searched):
        parts = list(dict.fromkeys(part for each, part in searched if each == zoom))
        assert len(parts) > 1 or zoom < 1.5
        far = [float(np.linalg.norm(part.corners.mean(axis=0) - zoom * np.array(middle))) for part in parts]
        assert far == sorted(far)
        covered = np.zeros((round(HEIGHT * zoom), round(WIDTH * zoom)), np.bool_)
        for part in parts:
            covered[part.y_px : part.y_px + part.height_px, part.x_px : part.x_px + part.width_px] = True
        assert covered.all()


@pytest.mark.parametrize(
    "pose",
    [moved(0, 0, 1.45), moved(0, 0, 0.68), np.array([[1.0, 0, 0], [0, 1, 0], [-0.02, 0.01, 1]])],
    ids=["grown", "shrunk", "folded"],
)
def test_a_pose_of_another_size_or_shape_is_none(pose: NDArray[np.float64]) -> None:
    track = begun(Seen([pose, moved(0, 0, 1.35)]), moved(0, 0))
    assert track.follow(FRAME) is None
    assert track.follow(FRAME) is not None


def test_features_that_do_not_follow_the_object_lose_their_weight() -> None:
    seen = Seen([moved(n, 0) for n in range(9)], features=list(range(12)))
    track = begun(seen, moved(0, 0))
    for _ in range(9):
        track.follow(FRAME)
    assert [int(np.count_nonzero(weight)) for weight in seen.weights] == [20] * LEARNING_FRAMES + [12] * (
        9 - LEARNING_FRAMES
    )
