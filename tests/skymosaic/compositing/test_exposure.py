from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Array, Pixels
from skymosaic.compositing.exposure import describe_uneven, estimate_levels, estimate_tones, measure_toned_range
from skymosaic.compositing.layer import Layer
from skymosaic.compositing.overlaps import compare_overlaps
from skymosaic.compositing.tone import NEUTRAL, SHOULDER_START, Tone
from skymosaic.compositing.warp import Canvas
from skymosaic.imagery.depth import ValueRange, sample_values

SIZE_PX = (320, 240)


def scene(width_px: int = 900, height_px: int = 500, seed: int = 1) -> Pixels:
    noise = np.random.default_rng(seed).integers(0, 256, (height_px // 8, width_px // 8, 3), dtype=np.uint8)
    return cv2.normalize(cv2.resize(noise, (width_px, height_px)), None, 40, 190, cv2.NORM_MINMAX)


def strip(exposures: Array, step_px: int = 90) -> list[Layer]:
    """Photographs along two rows of a scene, each times its exposure."""
    ground, layers = scene(step_px * (len(exposures) // 2 - 1) + 630), []
    rng = np.random.default_rng(2)
    for number, exposure in enumerate(exposures):
        left, top = step_px * (number // 2), 120 * (number % 2)
        window = ground[top : top + SIZE_PX[1], left : left + SIZE_PX[0]]
        exposed = np.clip(window * exposure + rng.normal(0, 1, window.shape), 0, 255)
        layers.append(Layer(np.rint(exposed).astype(np.uint8), np.array([[1.0, 0, left], [0, 1, top], [0, 0, 1]])))
    return layers


def gains(tones: list[Tone]) -> Array:
    return np.array([tone.gain for tone in tones])


def toned(layer: Layer, tone: Tone) -> NDArray[Any]:
    return tone.apply(layer.image, tone.factors(layer.size, Canvas(0, 0, *layer.size)))


def white_share(images: list[NDArray[Any]]) -> float:
    return np.mean([(image.min(axis=2) > 250).mean() for image in images])


def lit_strip(lamp: Array, exposures: Array) -> list[Layer]:
    """Photographs that all head the same way, under a light (H, 1, 3) that moves with the camera."""
    ground, layers, rng = scene(320, 1500), [], np.random.default_rng(3)
    for number, exposure in enumerate(exposures):
        top = 75 * number
        exposed = ground[top : top + SIZE_PX[1]] * lamp * exposure + rng.normal(0, 2, (*SIZE_PX[::-1], 3))
        layers.append(
            Layer(np.rint(np.clip(exposed, 0, 255)).astype(np.uint8), np.array([[1.0, 0, 0], [0, 1, top], [0, 0, 1]]))
        )
    return layers


def kept_brightness(layers: list[Layer], tones: list[Tone]) -> Array:
    """The channels' brightness (N, 3) of toned photographs, over that of the photographs."""
    pairs = zip(layers, tones, strict=True)
    return np.array([toned(layer, tone).mean(axis=(0, 1)) / layer.image.mean(axis=(0, 1)) for layer, tone in pairs])


DOWN = np.linspace(-0.5, 0.5, SIZE_PX[1])[:, None, None]


@pytest.mark.parametrize("step", [0.9, 1.1])
def test_an_exposure_that_changes_steadily_is_no_light_that_photographs_do_not_show(step: float) -> None:
    """Where all photographs head one way, both explain the overlaps; but one of them is lit evenly."""
    exposures = np.power(step, np.arange(8.0))
    tones, drift = estimate_tones(lit_strip(np.ones((1, 1, 3)), exposures))
    assert drift == 1
    assert all(tone.shading is None or abs(tone.shading[2:]).max() < 0.02 for tone in tones)
    relative = gains(tones).mean(axis=1)[:6] * exposures[:6]
    np.testing.assert_allclose(relative / relative.mean(), 1, atol=0.05)


@pytest.mark.parametrize("lamp", [1 - 0.6 * DOWN * np.ones(3), np.exp(0.6 * DOWN * [1, 0, -1])], ids=["gray", "tinted"])
def test_light_that_moves_with_the_camera_makes_no_ramp(lamp: Array) -> None:
    layers = lit_strip(lamp, np.ones(14))
    tones, _ = estimate_tones(layers)
    np.testing.assert_allclose(kept_brightness(layers, tones), 1, atol=0.12)
    assert describe_uneven(layers, tones, 1.0) == ""
    shown = np.concatenate([toned(layer, tone)[60:140] for layer, tone in zip(layers, tones, strict=True)])
    # The scene is as bright at its end as where it begins.
    np.testing.assert_allclose(shown[:400].mean(axis=(0, 1)) / shown[-400:].mean(axis=(0, 1)), 1, atol=0.2)


@pytest.mark.parametrize(
    ("kept", "says"),
    [
        ([0.8, 1, 1, 1.25], ""),
        ([0.78, 1, 1, 1], "shown at 0.78 of their photographs' or less, and a tenth at 1.00 or more"),
        ([1, 1, 1, 1.27], "shown at 1.00 of their photographs' or less, and a tenth at 1.27 or more"),
    ],
)
def test_places_that_become_only_darker_or_only_brighter_are_said_to(kept: list[float], says: str) -> None:
    """Each of three stands for several, so that a tenth are like the outermost."""
    image = np.full((8, 8, 3), 100, np.uint8)
    tones = [Tone((kept[k],)) for k in (0, 0, 1, 2, 3, 3)]
    layers = [Layer(image, np.array([[1.0, 0, 20 * k], [0, 1, 0], [0, 0, 1]])) for k in range(len(tones))]
    described = describe_uneven(layers, tones, 1.0)
    assert says in described
    assert bool(says) == bool(described)
    # At one place, they are a bracket of exposures.
    assert describe_uneven([Layer(image, np.eye(3))] * len(tones), tones, 1.0) == ""


def test_moving_things_and_photographs_without_overlap_change_nothing() -> None:
    layers = strip(np.ones((6, 1)))
    images = [layer.image.copy() for layer in layers]
    images[1][60:140, 100:220] = 45
    tones, _ = estimate_tones([Layer(image, layer.transform) for image, layer in zip(images, layers, strict=True)])
    np.testing.assert_allclose(gains(tones), 1, atol=0.02)
    layers = strip(np.array([1.0, 0.7, 1.0, 0.7])[:, None])
    far = Layer(layers[0].image, np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]]))
    tones, _ = estimate_tones([*layers, far])
    assert tones[-1] == NEUTRAL
    assert estimate_tones([far]) == ([NEUTRAL], 1)
    # Two have one overlap, of which nothing can be held out.
    two, _ = estimate_tones(layers[:2])
    assert two[1].gain[0] / two[0].gain[0] == pytest.approx(1 / 0.7, rel=0.03)
    assert [tone.light for tone in two] == [None, None]


def automatic(layers: list[Layer], brightness: Array) -> list[Layer]:
    """The photographs of ground of a brightness (W,) along the strip, all exposed to the same mean."""
    images = []
    for layer in layers:
        left = int(layer.transform[0, 2])
        lit = layer.image * brightness[left : left + SIZE_PX[0], None]
        images.append(np.clip(lit * (150 / lit.mean()), 0, 255).astype(np.uint8))
    return [Layer(image, layer.transform) for image, layer in zip(images, layers, strict=True)]


@pytest.mark.parametrize("angle_degrees", [0, 30])
def test_brightness_that_drifts_along_a_flight_is_evened_out_without_a_step(angle_degrees: float) -> None:
    """Every second photograph heads the other way, so the light does not belong to the camera."""
    layers = automatic(strip(np.ones((24, 1))), np.geomspace(0.4, 2.5, 1620))
    back = np.array([[-1.0, 0, SIZE_PX[0] - 1], [0, -1, SIZE_PX[1] - 1], [0, 0, 1]])
    layers[2::4] = [Layer(each.image[::-1, ::-1].copy(), each.transform @ back) for each in layers[2::4]]
    turn = np.vstack((cv2.getRotationMatrix2D((0, 0), angle_degrees, 1.0), [0, 0, 1]))
    layers = [replace(layer, transform=turn @ layer.transform) for layer in layers]
    tones, drift = estimate_tones(layers)
    assert drift == pytest.approx(6.25 ** (990 / 1620), rel=0.1)
    np.testing.assert_allclose(kept_brightness(layers, tones), 1, atol=0.08)
    assert f"a factor of {drift:.1f}. Overlaps cannot tell" in describe_uneven(layers, tones, drift)
    # A flight as short as its photographs is long may show one edge of the ground.
    assert estimate_tones(layers[:14])[1] == 1
    # Along the middle of an overlap both photographs show the same ground as bright as each other.
    after = [Layer(toned(layer, tone), layer.transform) for layer, tone in zip(layers, tones, strict=True)]
    assert np.median(np.abs(compare_overlaps(after, 0, 255).difference)) < 0.02


def test_bright_ground_beside_dark_ground_stays_and_stays_below_white() -> None:
    """Every photograph has the same mean, over a dark wood and a field that is twice as bright."""
    layers = automatic(strip(np.ones((32, 1)), step_px=80), np.where(np.arange(1830) < 1000, 0.7, 1.4))
    (*tones, alone), drift = estimate_tones(
        [*layers, Layer(layers[0].image, np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]]))]
    )
    assert alone is NEUTRAL
    assert drift == 1
    after = [toned(layer, tone) for tone, layer in zip(tones, layers, strict=True)]
    kept = [one.mean() / layer.image.mean() for one, layer in zip(after, layers, strict=True)]
    assert np.median(kept) == pytest.approx(1, abs=0.02)
    assert kept[-1] > 1.1
    assert np.mean(tones[-1].gain) / np.mean(tones[0].gain) == pytest.approx(2, rel=0.05)
    assert tones[0].shoulder < SHOULDER_START
    assert white_share(after) <= white_share([layer.image for layer in layers]) + 0.001


def test_the_levels_of_a_camera_and_the_range_that_gains_leave() -> None:
    samples = [np.array(ends, np.uint16) for ends in ([300, 900], [100, 3000], [200, 700])]
    assert estimate_levels(samples, [None, None, None]) == (0, 4095)
    # A photograph cannot be darker than black.
    assert estimate_levels(samples, [150.0, None, 170.0]) == (100, 4095)
    coloured = sample_values(np.full((300, 400, 3), (1000, 2000, 4000), np.uint16))
    gray = sample_values(np.full((300, 400), 2000, np.uint16))
    tones = [Tone((1.5, 1.0, 0.7)), Tone((1.0, 1.0, 1.0))]
    values = measure_toned_range(tones, [coloured, gray], ValueRange(1000, 4000, deep=True))
    assert values == ValueRange(1500, 2800, deep=True)
