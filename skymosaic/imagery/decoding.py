"""Decodes image files of unknown origin: checks what a file declares before it decodes, and JPEG files strictly."""

from __future__ import annotations

import contextlib
import stat
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError

from skymosaic.errors import DamagedError, InputError

SMALLEST_SIDE_PX = 64
LARGEST_AREA_PX = 89_000_000
"""Just below the limit of Pillow, which reads the header first."""
LARGEST_DECODED_BYTES = 600_000_000
"""The largest area in colour at 16 bits fits. With the copies that decoding and mapping to 8 bits make, a photograph
stays below 2 GB."""
MOST_SCANS = 100
"""Progressive JPEG files have about ten. Every scan costs a pass over the whole picture, however short it is."""
LARGEST_SCANNED_AREA_PX = 2_000_000_000
"""Limit of scans times area: about 15 s of processor time. The largest photograph may have 22 scans."""
FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "PPM")
"""Pillow's names of the formats that are read; every further decoder would be one more that meets hostile files."""
_ORIENTATION_TAG = 0x0112
_TIFF_BITS, _TIFF_SAMPLES = 258, 277
UPRIGHT = 1
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
_HARMLESS = ("unknown JFIF revision", "unknown Adobe color transform")
"""Warnings of libjpeg about headers, which say nothing about the picture."""

# libtiff warns about every tag it does not know, also where standard error is not ours to redirect.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)

# Pillow only warns about images beyond its limit; as an error, `read_header` can turn it into our own message.
warnings.filterwarnings("error", category=PillowImage.DecompressionBombWarning)


@dataclass(frozen=True)
class Header:
    """What a file declares about its picture.

    Attributes
    ----------
    kind : str
        One of `FORMATS`, or MPO: a JPEG with further pictures behind it, which Pillow opens as JPEG.
    size : (int, int)
        Width and height as stored, px.
    orientation : int
        EXIF's, 1 to 8; 1 where it is missing or invalid.
    decoded_bytes : int
        Size of the decoded pixels.
    """

    kind: str
    size: tuple[int, int]
    orientation: int
    decoded_bytes: int


def check_file(path: Path, what: str) -> None:
    """Check that a path names a file with content.

    Raises
    ------
    InputError
        With the reason; ``what`` says what should have been named.
    """
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: no such file; check the path") from None
    except (OSError, ValueError) as error:  # a name that is too long, or contains a NUL
        raise InputError(f"{path}: cannot be read ({_reason(error)}); check the path") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: not a file; name {what}")
    if status.st_size == 0:
        raise InputError(f"{path}: the file is empty; copy it again from the camera")
    if status.st_size > LARGEST_DECODED_BYTES and what == "an image":
        raise InputError(f"{path}: larger than {LARGEST_DECODED_BYTES // 1_000_000} MB; reduce it first")


def read_header(path: Path) -> Header:
    """Check a file's kind and the size it declares, before anything is decoded.

    Raises
    ------
    InputError
        For a file that cannot be read, is of another kind, or declares too small or too large a picture.
    """
    check_file(path, "an image")
    try:
        with PillowImage.open(path, formats=FORMATS) as header:
            # Pillow parses some chunks of PNG and WebP while it opens the file, EXIF only on request.
            found = Header(str(header.format), header.size, _orientation(header), _decoded_bytes(header, path))
    except UnidentifiedImageError:
        raise InputError(f"{path}: not an image that can be read; give PNG, JPEG or TIFF") from None
    except (PillowImage.DecompressionBombError, PillowImage.DecompressionBombWarning):
        raise InputError(f"{path}: larger than {LARGEST_AREA_PX // 1_000_000} megapixels; reduce it first") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)}); check the file") from None
    # Pillow's plugins raise ValueError, SyntaxError, struct.error, KeyError and others for invalid headers.
    except Exception as error:
        raise InputError(f"{path}: its header is damaged ({error}); copy it again from the camera") from None
    check_size(str(path), *found.size)
    if found.decoded_bytes > LARGEST_DECODED_BYTES:
        raise InputError(
            f"{path}: {found.decoded_bytes // 1_000_000} MB when decoded, more than the "
            f"{LARGEST_DECODED_BYTES // 1_000_000} MB allowed; reduce it or convert it to 8 bits"
        )
    return found


def check_size(name: str, width_px: int, height_px: int) -> None:
    """Raise InputError for a picture of an unsupported size."""
    if min(width_px, height_px) < SMALLEST_SIDE_PX:
        raise InputError(
            f"{name}: {width_px}x{height_px} pixels is too small; at least {SMALLEST_SIDE_PX}x{SMALLEST_SIDE_PX} needed"
        )
    if width_px * height_px > LARGEST_AREA_PX:
        raise InputError(
            f"{name}: {width_px}x{height_px} is larger than {LARGEST_AREA_PX // 1_000_000} megapixels; reduce it first"
        )


def _orientation(header: PillowImage.Image) -> int:
    """EXIF's orientation; invalid EXIF data does not make a photograph unusable."""
    try:
        exif = PillowImage.Exif()
        # Not header.getexif(), which also reads XMP data; OpenCV does not, and a turn must not depend on the decoder.
        exif.load(header.info.get("exif", b""))
        (tiff,) = _tiff_tag(header, _ORIENTATION_TAG)
        orientation = tiff if header.format == "TIFF" else exif.get(_ORIENTATION_TAG, UPRIGHT)
        return orientation if type(orientation) is int and orientation in _TURNS else UPRIGHT
    # Text, 0/0 and truncated directories raise half a dozen kinds of errors.
    except Exception:
        return UPRIGHT


def _decoded_bytes(header: PillowImage.Image, path: Path) -> int:
    width_px, height_px = header.size
    channels, depth_bytes = len(header.getbands()), 1
    if header.format == "TIFF":
        channels = max(channels, *_tiff_tag(header, _TIFF_SAMPLES))
        depth_bytes = -(-max(_tiff_tag(header, _TIFF_BITS)) // 8)
    elif header.format == "PNG":
        # Pillow reduces 16-bit colour to 8 bits and does not say so; the depth is the 25th byte of the file.
        with path.open("rb") as file:
            depth_bytes = -(-file.read(25)[24] // 8)
    elif header.mode.startswith(("I", "F")):
        depth_bytes = 4
    return width_px * height_px * channels * depth_bytes


def _tiff_tag(header: PillowImage.Image, tag: int) -> tuple[int, ...]:
    """The numbers of a TIFF tag; 1, the default of the tags that are read here, where it is missing."""
    found = getattr(header, "tag_v2", {}).get(tag, 1)
    return found if isinstance(found, tuple) else (found,)


def decode(path: Path, header: Header, *, keep_damaged: bool) -> tuple[NDArray[np.generic], str]:
    """Decode a file, turned upright.

    Parameters
    ----------
    path : Path
    header : Header
        From `read_header`.
    keep_damaged : bool
        Decode what can be decoded of a damaged JPEG.

    Returns
    -------
    pixels : ndarray, shape (H, W) or (H, W, 3) BGR
        Of the type that the file has.
    damage : str
        What libjpeg reports about a damaged JPEG that is kept; empty if it reports nothing.

    Raises
    ------
    InputError
        For a truncated, damaged or unsupported file; `DamagedError` where ``keep_damaged`` would help.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)}); check the file") from None
    damage = ""
    if header.kind in ("JPEG", "MPO"):
        try:
            return _strictly(data, path, header), ""
        except DamagedError as error:
            if not keep_damaged:
                raise
            damage = str(error)
    if header.kind == "PNG" and b"IEND" not in data:
        raise InputError(f"{path}: the file is truncated; copy it again from the camera")
    with contextlib.suppress(cv2.error):
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
        if decoded is not None:
            return decoded, damage
    raise InputError(f"{path}: damaged or of an unsupported kind; convert it to PNG, JPEG or TIFF")


def _strictly(data: bytes, path: Path, header: Header) -> NDArray[np.uint8]:
    """Decode a JPEG in which libjpeg finds no fault.

    OpenCV ignores libjpeg's warnings: a file with 400 zeroed bytes becomes a photograph with a wrong block and wrong
    colours after it. What the warnings do not cover, mostly single flipped bits, is not found here either.

    Raises
    ------
    DamagedError
        With libjpeg's warning.
    InputError
        For more scans than a photograph has: a decoder cannot be interrupted.
    """
    start = _scan_start(data)
    if data.find(b"\xff\xd9", start) < 0:
        raise DamagedError(f"{path}: the file is truncated; copy it again from the camera")
    # In entropy-coded data every byte FF is followed by 00 or a restart marker, so this finds scans only.
    scans = data.count(b"\xff\xda", start)
    if scans > MOST_SCANS or scans * header.size[0] * header.size[1] > LARGEST_SCANNED_AREA_PX:
        raise InputError(f"{path}: a JPEG of {scans} scans takes too long to decode; store it again as baseline JPEG")
    fault = ""
    for candidate in _variants(data):
        try:
            width_height = simplejpeg.decode_jpeg_header(candidate)
            pixels = simplejpeg.decode_jpeg(candidate, "GRAY" if width_height[2] == "Gray" else "BGR", strict=True)
        except ValueError as error:
            fault = fault or str(error)
            if not any(warning in str(error) for warning in _HARMLESS):
                continue
            pixels = simplejpeg.decode_jpeg(candidate, "GRAY" if width_height[2] == "Gray" else "BGR", strict=False)
        if width_height[2] in ("CMYK", "YCCK"):
            # Converting CMYK to BGR has no standard; OpenCV's result is the one that mosaics have always had.
            decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION)
            pixels = np.asarray(decoded, dtype=np.uint8)
        pixels = pixels[..., 0] if pixels.shape[2:] == (1,) else pixels
        return np.ascontiguousarray(_TURNS.get(header.orientation, np.asarray)(pixels))
    raise DamagedError(f"{path}: the JPEG is damaged ({fault}); copy it again from the camera")


def _variants(data: bytes) -> Iterator[bytes]:
    """The file, and the file without zeros before its end marker, with which some cameras pad their files.

    libjpeg reports such padding as it reports damage. Data that has been overwritten with zeros is still found in the
    second variant, because it then ends too early.
    """
    yield data
    end = data.rfind(b"\xff\xd9")
    unpadded = data[:end].rstrip(b"\0")
    if len(unpadded) < end:
        yield unpadded + data[end:]


def _scan_start(data: bytes) -> int:
    """Offset of the first scan; the end marker of an embedded thumbnail lies before it and must not be counted."""
    offset = 2
    while offset + 4 <= len(data) and data[offset] == 0xFF:
        if data[offset + 1] == 0xDA:
            return offset
        # A marker may be preceded by any number of fill bytes.
        offset += 1 if data[offset + 1] == 0xFF else 2 + int.from_bytes(data[offset + 2 : offset + 4], "big")
    return len(data)


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
