"""JPEG files as cameras write them, and as nobody should: decoded as OpenCV does, or one line."""

import io
import re
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from skymosaic.common.errors import DamagedError, InputError
from skymosaic.imagery import images, jpeg

END = b"\xff\xd9"
NOISE = np.random.default_rng(3).integers(0, 256, (120, 160, 3), np.uint8)
SCENE = cv2.GaussianBlur(NOISE, (0, 0), 1.5)


def encoded(mode: str = "RGB", **options: object) -> bytes:
    file = io.BytesIO()
    PillowImage.fromarray(SCENE).convert(mode).save(file, "JPEG", **options)
    return file.getvalue()


def segment(marker: int, content: bytes) -> bytes:
    return bytes((0xFF, marker)) + struct.pack(">H", len(content) + 2) + content


def begun_by(parts: bytes, data: bytes | None = None) -> bytes:
    """A file with ``parts`` behind its start marker."""
    whole = data or encoded()
    return whole[:2] + parts + whole[2:]


def relabelled(kind: int) -> bytes:
    """A file that declares another kind of frame than it has."""
    return encoded().replace(b"\xff\xc0", bytes((0xFF, kind)), 1)


def filled() -> bytes:
    """Fill bytes before markers, also before restart markers."""
    data = cv2.imencode(".jpg", SCENE, [cv2.IMWRITE_JPEG_RST_INTERVAL, 2])[1].tobytes()
    for marker in (b"\xff\xc0", b"\xff\xda", b"\xff\xd3", END):
        data = data.replace(marker, b"\xff" * 7 + marker, 1)
    return data


ODD: dict[str, Callable[[], bytes]] = {
    "many segments of the maker": lambda: begun_by(
        b"".join(segment(0xE0 + n % 16, b"maker" + b"\xff\xda\xff\xd9" * 15_000) for n in range(1, 40))
    ),
    "a comment of full length": lambda: begun_by(segment(0xFE, b"x" * 65_533)),
    "fill bytes": filled,
    "CMYK": lambda: encoded("CMYK"),
    "Adobe, unknown transform": lambda: begun_by(segment(0xEE, b"Adobe\0\x64\0\0\0\0\x07")),
    "RGB": lambda: encoded(keep_rgb=True),
    "JFIF of a later revision": lambda: encoded().replace(b"JFIF\0\1\1", b"JFIF\0\3\1"),
    "an end marker in the thumbnail": lambda: begun_by(segment(0xE1, b"Exif\0\0" + encoded()[:3000] + END)),
    "a film behind the picture": lambda: encoded() + b"\xff\xda" * 500 + NOISE.tobytes(),
    "zeros before the end, a preview behind it": lambda: encoded()[:-2] + bytes(512) + END + encoded(),
    "extended": lambda: relabelled(0xC1),
    "progressive": lambda: encoded(progressive=True),
    "further pictures": lambda: encoded() + encoded("L"),
}


@pytest.mark.parametrize("name", ODD)
def test_what_cameras_write_is_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / "odd.jpg"
    path.write_bytes(ODD[name]())
    read = images.load(path)
    assert np.array_equal(read.pixels, np.asarray(cv2.imread(str(path))))
    assert read.notes == ()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (lambda: relabelled(0xC9), "arithmetic"),
        (lambda: relabelled(0xC3), "lossless"),
        (lambda: relabelled(0xC5), "hierarchical"),
        (lambda: begun_by(b"\xff\xd8"), "damaged"),
        (lambda: begun_by(b"\xff" * 600_000), "far too many parts"),
        (lambda: begun_by(b"\xff\xe5\0\2" * 300_000), "far too many parts"),
        (lambda: encoded()[:-2] + segment(0xFE, b"") * (jpeg.MAX_SEGMENTS + 1) + END, "segments"),
        # A comment between scans that holds an end marker does not hide the scans behind it.
        (lambda: encoded()[:-2] + segment(0xFE, END) + b"\xff\xda\0\2" * 200 + END, "201 scans"),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path: Path, data: Callable[[], bytes], says: str) -> None:
    path = tmp_path / "odd.jpg"
    path.write_bytes(data())
    with pytest.raises(InputError, match=rf"{re.escape(str(path))}: .*{says}") as caught:
        images.load(path)
    assert "\n" not in str(caught.value)


def test_a_damaged_file_is_refused_and_kept_on_request_as_far_as_it_goes(tmp_path: Path) -> None:
    (tmp_path / "whole.jpg").write_bytes(encoded())
    (tmp_path / "half.jpg").write_bytes(encoded()[: len(encoded()) // 2])
    with pytest.raises(DamagedError, match="truncated"):
        images.load(tmp_path / "half.jpg")
    whole = images.load(tmp_path / "whole.jpg").pixels
    kept = images.load(tmp_path / "half.jpg", keep_damaged=True)
    assert "truncated" in kept.notes[-1]
    assert np.array_equal(kept.pixels[:32], whole[:32])
    data = bytearray(cv2.imencode(".jpg", cv2.resize(SCENE, (640, 480)))[1].tobytes())
    middle = len(data) // 2
    data[middle : middle + 400] = bytes(400)
    path = tmp_path / "damaged.jpg"
    path.write_bytes(data)
    with pytest.raises(DamagedError, match=r"the JPEG is damaged \(.+\); copy it again from the camera$"):
        images.load(path)
    kept = images.load(path, keep_damaged=True)
    assert kept.size == (640, 480)
    assert "damaged" in kept.notes[-1]


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("mode", ["RGB", "L", "CMYK"])
def test_jpeg_pixels_are_those_of_opencv(tmp_path: Path, orientation: int, mode: str) -> None:
    exif = PillowImage.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "p.jpg"
    PillowImage.fromarray(SCENE).convert(mode).save(path, exif=exif, quality=90)
    assert np.array_equal(images.load(path).pixels, np.asarray(cv2.imread(str(path), cv2.IMREAD_ANYCOLOR)))


def test_the_limits_of_scans_and_of_their_area_are_valid() -> None:
    path, area_px = Path("p.jpg"), jpeg.MAX_SCANNED_AREA_PX
    jpeg.decode_strictly(encoded(), path, area_px=area_px, orientation=1)
    with pytest.raises(InputError, match="a JPEG of 1 scans takes too long to decode"):
        jpeg.decode_strictly(encoded(), path, area_px=area_px + 1, orientation=1)
    for scans, fault in ((100, "is damaged"), (101, "a JPEG of 101 scans takes too long")):
        data = encoded()[:-2] + b"\xff\xda\0\2" * (scans - 1) + END
        with pytest.raises(InputError, match=fault):
            jpeg.decode_strictly(data, path, area_px=1, orientation=1)
