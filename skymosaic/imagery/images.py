"""Reads photographs and writes pictures; checks files here, so that every fault gets one clear message."""

from __future__ import annotations

import contextlib
import os
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError

from golden_model.arrays import Array, Pixels
from skymosaic.errors import InputError
from skymosaic.geometry.homography import resize_matrix

SMALLEST_SIDE_PX = 64
LARGEST_AREA_PX = 89_000_000
"""Just below the limit of Pillow, which reads the header first."""
OUTPUT_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp")
_ORIENTATION_TAG = 0x0112
_UPRIGHT = 1
_TAIL_PERCENT = 0.1
"""Share of pixels at each end of the range that is saturated when an image is mapped to 8 bits."""

# Pillow only warns about images beyond its limit; as an error, `_check_header` can turn it into our own message.
warnings.filterwarnings("error", category=PillowImage.DecompressionBombWarning)


@dataclass(frozen=True)
class Photograph:
    """A decoded photograph.

    Attributes
    ----------
    name : str
        The file as given, or ``"image N"`` for an array.
    pixels : ndarray of uint8, shape (H, W) or (H, W, 3)
        Gray or BGR, turned upright by the EXIF orientation.
    notes : tuple of str
        Changes made to the file's pixels: rotation applied, range mapped to 8 bits.
    """

    name: str
    pixels: Pixels
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]


def load(source: str | Path | Pixels, name: str = "image") -> Photograph:
    """Read a file, or check an array of pixels.

    Raises
    ------
    InputError
        Missing, empty, truncated, not an image, of an unsupported depth, or of an unsupported size.
    """
    if isinstance(source, str | Path):
        return _read(Path(source))
    if source.dtype != np.uint8 or source.ndim not in (2, 3) or (source.ndim == 3 and source.shape[2] != 3):
        raise InputError(
            f"{name}: an array of {source.dtype}, shape {source.shape}; give uint8 of shape (H, W) or (H, W, 3) BGR"
        )
    _check_size(name, source.shape[1], source.shape[0])
    return Photograph(name, source)


def _read(path: Path) -> Photograph:
    name = str(path)
    orientation = _check_header(path)
    encoded = np.fromfile(path, dtype=np.uint8)
    if _is_truncated(encoded.tobytes()):
        raise InputError(f"{name}: the file is truncated; copy it again from the camera")
    with contextlib.suppress(cv2.error):
        decoded = cv2.imdecode(encoded, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
        if decoded is not None:
            pixels, mapping = to_8_bit(decoded, name)
            turned = ("turned upright by its EXIF orientation",) if orientation != _UPRIGHT else ()
            return Photograph(name, pixels, turned + mapping)
    raise InputError(f"{name}: damaged or of an unsupported kind; convert it to PNG, JPEG or TIFF")


def _check_header(path: Path) -> int:
    """Check a file's size and kind before anything is decoded; returns the EXIF orientation."""
    if not path.exists():
        raise InputError(f"{path}: no such file; check the path")
    if not path.is_file():
        raise InputError(f"{path}: not a file; name an image")
    try:
        if path.stat().st_size == 0:
            raise InputError(f"{path}: the file is empty; copy it again from the camera")
        with PillowImage.open(path) as header:
            _check_size(str(path), *header.size)
            return int(header.getexif().get(_ORIENTATION_TAG, _UPRIGHT))
    except UnidentifiedImageError:
        raise InputError(f"{path}: not an image that can be read; give PNG, JPEG or TIFF") from None
    except (PillowImage.DecompressionBombError, PillowImage.DecompressionBombWarning):
        raise InputError(f"{path}: larger than {LARGEST_AREA_PX // 1_000_000} megapixels; reduce it first") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the file") from None


def _check_size(name: str, width_px: int, height_px: int) -> None:
    if min(width_px, height_px) < SMALLEST_SIDE_PX:
        raise InputError(
            f"{name}: {width_px}x{height_px} pixels is too small; at least {SMALLEST_SIDE_PX}x{SMALLEST_SIDE_PX} needed"
        )
    if width_px * height_px > LARGEST_AREA_PX:
        raise InputError(
            f"{name}: {width_px}x{height_px} is larger than {LARGEST_AREA_PX // 1_000_000} megapixels; reduce it first"
        )


def _is_truncated(data: bytes) -> bool:
    """Whether a JPEG or PNG lacks its end; OpenCV would silently fill the missing part with gray."""
    if data.startswith(b"\x89PNG"):
        return b"IEND" not in data[-64:] and b"IEND" not in data
    if data.startswith(b"\xff\xd8"):
        return data.find(b"\xff\xd9", _jpeg_scan_start(data)) < 0
    return False


def _jpeg_scan_start(data: bytes) -> int:
    """Offset of the first scan; the end marker of an embedded thumbnail lies before it and must not be counted."""
    offset = 2
    while offset + 4 <= len(data) and data[offset] == 0xFF:
        if data[offset + 1] == 0xDA:
            return offset
        offset += 2 + int.from_bytes(data[offset + 2 : offset + 4], "big")
    return len(data)


def to_8_bit(decoded: NDArray[np.generic], name: str) -> tuple[Pixels, tuple[str, ...]]:
    """Map 16-bit and floating-point pixels linearly to 8 bits; the outer 0.1 % at each end saturate.

    Parameters
    ----------
    decoded : ndarray of uint8, uint16 or float32
    name : str
        For messages.

    Returns
    -------
    pixels : ndarray of uint8
    notes : tuple of str
        The mapping in words; empty if the image had 8 bits.

    Raises
    ------
    InputError
        For other types, or an image without a finite value.
    """
    if decoded.dtype == np.uint8:
        return decoded.astype(np.uint8, copy=False), ()
    if decoded.dtype not in (np.uint16, np.float32):
        raise InputError(f"{name}: pixels of {decoded.dtype} are not supported; convert to 8 or 16 bit")
    finite = decoded[np.isfinite(decoded)] if decoded.dtype == np.float32 else decoded
    if finite.size == 0:
        raise InputError(f"{name}: no pixel has a finite value; export it again")
    low, high = np.percentile(finite, (_TAIL_PERCENT, 100 - _TAIL_PERCENT))
    scale = 255.0 / max(float(high - low), 1e-12)
    levels = np.nan_to_num((decoded.astype(np.float32) - np.float32(low)) * np.float32(scale), posinf=255, neginf=0)
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8), (f"{decoded.dtype}: {low:g}..{high:g} mapped to 0..255",)


def reduced(pixels: Pixels, width_px: int) -> tuple[Pixels, Array]:
    """Reduce an image by area averaging to at most ``width_px``; a narrower one stays as it is.

    Returns
    -------
    pixels : ndarray of uint8
    to_original : ndarray of float64, shape (3, 3)
        Maps reduced pixels to original ones, with pixel centres at integers.
    """
    height, width = pixels.shape[:2]
    if width <= width_px:
        return pixels, np.eye(3)
    size = (width_px, max(round(height * width_px / width), 1))
    to_original = resize_matrix(width / size[0], height / size[1])
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False), to_original


def check_output(path: Path, inputs: tuple[str, ...] = (), suffixes: tuple[str, ...] = OUTPUT_SUFFIXES) -> None:
    """Check that an output file can be written, before the computation starts.

    Raises
    ------
    InputError
        For an unknown suffix, a folder that is missing or not writable, or one of the ``inputs``.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: unknown kind of file; end the name in one of {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: its folder does not exist; create it first")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: cannot be written; choose another folder")
    if any(Path(source).resolve() == path.resolve() for source in inputs):
        raise InputError(f"{path}: is one of the inputs; choose another name")


def save(path: Path, pixels: Pixels) -> None:
    """Write a picture under a temporary name, then rename it, so that no half-written file can remain.

    Raises
    ------
    InputError
        If it cannot be encoded (for instance a JPEG beyond 65535 pixels) or written.
    """
    encoded = None
    with contextlib.suppress(cv2.error):
        done, encoded = cv2.imencode(path.suffix, pixels)
        encoded = encoded if done else None
    if encoded is None:
        raise InputError(
            f"{path}: {pixels.shape[1]}x{pixels.shape[0]} cannot be stored as {path.suffix}; use .png or .tif"
        )
    save_bytes(path, encoded.tobytes())


def save_bytes(path: Path, data: bytes) -> None:
    """Write ``data`` under a temporary name beside ``path``, then rename it."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Context of a temporary file beside ``path``: renamed to ``path`` at the end, deleted on any failure.

    Raises
    ------
    InputError
        If writing fails: no permission, a full disk.
    """
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = Path(file.name)
        yield temporary
        # Temporary files are created for their owner only; give the result the usual permissions.
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); choose another folder") from None
    finally:
        if temporary:
            temporary.unlink(missing_ok=True)


def _umask() -> int:
    # The mask can only be read by setting it.
    mask = os.umask(0)
    os.umask(mask)
    return mask
