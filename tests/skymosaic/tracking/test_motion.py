"""Which matches move with an object, on matches whose motions are chosen."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from skymosaic.geometry.homography import apply
from skymosaic.geometry.model_selection import fit
from skymosaic.tracking.motion import Matches, fit_object, fit_surroundings

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


def test_most_of_a_rectangle_may_be_ground() -> None:
    matches = make_matches(OBJECT, GROUND, GROUND, GROUND, each=20, outside=30)
    motion, left_out = fitted(matches)
    np.testing.assert_allclose(motion, OBJECT, atol=1e-6)
    assert left_out == 30


def test_text_that_stands_still_is_left_out() -> None:
    motion, left_out = fitted(make_matches(OBJECT, STILL, STILL))
    np.testing.assert_allclose(motion, OBJECT, atol=1e-6)
    assert left_out == 40


def test_seven_others_are_too_few_until_the_object_is_known_to_move() -> None:
    of_object, ground = make_matches(OBJECT, each=7), make_matches(GROUND, each=40, outside=20)
    matches = Matches(*(np.concatenate(both) for both in zip(of_object, ground, strict=True)))
    np.testing.assert_allclose(fitted(matches)[0], GROUND, atol=1e-6)
    np.testing.assert_allclose(fitted(matches, OBJECT)[0], OBJECT, atol=1e-6)
    eight = (np.concatenate(both) for both in zip(make_matches(OBJECT, each=8), ground, strict=True))
    np.testing.assert_allclose(fitted(Matches(*eight))[0], OBJECT, atol=1e-6)
    # Hidden, it is not sought on the ground.
    assert fitted(make_matches(GROUND, each=40, outside=20), OBJECT)[0] is None


def test_an_object_of_the_ground_keeps_all_its_matches() -> None:
    motion, left_out = fitted(make_matches(GROUND, GROUND, outside=15))
    np.testing.assert_allclose(motion, GROUND, atol=1e-6)
    assert left_out == 0


def test_an_object_that_moves_is_found_while_it_stands_still_in_the_frame() -> None:
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
