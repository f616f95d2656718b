"""Pixels that show nothing, transparent ones and those without data, are no ground: from the file to the mosaic."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as PillowImage

from sim.scene import Flight
from skymosaic.compositing.blend import Blending
from skymosaic.imagery.decoding import decode, read_header
from skymosaic.imagery.images import load
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from tests.skymosaic.imagery.test_decoding import write_raster


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".tif", ".png", ".webp"])
def test_alpha_is_turned_as_the_pixels_are(tmp_path: Path, orientation: int, suffix: str) -> None:
    pixels = np.full((70, 100, 4), 200, np.uint8)
    pixels[:, :, 3] = 255
    # The corner that is black is the one that is transparent.
    pixels[:20, :40] = 0
    exif = PillowImage.Exif()
    exif[274] = orientation
    options: dict[str, Any] = {"tiffinfo": {274: orientation}} if suffix == ".tif" else {"exif": exif, "lossless": True}
    PillowImage.fromarray(pixels).save(tmp_path / f"p{suffix}", **options)
    photograph = load(tmp_path / f"p{suffix}")
    unmasked: Any = cv2.imdecode(np.fromfile(tmp_path / f"p{suffix}", np.uint8), cv2.IMREAD_COLOR)
    assert photograph.visible is not None
    np.testing.assert_array_equal(photograph.visible, np.where(unmasked[..., 0] == 200, 255, 0))
    # What shows nothing looks like what is beside it.
    assert (photograph.pixels == 200).all()


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("alpha", [0, 255])
def test_alpha_that_nobody_filled_hides_nothing(tmp_path: Path, alpha: int, suffix: str) -> None:
    pixels = np.dstack([np.full((80, 80, 3), 9, np.uint8), np.full((80, 80), alpha, np.uint8)])
    PillowImage.fromarray(pixels).save(tmp_path / f"p{suffix}")
    photograph = load(tmp_path / f"p{suffix}")
    assert photograph.visible is None
    assert (photograph.pixels == 9).all()


@pytest.mark.parametrize(
    ("channels", "dtype", "interleave"),
    [(1, np.uint8, "pixel"), (3, np.uint8, "pixel"), (3, np.uint8, "band"), (3, np.uint16, "pixel")],
)
@pytest.mark.parametrize("kind", ["PREMULTIPLIED", "NON-PREMULTIPLIED"])
def test_half_transparent_pixels_have_their_own_colours(
    tmp_path: Path, kind: str, channels: int, dtype: type, interleave: str
) -> None:
    colours: NDArray[Any] = np.tile(np.linspace(40, 200, 100).astype(dtype), (channels, 90, 1))
    alpha: NDArray[Any] = np.repeat(np.array([255, 150, 0], dtype), 30)[None, :, None] * dtype(
        np.iinfo(dtype).max // 255
    )
    stored = np.rint(colours * (alpha / np.iinfo(dtype).max)) if kind == "PREMULTIPLIED" else colours
    path, photometric = tmp_path / "p.tif", "RGB" if channels == 3 else "MINISBLACK"
    values = np.concatenate([stored.astype(dtype), np.tile(alpha, 100)])
    write_raster(path, values, alpha=kind, interleave=interleave, photometric=photometric)
    pixels, visible, *_ = decode(path, read_header(path), keep_damaged=False)
    assert visible is not None
    assert visible.all(axis=1).tolist() == [True] * 60 + [False] * 30
    assert not visible[60:].any()
    # Premultiplied values are rounded.
    expected = np.moveaxis(colours, 0, -1)[:60].repeat(3 // channels, 2)
    np.testing.assert_allclose(pixels[:60].astype(float), expected, atol=2)


def test_whether_colours_are_premultiplied_is_that_of_the_first_page(tmp_path: Path) -> None:
    path = tmp_path / "p.tif"
    values, mask = np.full((4, 128, 128), 9, np.uint16), np.ones((128, 128), np.bool_)
    write_raster(path, values, mask, photometric="RGB", alpha="PREMULTIPLIED")
    premultiplied, straight = (struct.pack("<HHII", 338, 3, 1, value) for value in (1, 2))
    before, entry, after = path.read_bytes().rpartition(premultiplied)
    path.write_bytes(before + straight + after)
    assert entry
    assert premultiplied in before
    assert read_header(path).premultiplied


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_more_than_half_opaque_shows(tmp_path: Path, dtype: type) -> None:
    half, most = np.iinfo(dtype).max // 2, np.iinfo(dtype).max
    pixels: NDArray[Any] = np.full((64, 64, 4), 90, dtype)
    pixels[..., 3] = np.repeat(np.array([0, half, half + 1, most], dtype), 16)
    cv2.imwrite(str(tmp_path / "p.png"), pixels)
    visible = load(tmp_path / "p.png").visible
    assert visible is not None
    assert visible[0, ::16].tolist() == [0, 0, 255, 255]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_transparent_gray_level_hides_its_pixels(tmp_path: Path, dtype: type) -> None:
    """OpenCV does not tell of it."""
    gray = np.tile(np.array([[7], [90]], dtype) * dtype(np.iinfo(dtype).max // 255), (40, 80))
    PillowImage.fromarray(gray).save(tmp_path / "p.png", transparency=int(gray[0, 0]))
    visible = load(tmp_path / "p.png").visible
    assert visible is not None
    np.testing.assert_array_equal(visible == 255, gray > gray[0, 0])


def test_a_colour_has_no_data_where_all_its_channels_have_none(tmp_path: Path) -> None:
    values = np.full((3, 70, 80), 90, np.uint8)
    values[:, :9] = values[0, 9:20] = 255
    write_raster(tmp_path / "t.tif", values, photometric="RGB", nodata=255)
    visible = load(tmp_path / "t.tif").visible
    assert visible is not None
    np.testing.assert_array_equal(visible.all(axis=1), np.arange(70) >= 9)
    np.testing.assert_array_equal(visible.any(axis=1), np.arange(70) >= 9)


@pytest.mark.parametrize(
    ("dtype", "nodata", "declared"),
    [("float32", -9999, -9999), ("float32", np.nan, None), ("uint16", 0, 0), ("uint8", 255, 255)],
)
def test_nodata_neither_shows_nor_stretches_the_range(
    tmp_path: Path, dtype: str, nodata: float, declared: float | None
) -> None:
    values = np.tile(np.linspace(10, 30, 100), (80, 1)).astype(dtype)
    values[:9, :] = np.array(nodata, dtype)
    write_raster(tmp_path / "t.tif", values[np.newaxis], nodata=declared)
    photograph = load(tmp_path / "t.tif")
    assert photograph.visible is not None
    assert not photograph.visible[:9].any()
    assert photograph.visible[9:].all()
    if photograph.value_range is not None:
        assert (photograph.value_range.low, photograph.value_range.high) == pytest.approx((10, 30), abs=0.2)
    np.testing.assert_array_equal(photograph.pixels[:9], np.tile(photograph.pixels[9], (9, 1)))


@pytest.mark.parametrize("blending", ["multiband", "distance"])
def test_a_mosaic_shows_none_of_what_is_transparent(flight: Flight, tmp_path: Path, blending: Blending) -> None:
    """Photographs that were turned, with transparent corners: the mosaic has no black, and ends where they do."""
    height, width = flight.images[0].shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), 20, 1.0)
    for number, image in enumerate(flight.images[:4]):
        # Nothing but the alpha channel tells the corners, which are as black as some ground, apart.
        pixels = np.dstack([np.maximum(image, 40), np.full((height, width), 255, np.uint8)])
        cv2.imwrite(str(tmp_path / f"{number}.png"), cv2.warpAffine(pixels, turn, (width, height)))
    with open_run(tmp_path, MosaicOptions(blending=blending)) as run:
        composition = run.composition(run.layouts[0])
        features = [view.strongest for view in run.flight.views]
        pixels, shown = (np.concatenate(part) for part in zip(*run.bands(composition), strict=True))
    assert len(composition.placements) == 4
    assert all(len(each) > 100 for each in features)
    assert pixels[shown].min() > 15
    corners = [np.rint(transform @ [2.0, 2.0, 1.0])[:2].astype(int) for transform in composition.transforms]
    assert not all(shown[y, x] for x, y in corners)
    # The first photograph's corner lies outside of all others.
    hidden = cv2.warpAffine(np.full((height, width), 255, np.uint8), turn, (width, height)) == 0
    assert shown.mean() < 1 - 0.5 * hidden.mean()
