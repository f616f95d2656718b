"""The state of a track, with a template that is where a list says."""

from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from skymosaic.compositing.warp import Canvas
from skymosaic.geometry.homography import apply
from skymosaic.tracking.template import TemplatePose, View
from skymosaic.tracking.track import COASTED_FRAMES, SEARCH_SCALES, Track, _parts

VIEW = View(np.zeros((64, 64), np.uint8), np.eye(3), np.eye(3))


class Seen:
    """A template of twenty features that is where a list says, frame by frame; it keeps what it was asked."""

    corners = np.array([(0.0, 0), (100, 0), (100, 80), (0, 80)])
    zoom = 2.0
    weight = np.ones(20)
    first_view = VIEW
    sees_surroundings = True

    def __init__(self, poses: list[Any], left_out: tuple[int, ...] = ()) -> None:
        self._poses = iter(poses)
        self.left_out = np.array(left_out, np.intp)
        self.followed = np.setdiff1d(range(20), left_out)
        self.by_blocks: list[View] = []
        self.moves: list[bool] = []
        self.expected: list[Array] = []
        self.searched: list[tuple[float, Any]] = []
        self.weights: list[Array] = []
        self.guess: Array | None = None
        self.fewest: list[int] = []

    def look_near(
        self, _frame: Any, expected: Any, weight: Any, reference: Any = None, *, moves: bool, min_inliers: int, rng: Any
    ) -> tuple[TemplatePose | None, bool]:
        assert rng is not None
        if reference is not None:
            assert min_inliers == 10
            self.by_blocks.append(reference)
            return None, self.sees_surroundings
        self.moves.append(moves)
        self.fewest.append(min_inliers)
        self.expected.append(apply(expected, self.corners))
        self.weights.append(weight)
        found = next(self._poses)
        if found is None:
            return None, self.sees_surroundings
        view, others = VIEW._replace(in_frame=found), self.left_out
        pose = TemplatePose(found, "similarity", min_inliers, self.followed, others, len(others) > 0, view)
        return pose, True

    def guess_within(self, _frame: Any, part: Any, zoom: float, weight: Any, *, min_inliers: int) -> Any:
        assert min_inliers == 4
        assert len(weight) == 20
        self.searched.append((zoom, part))
        return self.guess


WIDTH, HEIGHT = 900, 700
FRAME: Any = np.zeros((HEIGHT, WIDTH), np.uint8)


def moved(x: float, y: float, scale: float = 1.0) -> Array:
    return np.array([[scale, 0, x], [0, scale, y], [0, 0, 1]])


def begun(seen: Seen, place: Array | None = None) -> Track:
    track = Track(seen, np.random.default_rng(0))  # type: ignore[arg-type]
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


def test_a_lost_object_is_expected_and_then_searched_as_one_never_seen() -> None:
    seen = Seen([None] * (COASTED_FRAMES + 1))
    track = begun(seen, moved(20, 300))
    for _ in range(COASTED_FRAMES + 5):
        assert track.follow(FRAME) is None
    assert len(seen.expected) == COASTED_FRAMES + 1
    assert len(seen.searched) == COASTED_FRAMES + 5
    # At one size, that of the object when it was lost; of the parts, the nearest to it first.
    assert_parts_by_distance(seen.searched, [2.0], (70, 340))
    seen = Seen([])
    track = begun(seen)
    for _ in range(60):
        assert track.follow(FRAME) is None
    assert seen.expected == []
    assert_parts_by_distance(seen.searched, [2.0 / scale for scale in SEARCH_SCALES], (WIDTH / 2, HEIGHT / 2))


def test_a_guess_is_verified_by_more_features_and_begins_a_track_that_stands_still() -> None:
    seen = Seen([None, moved(203, 100), moved(206, 100), moved(209, 100)])
    track = begun(seen)
    assert track.follow(FRAME) is None
    seen.guess = moved(200, 100)
    assert track.follow(FRAME) is None
    assert track.corners is None
    for x in (203, 206, 209):
        pose = track.follow(FRAME)
        assert pose is not None
        corners: Any = track.corners
        np.testing.assert_allclose(corners, apply(moved(x, 100), seen.corners), atol=1e-6)
    assert seen.fewest == [8, 8, 6, 6]
    # Where it was guessed, where it was found, and a step ahead.
    assert [expected[0, 0] for expected in seen.expected] == pytest.approx([200, 200, 203, 209])
    assert len(seen.searched) == 3


@pytest.mark.parametrize(
    ("size", "zoom", "starts"),
    [
        ((1280, 960), 1.0, [0]),
        ((1281, 960), 1.0, [0, 1]),
        ((2368, 96), 1.0, [0, 1088]),
        ((1185, 48), 2.0, [0, 545, 1090]),
        ((640, 1728), 1.0, [0, 768]),
        ((640, 1729), 1.0, [0, 384, 769]),
    ],
)
def test_a_frame_is_searched_in_parts_that_overlap(size: tuple[int, int], zoom: float, starts: list[int]) -> None:
    parts = _parts(size, zoom, np.array([0.0, 0]))
    whole = round(size[0] * zoom), round(size[1] * zoom)
    axis = int(whole[1] > 960)
    assert [(part.x_px, part.y_px)[axis] for part in parts] == starts
    assert {(part.width_px, part.height_px) for part in parts} == {(min(whole[0], 1280), min(whole[1], 960))}


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
    [moved(0, 0, 1.45), moved(0, 0, 0.68), np.array([[1.0, 0, 0], [0, 1, 0], [-0.02, 0.01, 1]]), moved(0, 46)],
    ids=["grown", "shrunk", "folded", "elsewhere"],
)
def test_a_pose_of_another_size_shape_or_place_is_none(pose: Array) -> None:
    track = begun(Seen([pose, moved(0, 0, 1.35)]), moved(0, 0))
    assert track.follow(FRAME) is None
    assert track.follow(FRAME) is not None


def test_features_that_move_otherwise_lose_their_weight_and_the_others_keep_theirs() -> None:
    seen = Seen([moved(n, 0) for n in range(6)], left_out=(3, 4))
    track = begun(seen, moved(0, 0))
    for _ in range(4):
        track.follow(FRAME)
    # Once the object is known to move otherwise, that stays so.
    seen.left_out = seen.left_out[:0]
    for _ in range(2):
        track.follow(FRAME)
    assert seen.moves == [False] + [True] * 5
    # After two frames they are believed to be ground.
    assert [sorted(np.flatnonzero(weight == 0)) for weight in seen.weights] == [[]] * 2 + [[3, 4]] * 4
    assert all(weight[0] == 1 for weight in seen.weights)


def test_blocks_of_the_first_view_and_then_of_the_last_are_tried_where_features_fail() -> None:
    seen = Seen([moved(1, 0), moved(2, 0), None])
    track = begun(seen, moved(0, 0))
    for _ in range(2):
        track.follow(FRAME)
    assert seen.by_blocks == []
    track.follow(FRAME)
    assert [view.in_frame[0, 2] for view in seen.by_blocks] == [0, 2]


@pytest.mark.parametrize(
    ("place", "sees_surroundings", "says"),
    [
        (None, True, "not found yet"),
        (moved(5000, 0), True, "left the frame"),
        (moved(50, 50, 0.1), True, "only 9 px large"),
        (moved(50, 50), False, "the picture changed altogether"),
        (moved(50, 50), True, "lost: hidden, blurred or turned, fewer than 6 of 20 features agree"),
    ],
)
def test_why_an_object_is_lost_is_said(place: Any, sees_surroundings: bool, says: str) -> None:
    seen = Seen([place, None])
    seen.sees_surroundings = sees_surroundings
    track = begun(seen, place)
    for _ in range(2):
        track.follow(FRAME)
    assert says in track.explain(FRAME)
