"""Layers, seams, palettes and tones of a mosaic."""

import itertools

import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Float32, Pixels
from sim.scene import Camera, CameraPose
from skymosaic.compositing.layer import Layer, SeamMask
from skymosaic.compositing.mesh import Mesh
from skymosaic.compositing.palette import have_palette
from skymosaic.compositing.seams import find_allowed
from skymosaic.compositing.tone import Tone
from skymosaic.compositing.warp import Canvas, CanvasError, enclosing, footprint, nearness, outline
from skymosaic.geometry.homography import apply
from skymosaic.imagery.depth import measure_clipped
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


@pytest.mark.parametrize(
    ("value", "side_px", "left"),
    [(255, 8, 0.01), (254, 8, 0.01), (253, 8, 1), (1, 8, 0.01), (2, 8, 1), (255, 4, 5 / 9)],
)
def test_what_is_clipped_hardly_claims_its_ground(value: int, side_px: int, left: float) -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    # White in one channel is enough, of black all are.
    image[120 : 120 + side_px, 160 : 160 + side_px, 1 if value > 90 else slice(None)] = value
    plain = np.full_like(image, 90)
    part = Canvas(100, 100, 80, 60)
    whole = Layer(plain, np.eye(3)).claim(part)
    # As the whole photograph says, where a thumbnail that averages it does not show it.
    for layer in (Layer(image, np.eye(3)), Layer(plain, np.eye(3), clipped=measure_clipped(image))):
        share = layer.claim(part) / whole
        assert share[24, 64] == pytest.approx(left, rel=0.01)
        assert share[40, 64] == pytest.approx(1)
        assert (share > 0).all()


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
            assert seam.shown_part(part), part
        elif part.intersection(shown.grown(30)) is None:
            assert not seam.shown_part(part), part
        found.add(seam.shown_part(part) is not None)
    assert found == {True, False}


CAMERA = Camera(width_px=160, height_px=120, focal_px=128)


def seen(pose: CameraPose, camera: Camera = CAMERA) -> Layer:
    """A photograph of nothing, where the camera would take it."""
    image = np.zeros((camera.height_px, camera.width_px, 3), np.uint8)
    return Layer(image, np.asarray(np.linalg.inv(pose.homography(camera)), np.float64))


def hovering(count: int) -> list[Layer]:
    rng = np.random.default_rng(count)
    return [
        seen(CameraPose(x_px=x, y_px=y, altitude_px=128 * rng.normal(1, 0.01), heading_deg=rng.normal(0, 1.5)))
        for x, y in rng.normal(0, 3, (count, 2)).tolist()
    ]


@pytest.mark.parametrize("count", [100, 400])
def test_of_many_photographs_of_one_place_few_reach_the_seam_finder(count: int) -> None:
    layers = hovering(count)
    needed = list(find_allowed(layers))
    assert needed == sorted(set(needed))
    assert 5 <= len(needed) <= 40
    # No ground is lost, and the sum of all that has left owned little.
    whole = enclosing([layer.footprint for layer in layers])
    shown, left = (np.zeros((whole.height_px, whole.width_px)) for _ in range(2))
    for number, layer in enumerate(layers):
        claims = shown if number in needed else left
        where = layer.footprint.within(whole)
        claims[where] = np.maximum(claims[where], layer.claim(layer.footprint))
    assert (shown[left > 0] >= 0.6 * left[left > 0]).all()


def test_a_photograph_that_alone_shows_a_corner_stays() -> None:
    whole, small = seen(CameraPose(x_px=0, y_px=0, altitude_px=128)), Camera(width_px=100, height_px=80, focal_px=128)
    inside, beyond = (seen(CameraPose(x_px=0, y_px=y, altitude_px=128, heading_deg=30), small) for y in (0, 3))
    assert list(find_allowed([whole, inside])) == [0]
    assert 0 < (beyond.claim(beyond.footprint) > whole.claim(beyond.footprint)).sum() < 0.01 * 100 * 80
    assert list(find_allowed([whole, beyond])) == [0, 1]


def soil(seed: int, sigmas: tuple[float, ...] = (2, 8, 30)) -> Float32:
    """A quantity (240, 320) from 0 to 1, smooth and fine."""
    rng = np.random.default_rng(seed)
    total = np.zeros((240, 320), np.float32)
    for sigma in sigmas:
        layer = cv2.GaussianBlur(rng.standard_normal(total.shape).astype(np.float32), (0, 0), sigma)
        total += layer / layer.std()
    return cv2.normalize(total, None, 0, 1, cv2.NORM_MINMAX)


def compressed(image: Pixels, quality: int = 85) -> Pixels:
    """Through a JPEG of twice the size, as a thumbnail is made."""
    large = cv2.resize(image, None, fx=2, fy=2)
    decoded = cv2.imdecode(cv2.imencode(".jpg", large, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
    return np.asarray(cv2.resize(decoded, image.shape[1::-1], interpolation=cv2.INTER_AREA), np.uint8)


@pytest.mark.parametrize("name", ["INFERNO", "JET", "HOT", "RAINBOW"])
def test_palettes_of_thermal_cameras_are_recognised_also_with_a_black_frame(name: str) -> None:
    shown = [
        compressed(cv2.applyColorMap((255 * soil(k)).astype(np.uint8), getattr(cv2, f"COLORMAP_{name}")))
        for k in (0, 1)
    ]
    shown[0][:30] = 0
    assert have_palette(shown)


def lit(colours: tuple[tuple[int, int, int], ...], noise: float) -> Pixels:
    """Patches of ground of these colours, BGR, in uneven light."""
    rng = np.random.default_rng(3)
    kind = np.digitize(soil(4), np.linspace(0.2, 0.8, len(colours) + 1)[1:-1])
    image = np.array(colours)[kind] * (0.4 + soil(5)[..., None]) + rng.normal(0, noise, (240, 320, 3))
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@pytest.mark.parametrize(
    "colours",
    [((120, 120, 120),), ((150, 60, 20), (90, 160, 210)), ((40, 120, 60), (60, 90, 160), (180, 170, 160))],
    ids=["gray", "water and sand", "grass, earth and roads"],
)
@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_ground_of_few_colours_is_no_palette(colours: tuple[tuple[int, int, int], ...], noise: float) -> None:
    assert not have_palette([compressed(lit(colours, noise))])


RAMP = np.arange(256, dtype=np.uint8)[None]


@pytest.mark.parametrize("gain", [0.5, 0.8, 1.2, 1.6, 2.5])
def test_highlights_rise_to_white_and_nothing_else_becomes_white(gain: float) -> None:
    toned = Tone((gain,)).apply(RAMP)[0].astype(int)
    assert toned[255] == 255
    assert (np.diff(toned) >= 0).all()
    # Rounding may lift the last gray levels before white, but nothing that is clearly darker than white.
    assert toned[240] < 255
    # A strip of one pixel, too.
    assert Tone((gain,)).apply(RAMP[:, 239:].T)[:, 0].tolist() == toned[239:].tolist()


def test_a_gain_makes_no_jump_and_leaves_black_and_white() -> None:
    """Over a burnt sky, an edge would show where the gain passes the shoulder."""
    gains = np.arange(0.5, 1.5, 0.005)
    toned = np.array([Tone((float(gain),)).apply(RAMP)[0] for gain in gains]).astype(int)
    assert np.abs(np.diff(toned, axis=0)).max() <= 2
    values = np.array([[0, 9000, 20_000, 65_535]], np.uint16)
    toned = Tone((2.0,), black=9000).apply(values)
    assert toned.dtype == np.uint16
    np.testing.assert_array_equal(toned, [[0, 9000, 31_000, 65_535]])


def test_factors_belong_to_places_of_the_source_image_and_have_bounds() -> None:
    turned = np.array([[0.0, -2.0, 900.0], [2.0, 0.0, 40.0], [1e-5, 2e-5, 1.0]])
    part = Canvas(30, 70, 333, 222)
    light = np.zeros((3, 5, 3), np.float32)
    light[..., 1] = np.linspace(-0.3, 0.5, 5)  # along x, green only
    factors = Tone((1.0, 2.0, 1.0), np.array([[0.2], [0], [0], [0]]), light=light).factors((640, 480), part, turned)
    for x, y in ((10, 10), (332, 221), (100, 57)):
        mapped = turned @ [part.x_px + x, part.y_px + y, 1]
        at = mapped[:2] / mapped[2]
        falloff = np.exp(0.2 * ((at - [319.5, 239.5]) ** 2).sum() / 400**2)
        green = 2 * np.exp(-0.3 + 0.8 * np.clip(at[0] / 639, 0, 1))
        np.testing.assert_allclose(factors[y, x], falloff * np.array([1, green, 1]), rtol=1e-2)
    # The canvas reaches to the horizon of the photograph, and beyond.
    to_image = np.array([[40.0, 0, 0], [0, 40, 0], [0, -1 / 150, 1]])
    tone = Tone((1.0,), np.array([[0.3], [0.3], [0.1], [0.1]]))
    with np.errstate(all="raise", divide="ignore", invalid="ignore"):
        factors = tone.factors((640, 480), Canvas(0, 0, 400, 400), to_image)
    assert np.isfinite(factors).all()
    assert factors.dtype == np.float32
