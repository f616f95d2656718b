"""Decodes image files of unknown origin; checks their headers first, and finds damage where the format can tell."""

import contextlib
import io
import re
import stat
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError
from PIL.ExifTags import Base

from golden_model.arrays import Pixels
from golden_model.config import MIN_FRAME_PX
from golden_model.small_files import open_regular, read_small_file
from skymosaic.common.errors import DamagedError, InputError, reading
from skymosaic.imagery.colour import convert_to_srgb
from skymosaic.imagery.jpeg import END, decode_strictly
from skymosaic.imagery.orientation import AXES, UPRIGHT, turn_pixels
from skymosaic.imagery.tiff import check_tiff

MAX_AREA_PX = 105_000_000
"""Room for cameras of 102 megapixels."""
MAX_DECODED_BYTES = 640_000_000
"""Room for the maximum area in colour at 16 bits. With the copies made by decoding and mapping to 8 bits, a photograph
stays below 2 GB."""
FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "PPM")
"""Pillow's names of the accepted formats. Every other decoder would be one more that meets hostile files."""
MAX_READS = 500_000
"""Limit of read operations on a header: a second of processor time. Pillow reads segments, chunks, directory entries
and comments one by one, in Python, and a file may declare hundreds of millions of them."""
SPARE_BYTES = 64_000_000
"""Limit of bytes read from a header, beyond the size of the file, because TIFF tags can all name the same bytes."""
NODATA_TAG, EXTRA_SAMPLES = 42113, 338
ASSOCIATED_ALPHA = 1
MAX_PAGES = 1000
"""More are not counted."""

# libtiff would print every unknown tag and fault, even where standard error is not ours to redirect.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

# Pillow reads the header first, and only warns about images beyond its limit, which is 89 megapixels unless it is set.
# `read_header` turns the error into a message of our own.
PillowImage.MAX_IMAGE_PIXELS = MAX_AREA_PX
warnings.filterwarnings("error", category=PillowImage.DecompressionBombWarning)


@dataclass(frozen=True)
class Header:
    """A picture as its file declares it."""

    kind: str
    """One of `FORMATS`, or MPO: a JPEG followed by further pictures, which Pillow opens as JPEG."""
    size: tuple[int, int]
    """Width and height as stored, px."""
    orientation: int
    """EXIF orientation, 1 to 8; 1 if it is missing or invalid."""
    sample_bytes: int
    """Size of a decoded value; 2 for 16 bits."""
    decoded_bytes: int
    """Size of the decoded pixels."""
    transparent: bool
    """It has an alpha channel or a transparent colour."""
    gray: bool
    """It has one value for each pixel, which is no colour of a palette."""
    nodata: float | None = None
    """The value that pixels without data have, as GDAL writes it into TIFF; the transparent level of a gray PNG."""
    pages: int = 1
    """Pictures of a TIFF, the first of which is read."""
    premultiplied: bool = False
    """Its colours are multiplied by alpha, of a TIFF."""
    profile: bytes = b""
    """The ICC profile of its colours."""


class _MeasuredFile(io.FileIO):
    """A file that refuses more read operations or bytes than the header of a photograph needs."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, opener=open_regular)
        self._bytes_left = path.stat().st_size + SPARE_BYTES
        self._reads_left = MAX_READS

    def read(self, size: int | None = -1, /) -> bytes:
        """Read like any file; ValueError beyond the limits."""
        data = super().read(-1 if size is None else size) or b""
        self._bytes_left -= len(data)
        self._reads_left -= 1
        if self._bytes_left < 0 or self._reads_left < 0:
            raise ValueError("it has far too many parts")
        return data


@contextlib.contextmanager
def open_header(path: Path) -> Iterator[PillowImage.Image]:
    """Context of a file opened by Pillow to read its header, for a second at most; `FORMATS` only."""
    with _MeasuredFile(path) as file, PillowImage.open(file, formats=FORMATS) as header:
        yield header


def check_file(path: Path, what: str) -> None:
    """Check that a path names a file with content.

    Raises
    ------
    InputError
        With the reason; ``what`` is what the path should name.
    """
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: no such file; check the path") from None
    # A name that is too long, or contains a NUL.
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)}); check the path") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: not a file; name {what}")
    if status.st_size == 0:
        raise InputError(f"{path}: the file is empty; copy it again from the camera")
    # Videos are read piece by piece, so they may be of any size.
    if status.st_size > MAX_DECODED_BYTES and what == "an image":
        raise InputError(f"{path}: larger than {MAX_DECODED_BYTES // 1_000_000} MB; reduce it first")


def read_header(path: Path, min_side_px: int = MIN_FRAME_PX) -> Header:
    """Read a header, and check the file's kind and declared size before anything is decoded.

    Raises
    ------
    InputError
        For a file that cannot be read, an unsupported kind, or too small or too large a picture.
    """
    check_file(path, "an image")
    try:
        with open_header(path) as header:
            # Pillow parses some chunks of PNG and WebP while it opens the file, but EXIF only on request.
            orientation, sizes = _orientation(header), _decoded_sizes(header, path)
            transparent, nodata = header.has_transparency_data, _nodata(header)
            gray = len(header.getbands()) == 1 and header.mode != "P"
            kind, size = str(header.format), header.size
            premultiplied = _tiff_tag(header, EXTRA_SAMPLES, 0) == (ASSOCIATED_ALPHA,)
            profile = header.info.get("icc_profile") or b""
            # Last, because it leaves the first picture.
            pages = _count_pages(header)
            declared = Header(kind, size, orientation, *sizes, transparent, gray, nodata, pages, premultiplied, profile)
    except UnidentifiedImageError:
        raise InputError(
            f"{path}: not an image that can be read; give PNG, JPEG, or TIFF of gray or RGB, 8 or 16 bits"
        ) from None
    except (PillowImage.DecompressionBombError, PillowImage.DecompressionBombWarning):
        raise InputError(f"{path}: larger than {MAX_AREA_PX // 1_000_000} megapixels; reduce it first") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)}); check the file") from None
    # Pillow's plugins raise ValueError, SyntaxError, struct.error, KeyError and others for invalid headers.
    except Exception as error:
        raise InputError(f"{path}: its header is damaged ({error}); copy it again from the camera") from None
    check_size(str(path), *declared.size, min_side_px)
    if declared.decoded_bytes > MAX_DECODED_BYTES:
        raise InputError(
            f"{path}: {declared.decoded_bytes // 1_000_000} MB when decoded, more than the "
            f"{MAX_DECODED_BYTES // 1_000_000} MB allowed; reduce it or convert it to 8 bits"
        )
    return declared


def check_size(name: str, width_px: int, height_px: int, min_side_px: int = MIN_FRAME_PX) -> None:
    """Raise InputError for a picture of an unsupported size."""
    if min(width_px, height_px) < min_side_px:
        raise InputError(
            f"{name}: {width_px}x{height_px} pixels is too small; at least {min_side_px}x{min_side_px} needed"
        )
    if width_px * height_px > MAX_AREA_PX:
        raise InputError(
            f"{name}: {width_px}x{height_px} is larger than {MAX_AREA_PX // 1_000_000} megapixels; reduce it first"
        )


def _orientation(header: PillowImage.Image) -> int:
    """The EXIF orientation; `UPRIGHT` where EXIF data is invalid, which makes no photograph unusable."""
    try:
        exif = PillowImage.Exif()
        # Not header.getexif(), which also reads XMP data. OpenCV does not, and a turn must not depend on the decoder.
        exif.load(header.info.get("exif", b""))
        (tiff,) = _tiff_tag(header, Base.Orientation)
        orientation = tiff if header.format == "TIFF" else exif.get(Base.Orientation, UPRIGHT)
        return orientation if type(orientation) is int and 1 <= orientation <= 8 else UPRIGHT
    # Text, 0/0 and truncated directories raise half a dozen kinds of errors.
    except Exception:
        return UPRIGHT


def _decoded_sizes(header: PillowImage.Image, path: Path) -> tuple[int, int]:
    """Sizes of a decoded value and of all of them."""
    width_px, height_px = header.size
    channels, depth_bytes = len(header.getbands()), 1
    if header.format == "TIFF":
        channels = max(channels, *_tiff_tag(header, Base.SamplesPerPixel))
        depth_bytes = -(-max(_tiff_tag(header, Base.BitsPerSample)) // 8)
    elif header.format == "PNG":
        # Pillow silently reduces 16-bit colour to 8 bits. The depth is the 25th byte of the file.
        with path.open("rb") as file:
            depth_bytes = -(-file.read(25)[24] // 8)
    elif header.mode.startswith(("I", "F")):
        depth_bytes = 4
    return depth_bytes, width_px * height_px * channels * depth_bytes


def _count_pages(header: PillowImage.Image) -> int:
    """How many pictures a TIFF has that are no overviews, thumbnails or masks; moves the header on to the last."""
    pages, first_px = 1, header.width * header.height
    # Up to a mask, which Pillow does not know, or to damage, which does not matter behind the first picture.
    with contextlib.suppress(Exception):
        for number in range(1, MAX_PAGES if header.format == "TIFF" else 1):
            header.seek(number)
            pages += header.width * header.height >= first_px
    return pages


def _nodata(header: PillowImage.Image) -> float | None:
    # OpenCV makes alpha of a transparent colour, but not of a gray level.
    if header.format == "PNG" and header.mode in ("L", "I;16"):
        return header.info.get("transparency")
    try:
        return float(getattr(header, "tag_v2", {})[NODATA_TAG].strip("\0 "))
    # It is text of unknown origin.
    except (KeyError, ValueError, AttributeError):
        return None


def _tiff_tag(header: PillowImage.Image, tag: int, default: int = 1) -> tuple[int, ...]:
    """The numbers of a TIFF tag, or its default."""
    value = getattr(header, "tag_v2", {}).get(tag, default)
    return value if isinstance(value, tuple) else (value,)


def decode(path: Path, header: Header, *, keep_damaged: bool) -> tuple[NDArray[np.generic], Pixels | None, str, str]:
    """Decode a file and turn it upright, in sRGB; pixels that show nothing get the values of their neighbours.

    Of a damaged JPEG or TIFF, with ``keep_damaged``, as much as possible is decoded.

    Returns
    -------
    pixels : ndarray, shape (H, W) or (H, W, 3) BGR
        Of the file's own type.
    visible : ndarray of uint8, shape (H, W), or None
        See `find_visible`.
    damage : str
        The report about a damaged file that is kept; else empty.
    colours : str
        The note about its colour profile; else empty.

    Raises
    ------
    InputError
        For a truncated, damaged or unsupported file; `DamagedError` if ``keep_damaged`` would help.
    """
    with reading(path, "check the file"):
        data = read_small_file(path, MAX_DECODED_BYTES)
    decoded, damage = _decode_data(path, header, data, keep_damaged=keep_damaged)
    visible = find_visible(decoded, header.nodata)
    pixels = np.ascontiguousarray(decoded[..., :3] if decoded.ndim == 3 else decoded)
    colours = convert_to_srgb(pixels, header.profile) if header.profile else ""
    return pixels if visible is None else fill_hidden(pixels, visible), visible, damage, colours


def _decode_data(path: Path, header: Header, data: bytes, *, keep_damaged: bool) -> tuple[NDArray[np.generic], str]:
    """The upright pixels of a file's bytes, with alpha where it has that, and what is damaged."""
    damage, area_px, is_tiff = "", header.size[0] * header.size[1], header.kind == "TIFF"
    try:
        if header.kind in ("JPEG", "MPO"):
            return decode_strictly(data, path, area_px=area_px, orientation=header.orientation), ""
        if (
            is_tiff
            and (checked := check_tiff(data, path, area_px=area_px, max_bytes=2 * MAX_DECODED_BYTES)) is not None
        ):
            return checked, ""
    except DamagedError as error:
        if not keep_damaged:
            raise
        # OpenCV decodes nothing of a JPEG without an end marker.
        damage, data = str(error), data if is_tiff else data + END
    if header.kind == "PNG" and b"IEND" not in data:
        raise InputError(f"{path}: the file is truncated; copy it again from the camera")
    # With alpha, OpenCV turns nothing but TIFF by itself.
    axes = AXES[header.orientation if header.transparent and not is_tiff else UPRIGHT]
    flags = cv2.IMREAD_UNCHANGED if header.transparent else cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH
    with contextlib.suppress(cv2.error, IndexError, ValueError):
        if (decoded := cv2.imdecode(np.frombuffer(data, np.uint8), flags)) is not None:
            if decoded.dtype == np.uint8 and data[:2] in (b"P5", b"P6"):
                # Netpbm's fourth word is the value of white, by which OpenCV does not scale.
                white = re.sub(rb"#.*", b"", data[:10_000]).split(maxsplit=4)[3]
                decoded = cv2.convertScaleAbs(decoded, alpha=255 / int(white))
            # Of 8 bits OpenCV returns colours that are multiplied by alpha, of 16 those of the file.
            if is_tiff and decoded.shape[2:] == (4,) and (decoded.dtype == np.uint8 or header.premultiplied):
                alpha = cv2.merge([decoded[..., 3]] * 3)
                decoded[..., :3] = cv2.divide(decoded[..., :3], alpha, scale=float(np.iinfo(decoded.dtype).max))
            return turn_pixels(decoded, axes), damage
    if damage:
        raise InputError(f"{damage}; nothing of it can be decoded")
    raise InputError(f"{path}: damaged or of an unsupported kind; convert it to PNG, JPEG or TIFF")


def find_visible(decoded: NDArray[Any], nodata: float | None) -> Pixels | None:
    """Find the pixels that show something.

    Parameters
    ----------
    decoded : ndarray, shape (H, W), (H, W, 3) or with alpha (H, W, 4)
        Upright pixels.
    nodata : float or None
        The value that pixels without data have.

    Returns
    -------
    ndarray of uint8, shape (H, W), or None
        255 where something is shown, else 0; None: everywhere, or nowhere, as of an alpha channel that nobody filled.
    """
    has_alpha, may_lack = decoded.shape[2:] == (4,), nodata is not None or decoded.dtype.kind == "f"
    if not has_alpha and not may_lack:
        return None
    shown = decoded[..., 3] > np.iinfo(decoded.dtype).max // 2 if has_alpha else np.ones(decoded.shape[:2], np.bool_)
    if may_lack:
        lacking = ~np.isfinite(decoded) | (decoded == nodata)
        shown &= ~(lacking if lacking.ndim == 2 else lacking[..., :3].all(axis=2))
    return None if shown.all() or not shown.any() else shown.astype(np.uint8) * np.uint8(255)


def fill_hidden(pixels: NDArray[np.generic], visible: Pixels) -> NDArray[np.generic]:
    """Give each pixel that shows nothing the value of the nearest one that does, so that no filter sees an edge."""
    _, labels = cv2.distanceTransformWithLabels(255 - visible, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.zeros(labels.max() + 1, np.intp)
    nearest[labels[visible > 0]] = np.flatnonzero(visible)
    return np.asarray(pixels.reshape(-1, *pixels.shape[2:])[nearest[labels]])


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
