from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.config import preset_config
from golden_model.formats import POSITION
from golden_model.front_end import extract
from sim.scene import make_lawnmower
from skymosaic.flight.linking.links import are_right, link_views, tie_views
from skymosaic.geometry.ground import Sight
from skymosaic.geometry.homography import transfer_error


def see(images: Sequence[NDArray[np.uint8]]) -> tuple[Sight, Sight]:
    return Sight(images[0]), Sight(images[1])


def test_matches_on_relief_are_right_and_others_are_not() -> None:
    rng = np.random.default_rng(0)
    plane = np.array([[1.0, 0, 200], [0, 1, 10], [0, 0, 1]])
    left = rng.uniform(0, 1000, (300, 2))
    right = left + np.array([200, 10]) + rng.normal(0, 0.2, left.shape)
    on_relief, false, near_but_false = slice(0, 60), slice(60, 120), slice(120, 140)
    # Parallax moves along the baseline, here to the right and a little down.
    right[on_relief] += rng.uniform(5, 50, (60, 1)) * [1, 0.05]
    right[false] = rng.uniform(0, 1000, (60, 2))
    right[near_but_false] += rng.uniform(5, 50, (20, 1)) * [0.2, 1]
    kept = are_right(left, right, plane)
    assert kept[on_relief].mean() > 0.95
    assert kept[140:].mean() > 0.95
    assert kept[false].mean() < 0.05
    assert kept[near_but_false].mean() < 0.1
    np.testing.assert_array_equal(are_right(left, right, plane), kept)


def test_a_single_tie_links_no_views() -> None:
    points = np.array([[10.0, 20], [300, 40]])
    assert not tie_views((0, 1), points[:1], points[:1], np.eye(3), 12).holds
    assert tie_views((0, 1), points, points, np.eye(3), 12).holds


def test_checks_are_no_ties_and_lie_on_relief_too() -> None:
    config = preset_config("aerial")
    flight = make_lawnmower(3, 4, (640, 480), relief=True)
    features = [extract(image, config.front_end).features for image in flight.images[:2]]
    link = link_views((0, 1), *features, config=config, seed=0, sights=see(flight.images))
    assert link.ties > 2 * len(link.left_checks) > 50
    ties = {tuple(point) for point in link.left_points.tolist()}
    assert ties.isdisjoint(tuple(point) for point in link.left_checks.tolist())
    on_plane = flight.homography_between(0, 1)
    off_px = transfer_error(on_plane, link.left_checks, link.right_checks)
    assert off_px.max() > 3
    assert len(link.left_relief) > len(link.left_checks) / 20
    assert transfer_error(on_plane, link.left_relief, link.right_relief).min() > 2
    # What shapes meshes is no tie, and no check of what they gain.
    others = ties | {tuple(point) for point in link.left_checks.tolist()}
    assert others.isdisjoint(tuple(point) for point in link.left_relief.tolist())
    again = type(link).unpack(link.pack(), 0, 1)
    np.testing.assert_array_equal(again.right_checks, link.right_checks)


def test_twins_of_features_are_told_apart_near_the_place_that_a_layout_predicts() -> None:
    config = preset_config("aerial")
    flight = make_lawnmower(3, 4, (480, 360))
    left, right = (extract(image, config.front_end).features for image in flight.images[:2])
    how: dict[str, Any] = {"config": config, "seed": 0, "sights": see(flight.images)}
    twins, rng = right.copy(), np.random.default_rng(0)
    for axis in ("x", "y"):
        twins[axis] += rng.integers(40, 200, len(twins), np.uint16) * POSITION.one
    # The first of equal descriptors is taken.
    right = np.concatenate([twins, right])
    assert not link_views((0, 1), left, right, **how).holds
    truth = flight.homography_between(0, 1)
    off = np.array([[1.0, 0, 15], [0, 1, -20], [0, 0, 1]])
    link = link_views((0, 1), left, right, **how, predicted=off @ truth)
    assert link.ties > 2 * len(link.left_checks) > 50
    for points in ((link.left_points, link.right_points), (link.left_checks, link.right_checks)):
        assert np.median(transfer_error(truth, *points)) < 0.5
    # Farther than the search, nothing is found, however well it would match.
    farther = np.array([[1.0, 0, 30], [0, 1, -30], [0, 0, 1]])
    assert not link_views((0, 1), left, right, **how, predicted=farther @ truth).holds
