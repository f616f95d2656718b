"""Damage in a TIFF is an error where its compression can tell; whole files are read as before."""

import io
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
import rasterio.errors
from PIL import Image as PillowImage

from skymosaic.common.errors import DamagedError, InputError
from skymosaic.imagery import images
from skymosaic.imagery.decoding import decode, read_header
from skymosaic.imagery.tiff import check_tiff

NOISE = np.random.default_rng(3).integers(0, 256, (480, 640, 3), np.uint8)
SCENE = cv2.normalize(cv2.GaussianBlur(NOISE, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX)
DAMAGED_BYTES = 400


def encoded(compression: str, predictor: int = 1, **options: object) -> bytes:
    file = io.BytesIO()
    tags = {317: predictor} if predictor > 1 else {}
    PillowImage.fromarray(SCENE).save(file, "TIFF", compression=compression, tiffinfo=tags, **options)
    return file.getvalue()


def tiled(compression: str, path: Path) -> bytes:
    shape = {"width": SCENE.shape[1], "height": SCENE.shape[0], "count": 3, "dtype": "uint8"}
    layout = {"tiled": True, "blockxsize": 128, "blockysize": 128, "compress": compression, "bigtiff": "yes"}
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        file = rasterio.open(path, "w", driver="GTiff", **shape, **layout)
    with file:
        file.write(np.moveaxis(SCENE, -1, 0))
    return path.read_bytes()


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Zeros in the middle, away from the directory."""
    start = int(rng.integers(len(data) // 4, 3 * len(data) // 4))
    return data[:start] + bytes(DAMAGED_BYTES) + data[start + DAMAGED_BYTES :]


def check_damage_is_found(data: bytes, path: Path) -> None:
    path.write_bytes(data)
    whole = images.load(path).pixels
    assert whole.shape == SCENE.shape
    assert np.median(np.abs(whole[..., ::-1].astype(int) - SCENE)) <= 8
    rng = np.random.default_rng(11)
    for _ in range(6):
        path.write_bytes(damaged(data, rng))
        with pytest.raises(DamagedError, match=r"damaged|truncated"):
            images.load(path)
        assert "kept although" in images.load(path, keep_damaged=True).notes[-1]


@pytest.mark.parametrize(
    ("compression", "predictor"),
    [("tiff_lzw", 1), ("tiff_lzw", 2), ("tiff_deflate", 1), ("tiff_adobe_deflate", 2), ("jpeg", 1)],
)
def test_zeros_in_strips_are_found(tmp_path: Path, compression: str, predictor: int) -> None:
    check_damage_is_found(encoded(compression, predictor), tmp_path / "p.tif")


@pytest.mark.parametrize("compression", ["deflate", "lzw", "jpeg"])
def test_zeros_in_tiles_of_a_big_tiff_are_found(tmp_path: Path, compression: str) -> None:
    check_damage_is_found(tiled(compression, tmp_path / "t.tif"), tmp_path / "p.tif")


@pytest.mark.parametrize("compression", [1, 5, 8, 32946])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_whole_files_are_read_as_opencv_reads_them(tmp_path: Path, compression: int, dtype: type) -> None:
    path = tmp_path / "p.tif"
    # Pillow, which reads the header, knows float pixels in gray only.
    pixels = SCENE[..., 0] if dtype == np.float32 else SCENE
    assert cv2.imwrite(str(path), pixels.astype(dtype) * 3, [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    decoded, _, damage, _ = decode(path, read_header(path), keep_damaged=False)
    np.testing.assert_array_equal(decoded, cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    assert not damage
    if compression == 8 and dtype == np.uint16:
        path.write_bytes(damaged(path.read_bytes(), np.random.default_rng(1)))
        with pytest.raises(DamagedError, match="damaged"):
            images.load(path)


@pytest.mark.parametrize("gray", [True, False])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_lzw_is_turned_upright_as_opencv_turns_it(tmp_path: Path, orientation: int, *, gray: bool) -> None:
    path = tmp_path / "p.tif"
    pixels = SCENE[:70, :100, 0] if gray else SCENE[:70, :100]
    PillowImage.fromarray(pixels).save(path, compression="tiff_lzw", tiffinfo={274: orientation, 317: 2})
    decoded, *_ = decode(path, read_header(path), keep_damaged=False)
    expected = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_ANYCOLOR)
    np.testing.assert_array_equal(decoded, expected)


def unlike(kind: str) -> bytes:
    """The scene in a layout that OpenCV reads as other pixels than it holds."""
    file = io.BytesIO()
    if kind == "planes":
        shape = {"width": SCENE.shape[1], "height": SCENE.shape[0], "count": 3, "dtype": "uint16"}
        with rasterio.MemoryFile() as memory:
            with memory.open(driver="GTiff", photometric="RGB", interleave="band", compress="lzw", **shape) as raster:
                raster.write(np.moveaxis(SCENE, -1, 0).astype(np.uint16) * 257)
            return bytes(memory.read())
    PillowImage.fromarray(SCENE[..., 0].astype(np.uint16)).save(file, "TIFF", tiffinfo={262: 0})
    data = bytearray(file.getvalue())
    # Pillow writes black as 0 whatever it is asked for: the tag PhotometricInterpretation, SHORT, one value.
    at = data.index(struct.pack("<HHI", 262, 3, 1))
    data[at + 8 : at + 10] = bytes(2)
    return bytes(data)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize("kind", ["planes", "negative"])
def test_16_bits_that_opencv_reads_as_other_pixels_are_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "p.tif"
    path.write_bytes(unlike(kind))
    with pytest.raises(InputError, match=r"p.tif: .*; convert it"):
        images.load(path, keep_damaged=True)


@pytest.mark.parametrize(
    ("compression", "tag", "changed", "fault"),
    [
        ("tiff_deflate", 279, struct.pack("<H", 60000), "has no StripByteCounts"),
        ("jpeg", 273, struct.pack("<H", 60000), "has no StripOffsets"),
        ("tiff_deflate", 279, struct.pack("<HH", 279, 11), "slice"),
    ],
)
def test_a_missing_or_odd_tag_is_damage(tmp_path: Path, compression: str, tag: int, changed: bytes, fault: str) -> None:
    path, data = tmp_path / "p.tif", bytearray(encoded(compression))
    (directory,) = struct.unpack_from("<I", data, 4)
    at = data.index(struct.pack("<H", tag), directory)
    data[at : at + len(changed)] = changed
    path.write_bytes(data)
    with pytest.raises(InputError, match=rf"p\.tif: the TIFF is damaged .*{fault}"):
        images.load(path)


def test_a_decompression_bomb_in_a_strip_is_refused() -> None:
    data, limits = encoded("tiff_deflate"), {"area_px": SCENE.size // 3}
    check_tiff(data, Path("p.tif"), max_bytes=SCENE.nbytes, **limits)
    with pytest.raises(DamagedError, match="more data"):
        check_tiff(data, Path("p.tif"), max_bytes=SCENE.nbytes // 4, **limits)
