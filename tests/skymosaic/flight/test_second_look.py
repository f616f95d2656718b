from dataclasses import replace

import numpy as np
import pytest

from sim.scene import Flight, make_lawnmower
from skymosaic import mosaic
from skymosaic.flight import survey
from skymosaic.geometry.homography import apply

SIZE, RATIO = (800, 600), 3


@pytest.fixture(scope="module")
def flight() -> Flight:
    """Every second photograph is taken from three times the height."""
    level = make_lawnmower(3, 4, SIZE, forward_overlap=0.6)
    poses = (
        replace(pose, altitude_px=pose.altitude_px * (RATIO if n % 2 else 1)) for n, pose in enumerate(level.poses)
    )
    return replace(level, poses=tuple(poses))


def test_photographs_of_two_heights_become_one_mosaic(flight: Flight) -> None:
    result = mosaic(list(flight.images))
    assert result.placed == (0, 1, 2, 3)
    grid = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 9), np.linspace(0, SIZE[1] - 1, 9)), -1).reshape(-1, 2)
    for near, far in ((0, 1), (2, 1), (2, 3)):
        true = apply(flight.homography_between(near, far), grid)
        found = apply(np.linalg.inv(result.transforms[far]) @ result.transforms[near], grid)
        assert np.median(np.linalg.norm(found - true, axis=1)) < 0.5


@pytest.mark.slow
def test_links_across_heights_are_what_joins_them(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(survey, "link_across_heights", lambda *_: {})
    assert len(mosaic(list(flight.images)).left_out) == 2
