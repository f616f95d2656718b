import itertools

import numpy as np
import pytest

from golden_model.arrays import Array
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.mesh import Mesh
from skymosaic.compositing.warp import Canvas, CanvasError, footprint, nearness, outline
from skymosaic.geometry.homography import apply
from skymosaic.imagery.parcel import Parcel

IMAGE = np.full((300, 400), 90, np.uint8)
# Looks along y: rows above 60 show the sky.
HORIZON = np.array([[-1.0, 0, 0], [0, 0.5, 0], [0, 1 / 60, -1]])


def enlarged(factor: float, x: float = 0, y: float = 0) -> Array:
    return np.array([[factor, 0, x], [0, factor, y], [0, 0, 1]])


def test_the_finer_of_two_photographs_shows_all_but_its_margin() -> None:
    coarse, fine = Layer(IMAGE, enlarged(4)), Layer(IMAGE, enlarged(1, 600, 450))
    part = fine.footprint
    finer = fine.claim(part) > coarse.claim(part)
    assert finer[40:-40, 40:-40].all()
    assert not finer[0].any()
    alike = Layer(IMAGE, enlarged(1.0, 610, 450)).claim(part)
    # Of photographs with the same detail, the one whose border is farther shows the ground, as ever.
    assert ((fine.claim(part) >= alike) == (fine.border_distance(part) >= alike)).all()


def test_a_mask_that_hides_nothing_changes_no_distance() -> None:
    whole, masked = (Layer(IMAGE, enlarged(1), visible=mask) for mask in (None, np.full(IMAGE.shape, 255, np.uint8)))
    distance = whole.border_distance(whole.footprint)
    np.testing.assert_array_equal(distance, masked.border_distance(whole.footprint))
    np.testing.assert_array_equal(distance, distance[::-1, ::-1])


@pytest.mark.parametrize("with_seam", [False, True])
def test_a_mask_and_the_border_bend_with_the_photograph(with_seam: bool) -> None:
    image = np.tile(np.arange(200, dtype=np.uint8), (150, 1))
    visible = np.where(image < 120, np.uint8(255), np.uint8(0))
    # Each pixel is read 7 px to the right, so all that is seen moves to the left.
    mesh = Mesh((200, 150), np.broadcast_to([7.0, 0.0], (3, 4, 2)).copy())
    part = Canvas(0, 0, 200, 150)
    seam = SeamMask(Parcel(np.full((150, 200), 255, np.uint8)), part, 1.0) if with_seam else None
    masked, whole = (Layer(image, np.eye(3), visible=mask, seam=seam, mesh=mesh) for mask in (visible, None))
    assert (masked.pixels(part)[:, :190] == image[:, :190] + 7).all()
    assert np.flatnonzero(masked.claim(part)[75]).tolist() == list(range(113))
    # Beyond the border, the photograph has nothing to show.
    assert np.flatnonzero(whole.claim(part)[75]).tolist() == list(range(193))
    inside = Canvas(60, 40, 30, 30)
    np.testing.assert_array_equal(whole.claim(inside), whole.claim(part)[inside.within(part)])


def test_detail_falls_towards_the_horizon() -> None:
    tilted = np.array([[1.0, 0, 0], [0, 1, 0], [0, 1 / 600, 1]])
    layer = Layer(IMAGE, tilted)
    detail = layer.claim(layer.footprint) / np.maximum(layer.border_distance(layer.footprint), 1e-9)
    for x, y in ((200.0, 50.0), (200.0, 250.0)):
        steps = apply(tilted, [(x, y), (x + 0.01, y), (x, y + 0.01)])
        area = abs(np.linalg.det((steps[1:] - steps[0]) / 0.01))
        column, row = np.rint(steps[0]).astype(int) - (layer.footprint.x_px, layer.footprint.y_px)
        assert detail[row, column] == pytest.approx(area**-0.5, rel=0.02)


def test_nothing_is_shown_that_is_too_far_from_the_camera() -> None:
    size = (400, 300)
    with pytest.raises(CanvasError, match="behind the camera"):
        footprint(size, HORIZON)
    near = nearness(size, HORIZON, np.array([[0.0, 299], [0, 60], [0, 0]]))
    np.testing.assert_allclose(near, [1, 0, -60 / 239], atol=1e-12)
    layer = Layer(IMAGE, HORIZON, least_nearness=0.25)
    corners = outline(size, HORIZON, 0.25)
    assert corners[:, 1].min() == pytest.approx(60 + 0.25 * 239)
    assert len(corners) == 4
    around = layer.footprint.grown(50)
    columns, rows = np.meshgrid(
        *(np.arange(n) + start for n, start in ((around.width_px, around.x_px), (around.height_px, around.y_px)))
    )
    seen = apply(np.linalg.inv(HORIZON), np.stack([columns, rows], axis=-1))
    expected = (seen[..., 1] > corners[:, 1].min()) & (seen[..., 1] <= 299) & (np.abs(seen[..., 0] - 199.5) <= 199.5)
    shown = layer.claim(around) > 0
    assert (shown != expected).mean() < 0.01


def test_a_seam_touches_the_parts_in_which_it_shows_and_none_far_from_them() -> None:
    mask = np.zeros((30, 40), np.uint8)
    mask[10:14, 20:25] = 255
    seam = SeamMask(Parcel(mask), Canvas(-10, 5, 40, 30), 0.1)
    shown, found = Canvas(100, 150, 50, 40), set()
    for x, y in itertools.product(range(-60, 300, 7), range(0, 350, 7)):
        part = Canvas(x, y, 90, 70)
        if part.intersection(shown.grown(5)):
            assert seam.touches(part), part
        elif part.intersection(shown.grown(30)) is None:
            assert not seam.touches(part), part
        found.add(seam.touches(part))
    assert found == {True, False}
