from dataclasses import replace

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
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


@pytest.fixture(scope="module")
def murky() -> list[Pixels]:
    """Two legs over murky ground: soft, of little contrast, lit from ahead."""
    sharp = make_lawnmower(3, 6, (960, 720), forward_overlap=0.7)
    lamp, rng = np.linspace(1.35, 0.65, 720)[:, None, None], np.random.default_rng(0)
    images = []
    for image in sharp.images:
        soft = cv2.GaussianBlur(np.asarray(image, np.float32), (0, 0), 5)
        lit = (90 + 0.12 * (soft - soft.mean())) * lamp + rng.normal(0, 1, soft.shape)
        images.append(np.asarray(np.clip(np.rint(lit), 0, 255), np.uint8))
    return images


def test_soft_ground_is_linked_by_its_coarse_detail(murky: list[Pixels]) -> None:
    assert mosaic(murky, scale=0.2).placed == tuple(range(6))


@pytest.mark.slow
def test_coarse_detail_is_what_links_it(murky: list[Pixels], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(survey, "link_by_coarse_detail", lambda *_: {})
    assert len(mosaic(murky, scale=0.2).placed) < 6
