"""Templates, blocks, motion and the files of a track."""

import json
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from sim.scene import render_ground
from skymosaic.geometry.homography import apply
from skymosaic.geometry.model_selection import fit
from skymosaic.tracking.blocks import BORDER_PX, match_blocks
from skymosaic.tracking.motion import Matches, fit_object, fit_surroundings
from skymosaic.tracking.output import make_row, save_corners
from skymosaic.tracking.template import MARGIN_PX, Roi, Template
from skymosaic.tracking.tracker import TrackedFrame


@pytest.mark.parametrize(
    ("sides", "zoom"), [((64, 64), 2.0), ((32, 128), 2.0), ((128, 128), 1.0), ((200, 150), 1.0), ((1024, 256), 0.5)]
)
def test_a_view_shows_an_object_at_a_size_that_has_features(sides: tuple[int, int], zoom: float) -> None:
    nothing: Any = None
    template = Template(np.zeros((300, 1100), np.uint8), Roi(20, 30, *sides), nothing, nothing)
    assert template.zoom == pytest.approx(zoom)
    shown = template.first_view.picture.shape[1::-1]
    assert shown == tuple(round(zoom * side) + 2 * MARGIN_PX for side in sides)
    # The middles of its first and its last pixel, with the surroundings around it.
    middle, corner = apply(template._to_view, np.array([np.subtract(sides, 1) / 2, [-0.5, -0.5]]))
    np.testing.assert_allclose(middle, (np.array(shown) - 1) / 2, atol=0.51)
    weight = template._weight_at(np.array([middle, corner, corner - 0.01]))
    np.testing.assert_allclose(weight, [1, np.exp(-2), 0], atol=1e-9)
    np.testing.assert_allclose(template.in_picture @ [0, 0, 1], [20, 30, 1])


SIDE_PX, SHIFT_PX = 200, (20, -12)


@pytest.fixture(scope="module")
def ground() -> Pixels:
    return render_ground(5, SIDE_PX + 100, SIDE_PX + 100)


def cut(ground: Pixels, x: int, y: int) -> Pixels:
    return ground[y : y + SIDE_PX, x : x + SIDE_PX]


MIDDLES = np.stack(np.meshgrid(*2 * [np.arange(BORDER_PX, SIDE_PX - BORDER_PX, 8.0)]), axis=-1).reshape(-1, 2)


def test_blocks_are_found_where_they_went_and_not_on_other_ground(ground: Pixels) -> None:
    x, y = 50 - SHIFT_PX[0], 50 - SHIFT_PX[1]
    before, now = match_blocks(cut(ground, 50, 50), (0.6 * cut(ground, x, y) + 30).astype(np.uint8), MIDDLES)
    assert len(before) > 0.9 * len(MIDDLES)
    np.testing.assert_allclose(now - before, np.broadcast_to(SHIFT_PX, now.shape), atol=2)
    # Their middles lie between pixels of the reduced picture, so a pixel of this one beside an even place.
    off_px = (before[:, None] - MIDDLES).reshape(-1, 2)
    assert {-1} == set(off_px[np.abs(off_px).max(axis=1) < 4].ravel())
    before, _ = match_blocks(cut(ground, 0, 0), cut(render_ground(8, SIDE_PX, SIDE_PX), 0, 0), MIDDLES)
    assert len(before) < len(MIDDLES) / 2
    flat = cv2.rectangle(cut(ground, 0, 0).copy(), (0, 0), (SIDE_PX, SIDE_PX // 2), (90, 90, 90), cv2.FILLED)
    before, _ = match_blocks(flat, flat, MIDDLES)
    assert before[:, 1].min() > SIDE_PX // 2 - 8


STILL = np.eye(3)
GROUND = np.array([[1.0, 0, 20], [0, 1, 5], [0, 0, 1]])
OBJECT = np.array([[0.0, -1, 300], [1, 0, -20], [0, 0, 1]])


def make_matches(*motions: Array, each: int = 20, outside: int = 0) -> Matches:
    """Matches of each motion; the last ``outside`` ones are of the surroundings."""
    left = np.random.default_rng(4).uniform(0, 200, (each * len(motions), 2))
    right = np.concatenate(
        [apply(motion, part) for motion, part in zip(motions, np.split(left, len(motions)), strict=True)]
    )
    is_outside = np.arange(len(left)) >= len(left) - outside
    return Matches(left, right, np.where(is_outside, 0.0, 1.0), is_outside)


def fitted(matches: Matches, expected: Array | None = None) -> tuple[Any, int]:
    around = fit_surroundings(matches)
    find = partial(fit, rng=np.random.default_rng(0))
    best, left_out = fit_object(matches, STILL, around and around.matrix, expected, find, fewest=6)
    return (None if best is None else best.matrix), int(left_out.sum())


def test_ground_and_text_in_the_rectangle_are_left_out() -> None:
    matches = make_matches(OBJECT, GROUND, GROUND, GROUND, each=20, outside=30)
    motion, left_out = fitted(matches)
    np.testing.assert_allclose(motion, OBJECT, atol=1e-6)
    assert left_out == 30
    motion, left_out = fitted(make_matches(OBJECT, STILL, STILL))
    np.testing.assert_allclose(motion, OBJECT, atol=1e-6)
    assert left_out == 40


def test_what_is_the_object_among_ground_and_still_things() -> None:
    of_object, ground = make_matches(OBJECT, each=7), make_matches(GROUND, each=40, outside=20)
    matches = Matches(*(np.concatenate(both) for both in zip(of_object, ground, strict=True)))
    np.testing.assert_allclose(fitted(matches)[0], GROUND, atol=1e-6)
    np.testing.assert_allclose(fitted(matches, OBJECT)[0], OBJECT, atol=1e-6)
    eight = (np.concatenate(both) for both in zip(make_matches(OBJECT, each=8), ground, strict=True))
    np.testing.assert_allclose(fitted(Matches(*eight))[0], OBJECT, atol=1e-6)
    # Hidden, it is not sought on the ground.
    assert fitted(make_matches(GROUND, each=40, outside=20), OBJECT)[0] is None
    motion, left_out = fitted(make_matches(GROUND, GROUND, outside=15))
    np.testing.assert_allclose(motion, GROUND, atol=1e-6)
    assert left_out == 0
    motion, left_out = fitted(make_matches(STILL, GROUND, outside=15), STILL)
    np.testing.assert_allclose(motion, STILL, atol=1e-6)
    assert left_out == 5


def test_what_stands_still_or_is_ground_is_the_object_only_if_most_agree() -> None:
    ground, still = make_matches(GROUND, outside=20), make_matches(STILL, each=10)
    moves_alone = np.random.default_rng(5).uniform(0, 200, (2, 12, 2))
    wrong = Matches(moves_alone[0], moves_alone[1], np.ones(12), np.zeros(12, np.bool_))
    most, few = (
        Matches(*map(np.concatenate, zip(*parts, strict=True))) for parts in ((ground, still), (ground, still, wrong))
    )
    np.testing.assert_allclose(fitted(most)[0], STILL, atol=1e-6)
    assert fitted(few)[0] is None


@pytest.mark.filterwarnings("error")
def test_without_matches_there_is_no_motion() -> None:
    assert fitted(make_matches(OBJECT, each=0), OBJECT) == (None, 0)


def test_ground_is_known_by_a_quarter_of_the_matches_around() -> None:
    ground, wrong = make_matches(GROUND, each=24, outside=24), np.random.default_rng(5).uniform(0, 200, (2, 72, 2))
    others = Matches(wrong[0], wrong[1], np.zeros(72), np.ones(72, np.bool_))
    around = fit_surroundings(Matches(*(np.concatenate(both) for both in zip(ground, others, strict=True))))
    assert around is not None
    np.testing.assert_allclose(around.matrix, GROUND, atol=1)


BLACK = np.zeros((60, 80, 3), np.uint8)
CORNERS = np.array([[10.0004, 20.0], [50.25, 20.0], [50.25, 40.9996], [10.0, 41.0]])
POSE: Any = SimpleNamespace(model="similarity", inliers=9)
SEEN = TrackedFrame(0, BLACK, CORNERS, POSE)
LOST = TrackedFrame(1, BLACK, None, None, "lost: hidden")


def test_a_row_has_corners_or_the_reason_and_files_have_both(tmp_path: Path) -> None:
    rows = [make_row(SEEN, 0.12345678), make_row(LOST, 0.2)]
    assert rows[0].corners == ((10.0, 20.0), (50.25, 20.0), (50.25, 41.0), (10.0, 41.0))
    save_corners(tmp_path / "a.csv", rows)
    assert (tmp_path / "a.csv").read_text() == (
        "frame,seconds,x0,y0,x1,y1,x2,y2,x3,y3,model,inliers,reason\n"
        "0,0.123457,10.0,20.0,50.25,20.0,50.25,41.0,10.0,41.0,similarity,9,\n"
        "1,0.2,,,,,,,,,,0,lost: hidden\n"
    )
    save_corners(tmp_path / "a.JSON", rows)
    seen, lost = json.loads((tmp_path / "a.JSON").read_text())["corners"]
    assert (seen["corners"][2], seen["model"], seen["inliers"]) == ([50.25, 41.0], "similarity", 9)
    assert (lost["corners"], lost["inliers"], lost["reason"]) == (None, 0, "lost: hidden")
