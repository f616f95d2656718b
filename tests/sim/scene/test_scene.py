"""Cameras, flights and what they render."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from golden_model.arrays import Array, Pixels
from sim.scene import Camera, CameraPose, Photometry, ground, make_lawnmower, make_pair, project, render_view
from sim.scene.flight import Flight
from sim.scene.noise import make_noise
from sim.scene.terrain import TERRAINS, render_terrain
from tests.sim.scene.conftest import clear_caches


def test_noise_is_a_function_of_position() -> None:
    wide = make_noise(5, -40, 1000, 500, 400)
    inner = make_noise(5, 60, 1057, 111, 77)
    assert np.array_equal(inner, wide[:, 57 : 57 + 77, 100 : 100 + 111])
    assert np.abs(wide[:4].mean(axis=(1, 2))).max() < 0.05
    assert np.all((wide[:6].std(axis=(1, 2)) > 0.6) & (wide[:6].std(axis=(1, 2)) < 1.1))
    neighbours = wide[0][:, 1:] * wide[0][:, :-1]
    assert abs(neighbours.mean()) < 4 / np.sqrt(neighbours.size)


@pytest.mark.parametrize("name", TERRAINS)
def test_land_is_continuous_never_below_the_plane_and_the_same_in_every_part(name: str) -> None:
    whole = render_terrain(name, 1500, 1200, (-700, -300))
    assert whole.min() >= 0
    assert whole.max() > 20
    assert max(np.abs(np.diff(whole, axis=axis)).max() for axis in (0, 1)) < 1
    assert np.array_equal(render_terrain(name, 300, 200, (100, 50)), whole[350:550, 800:1100])


CAMERA = Camera(width_px=321, height_px=240, focal_px=260)


POSES = {
    "full scale, tilted": CameraPose(x_px=300.3, y_px=250.7, altitude_px=250, heading_deg=33, pitch_deg=4, roll_deg=-6),
    "reduced": CameraPose(x_px=600.3, y_px=550.7, altitude_px=620, heading_deg=133, pitch_deg=-5, roll_deg=3),
    "magnified": CameraPose(x_px=300.3, y_px=250.7, altitude_px=170, heading_deg=-70, pitch_deg=2, roll_deg=6),
}


UNTOUCHED = Photometry()


def planted_dots() -> tuple[Pixels, Array]:
    """A ground with Gaussian dots, standard deviation 2 px, at known integer positions."""
    dots = np.array([(x, y) for x in range(25, 1200, 50) for y in range(25, 1200, 50)], np.float64)
    profile = np.exp(-(np.arange(-9, 10) ** 2) / 8)
    picture = np.zeros((1200, 1200), np.float32)
    for x, y in dots.astype(int):
        picture[y - 9 : y + 10, x - 9 : x + 10] += 230 * np.outer(profile, profile)
    return cv2.merge([np.rint(picture).astype(np.uint8)] * 3), dots


def offsets_of_dots(view: Array, expected: Array, scale: float) -> list[Array]:
    """How far the dots in a view are from where they are expected, px; of those that it shows whole."""
    reach = round(10 * scale)
    down, across = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    offsets = []
    for x, y in expected:
        column, row = round(x), round(y)
        if reach <= column < CAMERA.width_px - reach and reach <= row < CAMERA.height_px - reach:
            weight = view[row - reach : row + reach + 1, column - reach : column + reach + 1]
            centre = column + np.average(across, weights=weight), row + np.average(down, weights=weight)
            offsets.append(np.subtract(centre, (x, y)))
    return offsets


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES.keys())
@pytest.mark.parametrize("origin", [(0, 0), (-1030, 70)])
def test_rendered_dots_lie_where_the_homography_says(
    pose: CameraPose, origin: tuple[int, int], rng: np.random.Generator
) -> None:
    picture, dots = planted_dots()
    pose = CameraPose(**{**vars(pose), "x_px": pose.x_px + origin[0], "y_px": pose.y_px + origin[1]})
    view = render_view(picture, pose, CAMERA, UNTOUCHED, rng, origin=origin)[..., 0].astype(np.float64)
    errors = offsets_of_dots(view, project(pose.homography(CAMERA), dots + origin), CAMERA.focal_px / pose.altitude_px)
    assert len(errors) >= 9
    # Bicubic sampling at 1/32 px, gray levels of 1/230, and a dot's centroid under perspective: together below 0.05 px.
    assert np.abs(errors).max() < 0.05


def test_a_bending_lens_moves_the_dots_as_opencv_says(rng: np.random.Generator) -> None:
    picture, dots = planted_dots()
    pose, camera = POSES["full scale, tilted"], replace(CAMERA, k1=-0.15)
    view = render_view(picture, pose, camera, UNTOUCHED, rng)[..., 0].astype(np.float64)
    pinhole = project(pose.homography(camera), dots)
    # The polynomial bends what is far outside back into the picture.
    pinhole = pinhole[np.linalg.norm(pinhole - camera.matrix[:2, 2], axis=1) < camera.width_px]
    rays = np.column_stack([pinhole, np.ones(len(pinhole))]) @ np.linalg.inv(camera.matrix).T
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.matrix, np.array([camera.k1, 0, 0, 0]))
    errors = offsets_of_dots(view, seen[:, 0], camera.focal_px / pose.altitude_px)
    assert len(errors) >= 9
    assert np.abs(errors).max() < 0.1  # the lens also bends the dots themselves


def test_what_stands_above_the_ground_leans_outwards(rng: np.random.Generator) -> None:
    picture, heights = np.full((500, 500, 3), 40, np.uint8), np.zeros((500, 500), np.float16)
    heights[130:210, 110:190] = 30
    cv2.circle(picture, (150, 170), 5, (230, 230, 230), -1)
    pose = CameraPose(x_px=250, y_px=250, altitude_px=300)
    view = render_view(picture, pose, CAMERA, UNTOUCHED, rng, heights=heights)[..., 0].astype(np.float64) - 40
    middle = np.array([(CAMERA.width_px - 1) / 2, (CAMERA.height_px - 1) / 2])
    on_the_roof = middle - np.array([100, 80]) * CAMERA.focal_px / (pose.altitude_px - 30)
    down, across = np.indices(view.shape)
    centre = [np.average(axis, weights=np.maximum(view, 0)) for axis in (across, down)]
    np.testing.assert_allclose(centre, on_the_roof, atol=0.5)
    flat = render_view(picture, pose, CAMERA, UNTOUCHED, rng, heights=np.zeros_like(heights))
    np.testing.assert_allclose(flat, render_view(picture, pose, CAMERA, UNTOUCHED, rng), atol=6)


def test_upright_camera_is_a_similarity() -> None:
    pose = CameraPose(x_px=100, y_px=50, altitude_px=130, heading_deg=90)
    # Turned clockwise by 90 degrees at twice the scale: ground +x is image up, ground +y is image right.
    corner = np.array([[100.0, 50], [110, 50], [100, 60]])
    expected = np.array([[160, 119.5], [160, 99.5], [180, 119.5]])
    assert project(pose.homography(CAMERA), corner) == pytest.approx(expected)


@pytest.mark.parametrize(("tilt", "x_px", "y_px"), [({"pitch_deg": 10}, 0, -1), ({"roll_deg": 10}, 1, 0)])
def test_tilt_moves_the_optical_axis(tilt: dict[str, int], x_px: int, y_px: int) -> None:
    pose = CameraPose(x_px=0, y_px=0, altitude_px=100, **tilt)
    ahead = 100 * np.tan(np.radians(10))
    middle = project(np.linalg.inv(pose.homography(CAMERA)), np.array([[160, 119.5]]))[0]
    assert middle == pytest.approx((x_px * ahead, y_px * ahead))


def test_reducing_view_averages_instead_of_aliasing(rng: np.random.Generator) -> None:
    checks = (np.indices((900, 900)).sum(axis=0) % 2 * 255).astype(np.uint8)
    pose = CameraPose(x_px=450, y_px=450, altitude_px=2 * CAMERA.focal_px, heading_deg=10)
    view = render_view(cv2.merge([checks] * 3), pose, CAMERA, UNTOUCHED, rng)
    assert view.std() < 8
    assert abs(view.mean() - 127.5) < 2


def test_photometry(rng: np.random.Generator) -> None:
    flat = np.full((101, 151, 3), 100, np.uint8)
    assert np.array_equal(UNTOUCHED.apply(flat, rng), flat)
    assert np.all(Photometry(gain=1.5).apply(flat, rng) == 150)
    assert np.all(Photometry(gain=3).apply(flat, rng) == 255)
    assert np.all(Photometry(gamma=2).apply(flat, rng) == round(255 * (100 / 255) ** 2))
    noisy = Photometry(noise_sigma=4).apply(flat, rng).astype(np.float64)
    assert noisy.std() == pytest.approx(4, rel=0.03)
    assert noisy.mean() == pytest.approx(100, abs=0.1)
    vignetted = Photometry(vignetting=0.3).apply(flat, rng)
    assert (vignetted[50, 75, 0], vignetted[0, 0, 0]) == (100, 70)
    edge = np.repeat(np.where(np.arange(151) < 75, 50, 200).astype(np.uint8)[np.newaxis, :, np.newaxis], 3, axis=2)
    blurred = Photometry(blur_sigma_px=2).apply(np.repeat(edge, 101, axis=0), rng)[50, :, 0].astype(np.float64)
    # The steepest slope of a blurred step is its height / (sqrt(2 pi) sigma).
    assert np.diff(blurred).max() == pytest.approx(150 / (np.sqrt(2 * np.pi) * 2), rel=0.05)


def test_bad_input_is_named(rng: np.random.Generator) -> None:
    picture = np.zeros((50, 50, 3), np.uint8)
    with pytest.raises(ValueError, match="focal_px is 0"):
        Camera(width_px=10, height_px=10, focal_px=0)
    with pytest.raises(ValueError, match="altitude_px is -3"):
        CameraPose(x_px=0, y_px=0, altitude_px=-3)
    with pytest.raises(ValueError, match="horizon"):
        CameraPose(x_px=0, y_px=0, altitude_px=100, pitch_deg=75).homography(CAMERA)
    with pytest.raises(ValueError, match="misses the ground"):
        render_view(picture, CameraPose(x_px=5000, y_px=0, altitude_px=100), CAMERA, UNTOUCHED, rng)


def gray_view(flight: Flight, index: int) -> Pixels:
    return cv2.cvtColor(flight.images[index], cv2.COLOR_BGR2GRAY)


@pytest.mark.parametrize("seed", [9, pytest.param(2, marks=pytest.mark.slow)])
def test_pair_shows_the_same_ground(seed: int) -> None:
    flight = make_pair(seed, (240, 180))
    left, right = (gray_view(flight, index).astype(np.float32) for index in (0, 1))
    homography = flight.homography_between(0, 1)
    warped = cv2.warpPerspective(left, homography, (240, 180))
    inside = cv2.warpPerspective(np.ones_like(left), homography, (240, 180)) > 0.99
    assert inside.mean() > 0.4
    assert np.corrcoef(warped[inside], right[inside])[0, 1] > 0.93
    shifted = np.roll(warped, 2, axis=1)
    assert np.corrcoef(shifted[inside], right[inside])[0, 1] < np.corrcoef(warped[inside], right[inside])[0, 1] - 0.05


@pytest.mark.parametrize("size", [(640, 480), (65, 97)])
@pytest.mark.parametrize("overlap", [0.2, 0.6, 0.8])
def test_pair_overlaps_as_asked(size: tuple[int, int], overlap: float) -> None:
    for seed in range(10):
        assert make_pair(seed, size, overlap).overlap_between(0, 1) == pytest.approx(overlap, abs=0.07)


def test_lawnmower_overlaps_along_and_across_its_legs() -> None:
    flight = make_lawnmower(7, 60, size=(400, 300), forward_overlap=0.7, side_overlap=0.5)
    backwards = [abs(pose.heading_deg) > 90 for pose in flight.poses]
    leg = backwards.index(True)
    along = [flight.overlap_between(index, index + 1) for index in range(leg - 1)]
    across = [flight.overlap_between(index, 2 * leg - 1 - index) for index in range(leg)]
    assert np.mean(along) == pytest.approx(0.7, abs=0.05)
    assert np.mean(across) == pytest.approx(0.5, abs=0.05)
    positions = np.array([(pose.x_px, pose.y_px) for pose in flight.poses])
    width, height = np.ptp(positions, axis=0)
    assert 0.5 < width / height < 2


def test_lawnmower_renders_only_what_is_asked_for() -> None:
    clear_caches()
    flight = make_lawnmower(6, 500, size=(161, 119))
    assert len(flight.images) == 500
    assert ground._paint_tile.cache_info().misses == 0
    assert flight.images[499].shape == (119, 161, 3)
    assert 0 < ground._paint_tile.cache_info().misses <= 4
    assert ground.CACHED_TILES * ground.TILE_PX**2 * 3 <= 160e6
    with pytest.raises(IndexError):
        flight.images[500]


def test_bad_overlaps_are_named() -> None:
    with pytest.raises(ValueError, match="overlap is 1; it must be"):
        make_pair(0, overlap=1)
    with pytest.raises(ValueError, match="side_overlap is -1"):
        make_lawnmower(0, 5, side_overlap=-1)
    with pytest.raises(ValueError, match="images is 0"):
        make_lawnmower(0, 0)
