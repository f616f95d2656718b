"""Layouts that are fitted to known places as well as to ties, against exact poses."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from golden_model.arrays import Array
from skymosaic.flight.layout.layout import Layout, lay_out
from skymosaic.flight.linking.links import Link
from skymosaic.flight.mapping.anchoring import Observation, _observe, anchor
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import Metadata, Position
from tests.skymosaic.flight.mapping.test_contradictions import SIZE as FLOWN_SIZE
from tests.skymosaic.flight.mapping.test_contradictions import STEPS, flown, taken_above

SIZE, STRIP, STEP_PX = (1000, 800), 24, 300.0
MIDDLE = (np.array(SIZE) - 1) / 2


def bent_strip() -> tuple[list[Any], Layout]:
    """A strip whose links turn a little, each in the same direction, as an unknown lens makes them."""
    rng = np.random.default_rng(0)
    views: list[Any] = [SimpleNamespace(size=SIZE, orientation=1, working_size=SIZE)] * STRIP
    links = []
    for left in range(STRIP - 1):
        for right in (left + 1, left + 2):
            if right < STRIP:
                points = rng.uniform((STEP_PX * (right - left), 0), SIZE, (60, 2))
                turned = 2e-4 * (right - left)
                turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
                moved = (points - (STEP_PX * (right - left), 0) - MIDDLE) @ turn.T + MIDDLE
                links.append(Link(left, right, points, moved + rng.normal(0, 0.3, points.shape), 60, 60))
    return views, lay_out(views, range(STRIP), links)


def middles(layout: Layout) -> Array:
    return np.array([apply(layout.transforms[view], MIDDLE) for view in range(STRIP)])


def true_places(layout: Layout) -> Array:
    return MIDDLE + STEP_PX * (np.arange(STRIP) - layout.reference)[:, None] * [1, 0]


@pytest.mark.parametrize(("accuracy_m", "sigma_px"), [(0.5, 5.0), (0.001, 0.1), (None, 0.1)])
def test_what_is_known_of_cameras_is_as_exact_as_they_record(accuracy_m: float | None, sigma_px: float) -> None:
    """Of 0.1 m per pixel: at best 1 cm. Without a record it is the misfit, which is none here."""
    flight, layout = flown()
    middle = (np.array(FLOWN_SIZE) - 1) / 2
    for view, step in zip(flight.views, STEPS, strict=True):
        view.taken = taken_above(*(middle + step), accuracy_m=accuracy_m)
        view.to_original, view.working_size = np.eye(3), view.size
    layout.reference, layout.transforms = 0, layout.to_reference(None)
    # Photographs without a position say nothing.
    flight.views[3].taken = Metadata()
    observed = list(_observe(flight, layout, None))
    assert [each.view for each in observed] == [view for view in range(12) if view != 3]
    np.testing.assert_allclose([each.point for each in observed], [middle] * 11, atol=1e-3)
    places = [middle + STEPS[each.view] for each in observed]
    np.testing.assert_allclose([each.place for each in observed], places, atol=0.02)
    assert [each.sigma_px for each in observed] == pytest.approx([sigma_px] * 11, rel=1e-3)


def test_one_position_that_the_map_cannot_show_leaves_the_others_their_part() -> None:
    flight, layout = flown()
    for view, step in zip(flight.views, STEPS, strict=True):
        view.taken = taken_above(*((np.array(FLOWN_SIZE) - 1) / 2 + step))
        view.to_original, view.working_size = np.eye(3), view.size
    layout.reference, layout.transforms = 0, layout.to_reference(None)
    places = [each.place for each in _observe(flight, layout, None)]
    flight.views[0].taken = Metadata(position=Position(0.0, -2.0))
    far, *others = [each.place for each in _observe(flight, layout, None)]
    np.testing.assert_allclose(others, places[1:], atol=0.01)
    assert 1e7 < np.linalg.norm(far - places[0]) < 1e8 * np.sqrt(2)


def test_positions_straighten_a_strip_that_ties_bend() -> None:
    views, layout = bent_strip()
    bend_px = np.abs(middles(layout) - true_places(layout)).max()
    assert bend_px > 5
    noise = np.random.default_rng(1).normal(0, 1.0, (STRIP, 2))
    places = true_places(layout) + noise
    # One receiver lost its satellites.
    places[5] += 400
    observations = [Observation(view, MIDDLE, place, 1.0) for view, place in enumerate(places)]
    anchored = anchor(layout, views, observations)
    assert np.abs(middles(anchored) - true_places(layout)).max() < 0.4 * bend_px
    assert np.median(np.concatenate(anchored.errors_px)) < 0.6
    coarse = anchor(layout, views, [dataclasses.replace(each, sigma_px=1000.0) for each in observations])
    np.testing.assert_allclose(middles(coarse), middles(layout), atol=0.5)
