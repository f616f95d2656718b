"""Matches of somebody else, through the same search, verdict and layout."""

from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from sim.scene import make_lawnmower, make_pair
from skymosaic import mosaic, register
from skymosaic.common.errors import InputError
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import lens_of

SIZE = (320, 240)
Matched = tuple[Array, Array, Array]


def describe_by_sift(image: Pixels) -> Any:
    """Key points and descriptors of another library."""
    return cv2.SIFT.create(4000).detectAndCompute(image, None)


def match_by_sift(left: Pixels, right: Pixels) -> Matched:
    """What another library finds, with its weights."""
    return match(describe_by_sift(left), describe_by_sift(right))


def match(left: Any, right: Any) -> Matched:
    """The matches of `describe_by_sift` for two images."""
    (points, one), (others, other) = left, right
    found = [(a, b) for a, b in cv2.BFMatcher().knnMatch(one, other, k=2) if a.distance < 0.8 * b.distance]
    return (
        np.array([points[a.queryIdx].pt for a, _ in found]),
        np.array([others[a.trainIdx].pt for a, _ in found]),
        np.array([1 - a.distance / b.distance for a, b in found]),
    )


@pytest.mark.parametrize("estimator", ["prosac", "magsac", "fabric"])
def test_matches_of_another_library_register_a_pair(estimator: Any) -> None:
    scene = make_pair(seed=5, size=(640, 480))
    left, right = scene.images
    given = match_by_sift(left, right)
    pair = register(left, right, matches=given, estimator=estimator, working_width_px=400)
    assert pair.confidence is not None
    assert pair.homography is not None
    assert (pair.confidence.verdict, pair.passes, pair.method.detector) == ("good", 1, "given")
    points = pair.points("matches")
    # To a sixteenth of a working pixel.
    np.testing.assert_allclose(points.left, given[0], atol=0.051)
    np.testing.assert_allclose(points.weights, given[2], atol=0.006)
    assert set(points.rules) == {"as given"}
    errors_px = np.linalg.norm(apply(pair.homography, pair.points().left) - pair.points().right, axis=1)
    assert np.median(errors_px) < 0.3


def test_a_flight_takes_them_by_pairs_and_matches_the_others_itself() -> None:
    images = make_lawnmower(1, 4, SIZE).images
    usual = mosaic(images)
    made = mosaic(images, matches={(0, 1): match_by_sift(images[0], images[1])})
    assert made.placed == usual.placed == (0, 1, 2, 3)
    links, before = ({(each.left, each.right): each for each in one.flight.links} for one in (made, usual))
    assert len(links[0, 1].left_points) != len(before[0, 1].left_points)
    np.testing.assert_array_equal(links[1, 2].left_points, before[1, 2].left_points)
    # What is said of one pair by hand is believed no more than what features say.
    shifted = apply(np.array([[1, 0, 40], [0, 1, 0], [0, 0, 1.0]]), match_by_sift(images[0], images[1])[0])
    inside = (shifted[:, 0] < 319) & (shifted[:, 1] < 239)
    wrong = mosaic(images, matches={(0, 2): (shifted[inside], match_by_sift(images[0], images[1])[0][inside])})
    for index in made.placed:
        np.testing.assert_allclose(wrong.transforms[index], usual.transforms[index], atol=3)


def test_two_photographs_with_a_lens_take_matches_of_the_pictures_as_they_are() -> None:
    images = make_pair(seed=5, size=SIZE).images
    camera = {"width_px": 320, "height_px": 240, "focal_x_px": 300, "focal_y_px": 300, "k1": 0.1}
    lens = lens_of(camera | {"centre_x_px": 159.5, "centre_y_px": 119.5})
    given = match_by_sift(*images)
    made = mosaic(images, lens=lens, matches={(0, 1): given})
    (pair,) = made.pairs
    straight = lens.straighten_points(given[0], SIZE)
    assert np.linalg.norm(straight - given[0], axis=1).max() > 1
    # Without those near the border, which shows nothing once it is straight.
    off_px = np.linalg.norm(pair.points("matches").left[:, None] - straight, axis=2).min(axis=1)
    assert len(off_px) > 30
    assert off_px.max() < 0.05


GOOD = np.full((12, 2), 5.0)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ((GOOD,), "give positions"),
        ((GOOD, GOOD[:, :1]), "give positions"),
        ((GOOD, GOOD[:11]), "give positions"),
        ((GOOD, GOOD, GOOD), "give positions"),
        ("matches.txt", "give positions"),
        ((GOOD[:0], GOOD[:0]), "0 matches; give at least 12"),
        ((GOOD[:11], GOOD[:11]), "11 matches; give at least 12, at most 65536"),
        ((GOOD, np.where(np.eye(12, 2), np.nan, GOOD)), "2 of 12 have NaN or infinity; leave them out"),
        ((GOOD, GOOD, np.full(12, 1.5)), "weights 1.5 to 1.5; they must be 0 to 1"),
        ((GOOD, GOOD + np.array([315, 0])), r"12 of 12 lie outside a photograph of 320x240 px"),
    ],
)
def test_what_cannot_be_matches_of_these_photographs_is_said(given: Any, says: str) -> None:
    left, right = make_pair(seed=5, size=SIZE).images
    with pytest.raises(InputError, match=f"^matches: .*{says}"):
        register(left, right, matches=given)
    with pytest.raises(InputError, match=rf"^`matches` \(0, 1\): .*{says}"):
        mosaic([left, right, left[:200]], matches={(0, 1): given})


@pytest.mark.parametrize("pair", [(0, 3), (1, 0), (1, 1), ("a.jpg", "b.jpg"), (0, 1, 2)])
def test_a_pair_is_of_these_photographs(pair: Any) -> None:
    images = make_lawnmower(1, 3, SIZE).images
    with pytest.raises(InputError, match="a pair has the numbers of its photographs, two of 0 to 2, the smaller first"):
        mosaic(images, matches={pair: (GOOD, GOOD)})


@pytest.mark.parametrize("option", [{"detector": "fast"}, {"rules": "none"}, {"backend": "rtl"}, {"effort": "normal"}])
def test_options_of_features_have_no_effect_on_a_given_pair(option: dict[str, Any]) -> None:
    left, right = make_pair(seed=5, size=SIZE).images
    with pytest.raises(InputError, match=f"`{next(iter(option))}` has no effect on matches that are given; leave it"):
        register(left, right, matches=(GOOD, GOOD), **option)
