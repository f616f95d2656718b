"""Links of a live mosaic that the chip alone gives: a homography record for each frame and the one before it."""

import dataclasses

import numpy as np

from golden_model.arrays import Pixels, Records
from golden_model.config import Config
from sim.backends.interface import Backend
from skymosaic.flight.linking.links import Candidate, Link
from skymosaic.geometry.fabric import draw_config, homography_in_pixels
from skymosaic.geometry.homography import apply, grid_over
from skymosaic.registration.extraction import extract_within_capacity

GRID = 12
"""Points along each side of a frame."""


class RecordChain:
    """Has a front end that estimates homographies process each frame together with the one before it; keeps their link.

    ``seed`` gives the seed of the estimator's samples.
    """

    def __init__(self, front_end: Backend, config: Config, seed: int) -> None:
        self._front_end = front_end
        self._config = dataclasses.replace(config, estimator=draw_config(np.random.default_rng(seed)))
        self._before: tuple[int, Pixels] | None = None
        self._newest: Link | None = None

    def describe(self, number: int, working: Pixels) -> Records:
        """Process the next frame, and return its features."""
        before = [] if self._before is None else [self._before[1]]
        results, _ = extract_within_capacity(self._front_end, [*before, working], self._config)
        record = results[-1].homography
        if self._before is not None and record is not None:
            self._newest = link_by_record((self._before[0], number), record, self._before[1], working)
        self._before = number, working
        return results[-1].features

    def link(self, pair: Candidate) -> Link:
        """The link of two frames; it holds only for the newest frame and the one before, if the chip accepts it."""
        newest = self._newest
        return newest if newest and (newest.left, newest.right) == pair else _no_link(pair)


def link_by_record(pair: Candidate, record: np.void, left: Pixels, right: Pixels) -> Link:
    """Link two frames by a homography record from left to right alone: its ties are a grid of points that both show.

    Of the frames only the sizes are used.
    """
    homography = homography_in_pixels(record)
    if homography is None:
        return _no_link(pair)
    left_points = grid_over((left.shape[1], left.shape[0]), GRID)
    right_points = apply(homography, left_points)
    shown = ((right_points >= 0) & (right_points <= (right.shape[1] - 1, right.shape[0] - 1))).all(axis=1)
    inliers = int(record["inliers"])
    return Link(*pair, left_points[shown], right_points[shown], inliers, near=inliers)


def _no_link(pair: Candidate) -> Link:
    return Link(*pair, np.zeros((0, 2)), np.zeros((0, 2)), inliers=0, near=0)
