import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.compositing.mesh import CHECK_CELLS, fit_mesh, fit_useful_mesh, held_out_shares
from skymosaic.geometry.homography import apply

SIZE = (640, 480)
HOMOGRAPHY = np.array([[1.0, 0.02, -200], [-0.02, 1, 10], [0, 0, 1]])


def matches(
    count: int = 500, bulge_px: float = 6.0, wrong: float = 0.1, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool]]:
    """Matches under a homography, displaced by a smooth hill; a tenth are wrong."""
    rng = np.random.default_rng(seed)
    left = rng.uniform((200, 0), SIZE, (count, 2))
    hill = np.exp(-(((left - (400, 240)) / 110) ** 2).sum(axis=1))
    right = apply(HOMOGRAPHY, left + np.outer(hill, [bulge_px, 0])) + rng.normal(0, 0.3, left.shape)
    stray = rng.uniform(size=count) < wrong
    right[stray] = rng.uniform((0, 0), SIZE, (stray.sum(), 2))
    return left, right, ~stray


def test_the_grid_follows_the_relief_and_ignores_wrong_matches() -> None:
    left, right, correct = matches()
    mesh = fit_mesh(HOMOGRAPHY, left, right, SIZE)
    bent = apply(np.linalg.inv(HOMOGRAPHY), right[correct])
    before = np.linalg.norm(bent - left[correct], axis=1)
    after = np.linalg.norm(bent + mesh.displacement(bent) - left[correct], axis=1)
    assert before.max() > 5
    assert np.percentile(after, 95) < 1.2
    assert np.abs(mesh.displacement(np.array([[5.0, 240.0]]))).max() < 1.5  # no matches there


def test_held_out_matches_decide() -> None:
    left, right, _ = matches()
    plain, bent = held_out_shares(HOMOGRAPHY, left, right, SIZE)
    assert bent > plain + 0.1
    assert fit_useful_mesh(HOMOGRAPHY, left, right, SIZE) is not None
    flat_left, flat_right, _ = matches(bulge_px=0.0)
    plain, bent = held_out_shares(HOMOGRAPHY, flat_left, flat_right, SIZE)
    assert bent > plain - 0.01  # nothing is lost on flat ground
    assert fit_useful_mesh(HOMOGRAPHY, flat_left, flat_right, SIZE) is None


def test_few_matches_give_no_grid() -> None:
    left, right, _ = matches(count=20)
    assert fit_mesh(HOMOGRAPHY, left, right, SIZE) is None
    assert fit_useful_mesh(HOMOGRAPHY, left, right, SIZE) is None


@pytest.mark.parametrize("few", [0, 20])
def test_matches_on_the_fields_of_one_colour_cannot_be_held_out(few: int) -> None:
    left, right, _ = matches(bulge_px=8.0)
    light = np.floor(left / SIZE * CHECK_CELLS).astype(int).sum(axis=1) % 2 == 0
    for side in (light, ~light):
        chosen = np.concatenate([np.flatnonzero(side), np.flatnonzero(~side)[:few]])
        assert fit_mesh(HOMOGRAPHY, left[chosen], right[chosen], SIZE) is not None
        assert held_out_shares(HOMOGRAPHY, left[chosen], right[chosen], SIZE) == (0.0, 0.0)
        assert fit_useful_mesh(HOMOGRAPHY, left[chosen], right[chosen], SIZE) is None


def test_bending_undoes_the_relief_at_any_size() -> None:
    left, right, _ = matches()
    mesh = fit_mesh(HOMOGRAPHY, left, right, SIZE)
    noise = np.random.default_rng(1).integers(0, 256, (SIZE[1], SIZE[0]), dtype=np.uint8)
    texture = cv2.GaussianBlur(noise, (0, 0), 3)
    assert mesh.apply(texture).shape == texture.shape
    large = cv2.resize(texture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    small_again = cv2.resize(mesh.apply(large), SIZE, interpolation=cv2.INTER_AREA)
    inner = (slice(20, -20), slice(20, -20))
    assert np.abs(small_again[inner].astype(int) - mesh.apply(texture)[inner]).mean() < 2
