"""Layouts that are fitted to known places as well as to ties, against exact poses."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np

from golden_model.arrays import Array
from skymosaic.flight.layout.layout import Layout, lay_out
from skymosaic.flight.linking.links import Link
from skymosaic.flight.mapping.anchoring import Observation, anchor
from skymosaic.geometry.homography import apply

SIZE, STRIP, STEP_PX = (1000, 800), 24, 300.0
MIDDLE = (np.array(SIZE) - 1) / 2


def bent_strip() -> tuple[list[Any], Layout]:
    """A strip whose links turn a little, each in the same direction, as an unknown lens makes them."""
    rng = np.random.default_rng(0)
    views: list[Any] = [SimpleNamespace(size=SIZE, working_size=SIZE)] * STRIP
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
