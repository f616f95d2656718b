import cv2
import numpy as np
import pytest

from golden_model.arrays import Float32, Pixels
from skymosaic.compositing.palette import have_palette


def soil(seed: int) -> Float32:
    """A quantity (240, 320) from 0 to 1, smooth and fine."""
    rng = np.random.default_rng(seed)
    total = np.zeros((240, 320), np.float32)
    for sigma in (2, 8, 30):
        layer = cv2.GaussianBlur(rng.standard_normal(total.shape).astype(np.float32), (0, 0), sigma)
        total += layer / layer.std()
    return cv2.normalize(total, None, 0, 1, cv2.NORM_MINMAX)


def compressed(image: Pixels) -> Pixels:
    """Through a JPEG of twice the size, as a thumbnail is made."""
    large = cv2.resize(image, None, fx=2, fy=2)
    decoded = cv2.imdecode(cv2.imencode(".jpg", large, [cv2.IMWRITE_JPEG_QUALITY, 85])[1], cv2.IMREAD_COLOR)
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
