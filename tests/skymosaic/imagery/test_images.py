import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from skymosaic.errors import DamagedError, InputError
from skymosaic.imagery import decoding, images


def photograph(height: int = 96, width: int = 128) -> np.ndarray:
    rng = np.random.default_rng(7)
    return cv2.GaussianBlur(rng.integers(0, 256, (height, width, 3), dtype=np.uint8), (0, 0), 2)


def test_reads_colour_and_gray_as_they_are(tmp_path: Path) -> None:
    colour = photograph()
    cv2.imwrite(str(tmp_path / "c.png"), colour)
    cv2.imwrite(str(tmp_path / "g.png"), colour[..., 0])
    assert np.array_equal(images.load(tmp_path / "c.png").pixels, colour)
    assert np.array_equal(images.load(tmp_path / "g.png").pixels, colour[..., 0])


def test_exif_rotation_is_applied_once_and_stated(tmp_path: Path) -> None:
    upright = photograph()
    exif = PillowImage.Exif()
    exif[0x0112] = 6  # stored turned a quarter counter-clockwise: shown turned clockwise
    stored = np.rot90(upright)[..., ::-1]
    PillowImage.fromarray(np.ascontiguousarray(stored)).save(tmp_path / "r.jpg", exif=exif, quality=98, subsampling=0)
    read = images.load(tmp_path / "r.jpg")
    assert read.size == (128, 96)
    assert np.abs(read.pixels.astype(int) - upright).mean() < 3
    assert "EXIF" in read.notes[0]


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_deep_pixels_are_mapped_to_8_bit_and_the_mapping_is_stated(tmp_path: Path, dtype: type) -> None:
    thermal = np.linspace(27_000, 31_000, 96 * 128).reshape(96, 128).astype(dtype)
    cv2.imwrite(str(tmp_path / "t.tiff"), thermal)
    read = images.load(tmp_path / "t.tiff")
    assert read.pixels.dtype == np.uint8
    assert read.pixels.min() == 0
    assert read.pixels.max() == 255
    assert np.all(np.diff(read.pixels.ravel().astype(int)) >= 0)
    assert "mapped to 0..255" in read.notes[0]


def _text(path: Path) -> None:
    path.write_text("no picture at all, only words " * 10)


def _empty(path: Path) -> None:
    path.touch()


def _small(path: Path) -> None:
    cv2.imwrite(str(path), photograph(10, 10))


def _truncated(path: Path) -> None:
    path.write_bytes(cv2.imencode(".png", photograph())[1].tobytes()[:-3000])


def _truncated_jpeg(path: Path) -> None:
    path.write_bytes(cv2.imencode(".jpg", photograph())[1].tobytes()[:-600])


def _folder(path: Path) -> None:
    path.mkdir()


def _missing(path: Path) -> None:
    pass


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (_text, "not an image"),
        (_empty, "empty"),
        (_small, "too small"),
        (_truncated, "truncated"),
        (_truncated_jpeg, "truncated"),
        (_folder, "not a file"),
        (_missing, "no such file"),
    ],
)
def test_a_bad_file_gets_one_line_that_names_it(tmp_path: Path, make, says: str) -> None:
    path = tmp_path / "bad.png"
    make(path)
    with pytest.raises(InputError) as caught:
        images.load(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_huge_header_is_refused_before_decoding(tmp_path: Path) -> None:
    header = bytearray(cv2.imencode(".png", photograph())[1].tobytes())
    header[16:24] = (60_000).to_bytes(4, "big") * 2
    header[29:33] = zlib.crc32(bytes(header[12:29])).to_bytes(4, "big")
    (tmp_path / "bomb.png").write_bytes(bytes(header))
    with pytest.raises(InputError, match="megapixels"):
        images.load(tmp_path / "bomb.png")


def test_an_array_of_the_wrong_kind_is_refused() -> None:
    with pytest.raises(InputError, match="uint8"):
        images.load(np.zeros((100, 100), np.float32), "left image")


def test_reduced_keeps_pixel_centres(tmp_path: Path) -> None:
    wide = np.zeros((600, 2000), np.uint8)
    small, to_original = images.reduce_to_width(wide, 1000)
    assert small.shape == (300, 1000)
    assert np.allclose(to_original @ [0, 0, 1], [0.5, 0.5, 1])
    assert np.allclose(to_original @ [999, 299, 1], [1998.5, 598.5, 1])


def test_nothing_half_written_is_left_where_writing_fails(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be stored"):
        images.save(tmp_path / "wide.jpg", np.zeros((1, 70_000), np.uint8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["m.xyz", "missing/m.png"])
def test_an_unwritable_output_is_refused_before_the_work(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError):
        images.check_output(tmp_path / name)


def test_an_input_is_never_overwritten(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one of the inputs"):
        images.check_output(tmp_path / "a.png", (str(tmp_path / "a.png"),))


def test_a_jpeg_damaged_in_its_middle_is_refused_and_kept_on_request(tmp_path: Path) -> None:
    data = bytearray(cv2.imencode(".jpg", photograph(480, 640))[1].tobytes())
    middle = len(data) // 2
    data[middle : middle + 400] = bytes(400)
    path = tmp_path / "damaged.jpg"
    path.write_bytes(data)
    with pytest.raises(DamagedError, match="JPEG is damaged"):
        images.load(path)
    kept = images.load(path, keep_damaged=True)
    assert kept.size == (640, 480)
    assert "damaged" in kept.notes[-1]


def test_padding_before_the_end_marker_is_no_damage(tmp_path: Path) -> None:
    data = cv2.imencode(".jpg", photograph())[1].tobytes()
    (tmp_path / "plain.jpg").write_bytes(data)
    (tmp_path / "padded.jpg").write_bytes(data[:-2] + bytes(50) + data[-2:] + b"preview of the camera")
    plain, padded = (images.load(tmp_path / f"{name}.jpg") for name in ("plain", "padded"))
    assert np.array_equal(plain.pixels, padded.pixels)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("mode", ["RGB", "L", "CMYK"])
def test_jpeg_pixels_are_those_of_opencv(tmp_path: Path, orientation: int, mode: str) -> None:
    exif = PillowImage.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "p.jpg"
    PillowImage.fromarray(photograph()).convert(mode).save(path, exif=exif, quality=90)
    assert np.array_equal(images.load(path).pixels, cv2.imread(str(path), cv2.IMREAD_ANYCOLOR))


def test_a_jpeg_of_many_scans_is_refused_before_decoding(tmp_path: Path) -> None:
    PillowImage.fromarray(photograph()).save(tmp_path / "p.jpg", progressive=True)
    data = (tmp_path / "p.jpg").read_bytes()
    images.load(tmp_path / "p.jpg")
    last = data.rindex(b"\xff\xda")
    (tmp_path / "p.jpg").write_bytes(data[:-2] + data[last:-2] * 200 + data[-2:])
    with pytest.raises(InputError, match="scans"):
        images.load(tmp_path / "p.jpg")


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


@pytest.mark.parametrize("value", ["text", (0, 0), float("nan"), 99])
def test_an_invalid_orientation_counts_as_upright(tmp_path: Path, value: object, monkeypatch) -> None:
    PillowImage.fromarray(photograph()).save(tmp_path / "p.jpg")
    monkeypatch.setattr(PillowImage.Exif, "get", lambda *_: value)
    assert decoding.read_header(tmp_path / "p.jpg").orientation == 1


def test_a_tall_image_is_reduced_by_its_height() -> None:
    small, to_original = images.reduce_to_width(np.zeros((4200, 500), np.uint8), 1280)
    assert small.shape == (2560, 305)
    assert np.allclose(to_original[1] @ [0, 2559.5, 1], 4199.5)


def test_an_image_that_becomes_too_narrow_is_named() -> None:
    with pytest.raises(InputError, match=r"pano\.jpg: 16000x700 is reduced to 1280x56"):
        images.reduce_for_front_end(np.zeros((700, 16000), np.uint8), 1280, "pano.jpg")


def test_names_cannot_write_to_the_terminal(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        images.load(tmp_path / "a\n\x1b[31m\u202ename.jpg")
    assert str(caught.value).endswith("a\\n\\x1b[31m\\u202ename.jpg: no such file; check the path")


def test_a_name_that_is_too_long_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="too long"):
        images.load(tmp_path / ("x" * 300 + ".jpg"))
