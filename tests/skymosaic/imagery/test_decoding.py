"""Pixels of all kinds of files, what of them shows nothing, and files that cannot be read."""

import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from PIL import Image as PillowImage

from skymosaic.common.errors import InputError
from skymosaic.imagery import decoding, images
from skymosaic.imagery.decoding import decode, read_header
from skymosaic.imagery.images import load
from skymosaic.maps.georeference import configured_rasterio
from tests.skymosaic.imagery.test_images import photograph


def write_raster(path: Path, values: NDArray[Any], mask: NDArray[np.bool_] | None = None, **profile: object) -> None:
    """Write bands (N, height, width) as GDAL does."""
    count, height, width = values.shape
    shape = {"driver": "GTiff", "count": count, "height": height, "width": width, "dtype": values.dtype}
    with (
        configured_rasterio(),
        rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
        rasterio.open(path, "w", **shape | profile) as file,
    ):
        file.write(values)
        if mask is not None:
            file.write_mask(mask)
            file.build_overviews([2])


BAD: dict[str, Callable[[Path], object]] = {
    "not an image": lambda path: path.write_text("no picture at all, only words " * 10),
    "TIFF of gray or RGB, 8 or 16 bits": lambda path: write_raster(path, np.zeros((5, 96, 128), np.uint8)),
    "empty": lambda path: path.touch(),
    "too small": lambda path: cv2.imwrite(str(path), photograph(10, 10)),
    "truncated": lambda path: path.write_bytes(cv2.imencode(".png", photograph())[1].tobytes()[:-3000]),
    "truncated;": lambda path: path.write_bytes(cv2.imencode(".jpg", photograph())[1].tobytes()[:-600]),
    "not a file": lambda path: path.mkdir(),
    "no such file": lambda path: None,
}
"""What is said of what is made."""


@pytest.mark.parametrize("says", BAD)
def test_a_bad_file_gets_one_line_that_names_it(tmp_path: Path, says: str) -> None:
    path = tmp_path / "bad.png"
    BAD[says](path)
    with pytest.raises(InputError) as caught:
        images.load(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_decoded_size_has_a_limit_in_bytes(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "t.tif"), np.zeros((64, 64, 4), np.uint16), [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    data = (tmp_path / "t.tif").read_bytes()
    assert decoding.read_header(tmp_path / "t.tif").decoded_bytes == 64 * 64 * 8
    for tag in (256, 257):
        entry = data.index(tag.to_bytes(2, "little") + b"\x03\0\x01\0\0\0")
        data = data[: entry + 8] + (9000).to_bytes(2, "little") + data[entry + 10 :]
    (tmp_path / "t.tif").write_bytes(data)
    with pytest.raises(InputError, match="MB when decoded"):
        images.load(tmp_path / "t.tif")


def test_the_limits_of_size_themselves_are_valid(tmp_path: Path) -> None:
    decoding.check_size("a.png", 64, 64)
    decoding.check_size("a.png", 105_000_000, 1, min_side_px=1)
    for width, height, fault in (
        (64, 63, "64x63 pixels is too small; at least 64x64 needed"),
        (63, 64, "63x64 pixels is too small; at least 64x64 needed"),
        (105_000_064, 64, "105000064x64 is larger than 105 megapixels; reduce it first"),
    ):
        with pytest.raises(InputError, match=f"^a.png: {fault}$"):
            decoding.check_size("a.png", width, height)
    with pytest.raises(InputError, match="larger than 105 megapixels"):
        decoding.check_size("a.png", 105_000_001, 1, min_side_px=1)
    with (tmp_path / "large").open("wb") as file:
        file.truncate(640_000_000)
        decoding.check_file(tmp_path / "large", "an image")
        file.truncate(640_000_001)
    decoding.check_file(tmp_path / "large", "a video")
    with pytest.raises(InputError, match="large: larger than 640 MB; reduce it first"):
        decoding.check_file(tmp_path / "large", "an image")


@pytest.mark.parametrize(
    ("name", "dtype", "channels", "sample_bytes"),
    [
        ("a.png", np.uint8, 3, 1), ("a.png", np.uint16, 3, 2), ("a.png", np.uint16, 1, 2), ("a.tif", np.uint8, 3, 1),
        ("a.tif", np.uint16, 3, 2), ("a.tif", np.float32, 1, 4), ("a.jpg", np.uint8, 1, 1), ("a.pgm", np.uint16, 1, 4),
    ],
)  # fmt: skip
def test_the_size_of_decoded_pixels_is_known_beforehand(
    tmp_path: Path, name: str, dtype: type, channels: int, sample_bytes: int
) -> None:
    cv2.imwrite(str(tmp_path / name), np.zeros((70, 90, channels), dtype))
    header = decoding.read_header(tmp_path / name)
    assert (header.size, header.sample_bytes) == ((90, 70), sample_bytes)
    assert header.decoded_bytes == 90 * 70 * channels * sample_bytes


def test_of_a_file_without_any_pixels_nothing_is_kept(tmp_path: Path) -> None:
    data = cv2.imencode(".jpg", photograph())[1].tobytes()
    (tmp_path / "a.jpg").write_bytes(data[: data.index(b"\xff\xdb")] + data[data.index(b"\xff\xc0") :][:19])
    with pytest.raises(InputError, match=r"a\.jpg: the file is truncated; .*; nothing of it can be decoded$"):
        images.load(tmp_path / "a.jpg", keep_damaged=True)
    data = cv2.imencode(".png", photograph())[1].tobytes()
    (tmp_path / "a.png").write_bytes(data[:60] + data[-12:])
    with pytest.raises(InputError, match=r"a\.png: damaged or of an unsupported kind; convert it to PNG"):
        images.load(tmp_path / "a.png")


@pytest.mark.parametrize("white", [1, 100, 255])
@pytest.mark.parametrize("kind", ["P5", "P6"])
def test_white_is_what_netpbm_says(tmp_path: Path, kind: str, white: int) -> None:
    pixels = np.tile(np.linspace(0, white, 128).round().astype(np.uint8), (96, 1))
    stored = pixels if kind == "P5" else np.dstack([pixels, pixels // 2, pixels])
    (tmp_path / "p.ppm").write_bytes(f"{kind} # 1 of 2\n128 96\n{white}\n".encode() + stored.tobytes())
    read = images.load(tmp_path / "p.ppm").pixels
    np.testing.assert_allclose(read.reshape(96, 128, -1)[..., 0], pixels * (255 / white), atol=0.5)
    assert read.shape == stored.shape


def _pages(path: Path) -> None:
    first, *others = (PillowImage.fromarray(photograph(height)) for height in (96, 97, 96, 95))
    first.save(path, save_all=True, append_images=others)


def _damaged_page(path: Path) -> None:
    _pages(path)
    # The first is whole, and the second's directory is cut off.
    path.write_bytes(path.read_bytes()[: photograph().nbytes + 250])


def _overview_and_mask(path: Path) -> None:
    write_raster(path, np.moveaxis(photograph(), -1, 0), np.ones((96, 128), np.bool_), photometric="RGB")


@pytest.mark.parametrize(("make", "pages"), [(_pages, 3), (_damaged_page, 1), (_overview_and_mask, 1)])
def test_pages_that_are_not_read_are_counted(tmp_path: Path, make: Callable[[Path], None], pages: int) -> None:
    """Neither thumbnails, overviews and masks, nor what cannot be read."""
    make(tmp_path / "p.tif")
    read = images.load(tmp_path / "p.tif")
    assert read.size == (128, 96)
    assert read.notes == ((f"only the first of {pages} pages is read",) if pages > 1 else ())


@pytest.mark.parametrize("value", ["text", (0, 0), float("nan"), 99])
def test_an_invalid_orientation_counts_as_upright(
    tmp_path: Path, value: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    PillowImage.fromarray(photograph()).save(tmp_path / "p.jpg")
    monkeypatch.setattr(PillowImage.Exif, "get", lambda *_: value)
    assert decoding.read_header(tmp_path / "p.jpg").orientation == 1


@pytest.mark.filterwarnings("ignore:Tag data larger than file")
def test_tags_that_all_name_the_same_bytes_do_not_fill_the_memory(tmp_path: Path) -> None:
    size = decoding.SPARE_BYTES // 8
    entries = b"".join(struct.pack("<HHII", tag, 7, size, 8) for tag in range(1, 100))
    path = tmp_path / "tags.tif"
    path.write_bytes(b"II*\0" + struct.pack("<I", 8 + size) + bytes(size) + struct.pack("<H", 99) + entries + bytes(4))
    tracemalloc.start()
    with pytest.raises(InputError):
        images.load(path)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 2 * (decoding.SPARE_BYTES + size)


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
