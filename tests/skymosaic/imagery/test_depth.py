import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from skymosaic.common.errors import InputError
from skymosaic.imagery.depth import ValueRange, measure_common_range, measure_range, sample_values, show_in_8_bit
from skymosaic.imagery.images import load, load_intensities


def test_the_range_of_16_bit_pixels_is_the_percentiles() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        deep = rng.integers(0, 1 << 16, (rng.integers(70, 100), 83), dtype=np.uint16)
        values = measure_range(deep, "deep")
        np.testing.assert_allclose((values.low, values.high), np.percentile(deep, (0.1, 99.9)))


def test_a_flight_has_one_range_and_keeps_16_bits() -> None:
    dark, bright = (sample_values(np.full((300, 400), level, np.uint16)) for level in (9000, 50_000))
    assert measure_common_range([dark, bright]) == ValueRange(9000, 50_000, deep=True)
    assert measure_common_range([dark, dark[:0].astype(np.uint8)]) == ValueRange(9000, 9000, deep=False)
    assert measure_common_range([dark[:0]]) is None
    coloured = sample_values(np.full((300, 400, 3), (100, 9000, 9000), np.uint16))
    assert measure_common_range([coloured, bright]) == ValueRange(100, 50_000, deep=True)


def test_a_sample_is_spread_evenly_over_the_photograph() -> None:
    pixels = np.arange(512 * 255, dtype=np.float32).reshape(512, 255)
    pixels[2, 7] = np.nan
    expected = pixels[2::4].ravel()
    np.testing.assert_array_equal(sample_values(pixels), expected[np.isfinite(expected)])
    np.testing.assert_array_equal(sample_values(pixels[:, :256].T), pixels.T[:, 2::4][np.isfinite(pixels.T[:, 2::4])])


def test_a_picture_of_8_bits_is_shown_as_it_is() -> None:
    values, shown = ValueRange(0, 510), np.array([[0, 20, 255]], np.uint8)
    np.testing.assert_array_equal(show_in_8_bit(shown, values), shown)
    np.testing.assert_array_equal(show_in_8_bit(shown, None), shown)
    np.testing.assert_array_equal(show_in_8_bit(shown.astype(np.uint16) * 2, values), shown)


def test_a_thumbnail_is_shown_in_another_range() -> None:
    own, flight = ValueRange(10_000, 20_000), ValueRange(0, 40_000)
    np.testing.assert_array_equal(own.show_as(np.array([[0, 255]], np.uint8), flight), [[64, 128]])


def test_8_bits_become_numbers_of_the_range_within_16_bits() -> None:
    shown = np.array([[0, 51, 255]], np.uint8)
    np.testing.assert_array_equal(ValueRange(0, 65_535).to_16_bit(shown), [[0, 13_107, 65_535]])
    np.testing.assert_array_equal(ValueRange(-500, 70_000).to_16_bit(shown), [[0, 13_600, 65_535]])


@pytest.mark.parametrize("values", [ValueRange(0, 40_000), ValueRange(0, 40_000, deep=True)])
def test_the_same_number_is_shown_alike_in_all_photographs(tmp_path: Path, values: ValueRange) -> None:
    for name, brightest in (("dark", 20_000), ("bright", 40_000)):
        ramp = np.linspace(0, brightest, 64 * 80).reshape(64, 80).astype(np.uint16)
        ramp[0, 0] = 10_000
        cv2.imwrite(str(tmp_path / f"{name}.tif"), ramp)
    shown = [load_intensities(tmp_path / f"{name}.tif", name, values)[0][0, 0] for name in ("dark", "bright")]
    assert shown == [10_000 if values.deep else 64] * 2
    own = [load(tmp_path / f"{name}.tif").pixels[0, 0] for name in ("dark", "bright")]
    assert own[0] != own[1]
    pixels = np.full((64, 80), 7, np.uint8)
    np.testing.assert_array_equal(load_intensities(pixels, "image 3", values)[0], pixels)
    cv2.imwrite(str(tmp_path / "plain.tif"), pixels)
    np.testing.assert_array_equal(load_intensities(tmp_path / "plain.tif", "plain", values)[0], pixels)


def test_libtiff_is_silent_about_tags_it_does_not_know(tmp_path: Path) -> None:
    picture = Image.fromarray(np.zeros((80, 80), np.uint16))
    picture.save(tmp_path / "t.tif", tiffinfo={50_000: "private"})
    code = "import sys; from skymosaic.imagery.images import load; load(sys.argv[1])"
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "t.tif")], capture_output=True, text=True, check=True
    )
    assert run.stderr == ""


def test_the_error_for_signed_pixels_says_what_can_be_read() -> None:
    with pytest.raises(
        InputError, match=r"a\.tif: pixels of int16 are not supported; convert them to unsigned 8 or 16"
    ):
        measure_range(np.zeros((64, 64), np.int16), "a.tif")
