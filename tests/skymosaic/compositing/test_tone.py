import numpy as np
import pytest

from skymosaic.compositing.tone import NEUTRAL, SHOULDER_START, Tone
from skymosaic.compositing.warp import Canvas

RAMP = np.arange(256, dtype=np.uint8)[None]


def test_neutral_tone_returns_the_same_pixels() -> None:
    assert NEUTRAL.apply(RAMP) is RAMP


@pytest.mark.parametrize("gain", [0.5, 0.8, 1.2, 1.6, 2.5])
def test_below_the_shoulder_a_gain_is_a_factor(gain: float) -> None:
    toned = Tone((gain,)).apply(RAMP)
    straight = max(gain, 1) * RAMP < 255 * SHOULDER_START
    np.testing.assert_allclose(toned[straight], (gain * RAMP)[straight], atol=0.51)


@pytest.mark.parametrize("gain", [0.5, 0.8, 1.2, 1.6, 2.5])
def test_highlights_rise_to_white_and_nothing_else_becomes_white(gain: float) -> None:
    toned = Tone((gain,)).apply(RAMP)[0].astype(int)
    assert toned[255] == 255
    assert (np.diff(toned) >= 0).all()
    # Rounding may lift the last gray levels before white, but nothing that is clearly darker than white.
    assert toned[240] < 255


def test_no_level_jumps_where_a_gain_varies() -> None:
    """Over a burnt sky, an edge would show where the gain passes the shoulder."""
    gains = np.arange(0.5, 1.5, 0.005)
    toned = np.array([Tone((float(gain),)).apply(RAMP)[0] for gain in gains]).astype(int)
    assert np.abs(np.diff(toned, axis=0)).max() <= 2


def test_a_gain_of_16_bit_values_leaves_black_and_white_where_they_are() -> None:
    values = np.array([[0, 9000, 20_000, 65_535]], np.uint16)
    toned = Tone((2.0,), black=9000).apply(values)
    assert toned.dtype == np.uint16
    np.testing.assert_array_equal(toned, [[0, 9000, 31_000, 65_535]])


def test_channels_have_their_own_gains() -> None:
    pixels = np.full((4, 5, 3), 100, np.uint8)
    np.testing.assert_array_equal(Tone((0.5, 1.0, 1.5)).apply(pixels)[2, 2], [50, 100, 150])


def test_falloff_brightens_the_corners_as_given() -> None:
    size = (401, 301)
    tone = Tone((1.0,), np.array([[0.2], [0.1], [0.0], [0.0]]))
    toned = tone.apply(np.full((301, 401), 100, np.uint8), tone.factors(size, Canvas(0, 0, *size)))
    assert toned[150, 200] == 100
    assert toned[0, 0] == pytest.approx(100 * np.exp(0.3), abs=1.5)


def test_factors_belong_to_places_of_the_source_image() -> None:
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


def test_far_outside_a_photograph_factors_have_bounds() -> None:
    """The canvas reaches to the horizon of the photograph, and beyond."""
    to_image = np.array([[40.0, 0, 0], [0, 40, 0], [0, -1 / 150, 1]])
    tone = Tone((1.0,), np.array([[0.3], [0.3], [0.1], [0.1]]))
    with np.errstate(all="raise", divide="ignore", invalid="ignore"):
        factors = tone.factors((640, 480), Canvas(0, 0, 400, 400), to_image)
    assert np.isfinite(factors).all()
    assert factors.dtype == np.float32
