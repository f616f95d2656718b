import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.compositing.mesh import CHECK_CELLS, Frame, Mesh, Ties, fit_meshes
from skymosaic.geometry.homography import apply

SIZE = (640, 480)
HOMOGRAPHY = np.array([[1.0, 0.02, -200], [-0.02, 1, 10], [0, 0, 1]])
FRAMES = {0: Frame(SIZE, HOMOGRAPHY), 1: Frame(SIZE, np.eye(3))}
Points = NDArray[np.float64]


def fit(left: Points, right: Points, *, always: bool = True) -> Mesh | None:
    """The mesh of the left of two images."""
    return fit_meshes(FRAMES, [Ties(0, 1, left, right)], [0], always=always)[0].get(0)


def shares(left: Points, right: Points) -> tuple[float, float]:
    return fit_meshes(FRAMES, [Ties(0, 1, left, right)], [0], always=False)[1]


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
    mesh = fit(left, right)
    bent = apply(np.linalg.inv(HOMOGRAPHY), right[correct])
    before = np.linalg.norm(bent - left[correct], axis=1)
    after = np.linalg.norm(bent + mesh.displacement(bent) - left[correct], axis=1)
    assert before.max() > 5
    assert np.percentile(after, 95) < 0.85
    # On top of the hill, wrong matches beside right ones would hold it back.
    assert -6 < mesh.displacement(np.array([[400.0, 240.0]]))[0, 0] < -5.4
    assert np.abs(mesh.displacement(np.array([[5.0, 240.0]]))).max() < 1.5  # no matches there


def test_held_out_matches_decide() -> None:
    left, right, _ = matches()
    plain, bent = shares(left, right)
    assert bent > plain + 0.1
    assert fit(left, right, always=False) is not None
    flat_left, flat_right, _ = matches(bulge_px=0.0)
    plain, bent = shares(flat_left, flat_right)
    assert bent > plain - 0.01  # nothing is lost on flat ground
    assert fit(flat_left, flat_right, always=False) is None


def test_few_matches_give_no_grid() -> None:
    left, right, _ = matches(count=20)
    assert fit(left, right) is None
    assert fit(left, right, always=False) is None


@pytest.mark.parametrize("few", [0, 20])
def test_matches_on_the_fields_of_one_colour_cannot_be_held_out(few: int) -> None:
    left, right, _ = matches(bulge_px=8.0)
    light = np.floor(apply(HOMOGRAPHY, left) / SIZE[0] * CHECK_CELLS).astype(int).sum(axis=1) % 2 == 0
    for side in (light, ~light):
        chosen = np.concatenate([np.flatnonzero(side), np.flatnonzero(~side)[:few]])
        assert fit(left[chosen], right[chosen]) is not None
        assert shares(left[chosen], right[chosen]) == (0.0, 0.0)
        assert fit(left[chosen], right[chosen], always=False) is None


def test_bending_undoes_the_relief_at_any_size() -> None:
    left, right, _ = matches()
    mesh = fit(left, right)
    noise = np.random.default_rng(1).integers(0, 256, (SIZE[1], SIZE[0]), dtype=np.uint8)
    texture = cv2.GaussianBlur(noise, (0, 0), 3)
    assert mesh.apply(texture).shape == texture.shape
    large = cv2.resize(texture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    small_again = cv2.resize(mesh.apply(large), SIZE, interpolation=cv2.INTER_AREA)
    inner = (slice(20, -20), slice(20, -20))
    assert np.abs(small_again[inner].astype(int) - mesh.apply(texture)[inner]).mean() < 2


def test_a_point_is_found_where_the_warped_image_shows_it() -> None:
    left, right, _ = matches(bulge_px=10.0)
    mesh = fit(left, right)
    assert mesh is not None
    shown = mesh.find(left)
    assert np.abs(shown - left).max() > 5
    assert shown + mesh.displacement(shown) == pytest.approx(left, abs=0.05)


def test_both_of_two_images_share_what_brings_them_together() -> None:
    left, right, correct = matches(wrong=0.0)
    meshes, _ = fit_meshes(FRAMES, [Ties(0, 1, left, right)], [0, 1], always=True)
    moved = [mesh.find(points) for mesh, points in zip((meshes[0], meshes[1]), (left, right), strict=True)]
    off = np.linalg.norm(apply(HOMOGRAPHY, moved[0]) - moved[1], axis=1)
    assert np.percentile(off[correct], 95) < 1.2
    most = [np.linalg.norm(mesh.nodes_px, axis=2).max() for mesh in meshes.values()]
    assert min(most) > 0.6 * max(most)
