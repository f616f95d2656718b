import cv2
import numpy as np
import pytest

from golden_model.arrays import Float32, Pixels
from skymosaic.compositing.palette import have_palette


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


@pytest.mark.parametrize("name", ["INFERNO", "JET", "HOT", "RAINBOW"])
@pytest.mark.parametrize("quality", [35, 85])
def test_palettes_over_fine_detail_are_recognised_behind_a_jpeg(name: str, quality: int) -> None:
    fine = (255 * soil(0, (0.7, 8))).astype(np.uint8)
    assert have_palette([compressed(cv2.applyColorMap(fine, getattr(cv2, f"COLORMAP_{name}")), quality)])


def test_a_palette_is_recognised_between_the_edges_of_roofs() -> None:
    ground = soil(0, (4, 8))
    roofs = np.digitize(ground, np.quantile(ground, (0.2, 0.4, 0.6, 0.8))) / 4
    heat = 255 * (0.85 * roofs + 0.15 * soil(7, (8, 30)))
    assert have_palette([compressed(cv2.applyColorMap(heat.astype(np.uint8), cv2.COLORMAP_HOT), 60)])


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


def test_colour_infrared_is_no_palette_though_its_hues_vary_from_field_to_field() -> None:
    red, bare = np.array((20, 20, 190)), np.array((150, 170, 60))
    fields, light = soil(1, (8, 30))[..., None], 0.35 + 0.9 * soil(2, (1, 2))[..., None]
    image = np.clip(light * (red * fields + bare * (1 - fields)), 0, 255)
    assert not have_palette([compressed(image.astype(np.uint8))])


def test_a_picture_of_a_single_colour_is_no_palette() -> None:
    assert not have_palette([np.full((4, 4, 3), (0, 0, 250), np.uint8)])
