"""Decodes JPEG files strictly: finds what libjpeg reports as damage, and refuses what takes too long to decode."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from skymosaic.errors import DamagedError, InputError

MAX_SCANS = 100
"""Progressive JPEG files have about ten. Every scan costs a pass over the whole picture, however short it is."""
MAX_SCANNED_AREA_PX = 1_200_000_000
"""Limit of scans times area: at most 15 s of processor time, measured by bench/large_photographs.py. The largest
photograph may have 13 scans."""
MAX_SEGMENTS = 100_000
END = b"\xff\xd9"
_KINDS = (0xC0, 0xC1, 0xC2)
"""Baseline, extended and progressive, with Huffman coding."""
_STARTS_OF_FRAME = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9
_WITHOUT_LENGTH = (0x01, 0xD8)
_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
"""In entropy-coded data, FF is followed by 00 or a restart marker; before a marker there may be further FF."""
_TURNS: dict[int, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
    2: np.fliplr,
    3: lambda pixels: np.rot90(pixels, 2),
    4: np.flipud,
    5: lambda pixels: pixels.swapaxes(0, 1),
    6: lambda pixels: np.rot90(pixels, 3),
    7: lambda pixels: np.rot90(pixels, 2).swapaxes(0, 1),
    8: np.rot90,
}
"""How the stored pixels become upright, by the values of EXIF's orientation."""
_REVISION = re.compile(rb"\xff\xd8\xff\xe0..JFIF\x00", re.DOTALL)
"""What is before the number of the JFIF revision."""
_HARMLESS = "unknown Adobe color transform"
"""A warning of libjpeg that says nothing about the picture."""


@dataclass(frozen=True)
class _Structure:
    """What the segments of a file's first picture say: kinds of frames, number of scans, and where it ends.

    Cameras write previews and films behind the first picture; they are not looked at.
    """

    kinds: frozenset[int]
    scans: int
    end: int | None


def decode_strictly(data: bytes, path: Path, *, area_px: int, orientation: int) -> NDArray[np.uint8]:
    """Decode a JPEG in which libjpeg finds no fault, and turn it upright.

    OpenCV ignores libjpeg's warnings: a file with 400 zeroed bytes becomes a photograph with a wrong block and wrong
    colours after it. What the warnings do not cover, mostly single flipped bits, is not found here either.

    Parameters
    ----------
    data : bytes
    path : Path
        For messages.
    area_px : int
        As the header declares it.
    orientation : int
        EXIF's, 1 to 8.

    Returns
    -------
    ndarray of uint8, shape (H, W) or (H, W, 3) BGR

    Raises
    ------
    DamagedError
        With libjpeg's warning.
    InputError
        For more scans than a photograph has, and for arithmetic coding, which no camera writes: both take long, and a
        decoder cannot be interrupted.
    """
    structure = _structure(data, path)
    if not structure.kinds.issubset(_KINDS):
        raise InputError(
            f"{path}: a JPEG with arithmetic coding, lossless or hierarchical; store it again as baseline JPEG"
        )
    if structure.end is None:
        raise DamagedError(f"{path}: the file is truncated; copy it again from the camera")
    if structure.scans > MAX_SCANS or structure.scans * area_px > MAX_SCANNED_AREA_PX:
        raise InputError(
            f"{path}: a JPEG of {structure.scans} scans takes too long to decode; store it again as baseline JPEG"
        )
    fault = ""
    for candidate in _variants(_of_known_revision(data), structure.end):
        try:
            pixels = _decoded(candidate)
        except ValueError as error:
            fault = fault or str(error)
            continue
        return np.ascontiguousarray(_TURNS.get(orientation, np.asarray)(pixels))
    raise DamagedError(f"{path}: the JPEG is damaged ({fault}); copy it again from the camera")


def _structure(data: bytes, path: Path) -> _Structure:
    kinds: set[int] = set()
    scans = 0
    for number, (marker, offset) in enumerate(_segments(data)):
        if number > MAX_SEGMENTS:
            raise InputError(f"{path}: a JPEG of more than {MAX_SEGMENTS} segments; store it again")
        if marker == _END_OF_IMAGE:
            return _Structure(frozenset(kinds), scans, offset)
        scans += marker == _START_OF_SCAN
        kinds |= _STARTS_OF_FRAME & {marker}
    return _Structure(frozenset(kinds), scans, None)


def _segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Markers and offsets of the segments, from the first one behind the start of the image."""
    offset = 2
    while found := _MARKER.search(data, offset):
        marker = found[1][0]
        yield marker, found.start()
        offset = found.end()
        if marker not in _WITHOUT_LENGTH:
            offset += int.from_bytes(data[offset : offset + 2], "big")


def _of_known_revision(data: bytes) -> bytes:
    """The file with JFIF revision 1 instead of an unknown one, of which libjpeg warns as it warns of damage."""
    found = _REVISION.match(data)
    if found is None or data[found.end()] in (1, 2):
        return data
    return data[: found.end()] + b"\x01" + data[found.end() + 1 :]


def _decoded(data: bytes) -> NDArray[np.uint8]:
    """The stored pixels; ValueError for anything that libjpeg warns of, apart from what is harmless."""
    try:
        return _decoded_by_libjpeg(data, strict=True)
    except ValueError as error:
        if _HARMLESS not in str(error):
            raise
        return _decoded_by_libjpeg(data, strict=False)


def _decoded_by_libjpeg(data: bytes, *, strict: bool) -> NDArray[np.uint8]:
    _, _, colours, _ = simplejpeg.decode_jpeg_header(data, strict=strict)
    pixels = simplejpeg.decode_jpeg(data, "GRAY" if colours == "Gray" else "BGR", strict=strict)
    if colours in ("CMYK", "YCCK"):
        # Converting CMYK to BGR has no standard; OpenCV's result is the one that mosaics have always had.
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        pixels = np.asarray(decoded, dtype=np.uint8)
    return np.asarray(pixels[..., 0] if pixels.shape[2:] == (1,) else pixels, dtype=np.uint8)


def _variants(data: bytes, end: int) -> Iterator[bytes]:
    """The file, and the file without zeros before its end marker, with which some cameras pad their files.

    libjpeg reports such padding as it reports damage. Data that has been overwritten with zeros is still found in the
    second variant, because it then ends too early.
    """
    yield data
    unpadded = data[:end].rstrip(b"\0")
    if len(unpadded) < end:
        yield unpadded + data[end:]
