"""Decodes JPEG files strictly: reports libjpeg's warnings as damage, and refuses files that take too long."""

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from skymosaic.common.errors import DamagedError, InputError
from skymosaic.imagery.orientation import AXES, turn_pixels

MAX_SCANS = 100
"""Progressive JPEG files have about ten. Every scan costs a pass over the whole picture, however short it is."""
MAX_SCANNED_AREA_PX = 1_200_000_000
"""Limit of scans times area: 15 s of processor time, measured by bench/photographs.py. The largest photograph may
have 11 scans."""
MAX_SEGMENTS = 100_000
END = b"\xff\xd9"
_KINDS = (0xC0, 0xC1, 0xC2)
"""Markers of baseline, extended and progressive JPEG with Huffman coding."""
_STARTS_OF_FRAME = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9
_WITHOUT_LENGTH = (0x01, 0xD8)
_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
"""In entropy-coded data, FF is followed by 00 or a restart marker. Further FF may precede a marker."""
_REVISION = re.compile(rb"\xff\xd8\xff\xe0..JFIF\x00", re.DOTALL)
"""The bytes before the JFIF revision."""
_HARMLESS = "unknown Adobe color transform"
"""A warning of libjpeg that does not concern the picture."""


def decode_strictly(data: bytes, path: Path, *, area_px: int, orientation: int) -> NDArray[np.uint8]:
    """Decode a JPEG in which libjpeg finds no fault, and turn it upright.

    OpenCV ignores libjpeg's warnings, and makes a photograph with a wrong block and wrong colours after it of a file
    with 400 zeroed bytes. Damage without a warning, mostly single flipped bits, goes unnoticed here too.

    Parameters
    ----------
    path : Path
        Name of the file, for messages.
    area_px : int
        Area that the header declares.
    orientation : int
        EXIF orientation, 1 to 8.

    Returns
    -------
    ndarray of uint8, shape (H, W) or (H, W, 3) BGR

    Raises
    ------
    DamagedError
        With libjpeg's warning.
    InputError
        For more scans than a photograph has, and for arithmetic coding, which no camera writes. Both take long, and a
        decoder cannot be interrupted.
    """
    kinds, scans, end = _parse(data, path)
    if not kinds.issubset(_KINDS):
        raise InputError(
            f"{path}: a JPEG with arithmetic coding, lossless or hierarchical; store it again as baseline JPEG"
        )
    if end is None:
        raise DamagedError(f"{path}: the file is truncated; copy it again from the camera")
    if scans > MAX_SCANS or scans * area_px > MAX_SCANNED_AREA_PX:
        raise InputError(f"{path}: a JPEG of {scans} scans takes too long to decode; store it again as baseline JPEG")
    fault = ""
    for candidate in _variants(_with_known_revision(data), end):
        try:
            pixels = _decode(candidate)
        except ValueError as error:
            fault = fault or str(error)
            continue
        return turn_pixels(pixels, AXES[orientation])
    raise DamagedError(f"{path}: the JPEG is damaged ({fault}); copy it again from the camera")


def _parse(data: bytes, path: Path) -> tuple[set[int], int, int | None]:
    """Kinds of frames, number of scans, and offset of the end of a file's first picture, None if it has none.

    Cameras append previews and films to the first picture, which are ignored.
    """
    kinds: set[int] = set()
    scans = 0
    for number, (marker, offset) in enumerate(_segments(data)):
        if number > MAX_SEGMENTS:
            raise InputError(f"{path}: a JPEG of more than {MAX_SEGMENTS} segments; store it again")
        if marker == _END_OF_IMAGE:
            return kinds, scans, offset
        scans += marker == _START_OF_SCAN
        kinds |= _STARTS_OF_FRAME & {marker}
    return kinds, scans, None


def _segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Markers and offsets of the segments, from the first one after the start of the image."""
    offset = 2
    while match := _MARKER.search(data, offset):
        marker = match[1][0]
        yield marker, match.start()
        offset = match.end()
        if marker not in _WITHOUT_LENGTH:
            offset += int.from_bytes(data[offset : offset + 2], "big")


def _with_known_revision(data: bytes) -> bytes:
    """Replace an unknown JFIF revision by 1, because libjpeg warns about it as it does about damage."""
    match = _REVISION.match(data)
    if match is None or data[match.end()] in (1, 2):
        return data
    return data[: match.end()] + b"\x01" + data[match.end() + 1 :]


def _decode(data: bytes, *, strict: bool = True) -> NDArray[np.uint8]:
    """Decode the stored pixels; ValueError for every warning of libjpeg that is not harmless."""
    try:
        _, _, colours, _ = simplejpeg.decode_jpeg_header(data, strict=strict)
        pixels = simplejpeg.decode_jpeg(data, "GRAY" if colours == "Gray" else "BGR", strict=strict)
    except ValueError as error:
        if not strict or _HARMLESS not in str(error):
            raise
        return _decode(data, strict=False)
    if colours in ("CMYK", "YCCK"):
        # There is no standard for CMYK in BGR; mosaics have always had OpenCV's conversion.
        flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), flags), dtype=np.uint8)
    return np.asarray(pixels[..., 0] if pixels.shape[2:] == (1,) else pixels, dtype=np.uint8)


def _variants(data: bytes, end: int) -> Iterator[bytes]:
    """The file, then the file without the zeros before its end marker, with which some cameras pad their files.

    libjpeg reports such padding like damage. Data overwritten with zeros is still detected in the second variant,
    because that ends too early.
    """
    yield data
    unpadded = data[:end].rstrip(b"\0")
    if len(unpadded) < end:
        yield unpadded + data[end:]
