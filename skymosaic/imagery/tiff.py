"""Finds what OpenCV does not tell of TIFF files: damage, after which it returns what is decoded, and other layouts."""

import io
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import ImageCms
from PIL.TiffTags import TAGS_V2

from skymosaic.common.errors import DamagedError, InputError
from skymosaic.imagery.jpeg import decode_strictly

_TAGS = {tag.name: number for number, tag in TAGS_V2.items()}
_LZW, _JPEG, _DEFLATE = 5, 7, (8, 32946)
"""Values of the tag Compression whose data shows damage. Uncompressed and PackBits data does not."""
_WHITE_IS_ZERO, _CIELAB = 0, 8
"""Values of the tag PhotometricInterpretation."""
_PLANES = 2
"""Value of the tag PlanarConfiguration: a plane for each colour."""
_CHUNK_BYTES = 1 << 20


def check_tiff(data: bytes, path: Path, *, area_px: int, max_bytes: int) -> NDArray[np.uint8] | None:
    """Check the data of a TIFF's first picture, as far as its compression can tell damage.

    Returns its pixels, (H, W, 3) BGR or (H, W, 4) with alpha, upright, if the check has decoded them: those that OpenCV
    would return, or the right ones of CIELAB, which it makes yellow, and behind alpha of 8 bits, which darkens them or
    is lost. ``area_px`` is what the header declares, ``max_bytes`` the limit of the decompressed size.

    Raises
    ------
    InputError
        For a layout of which OpenCV returns other pixels.
    DamagedError
        With what the decompressor found.
    """
    try:
        with PillowImage.open(io.BytesIO(data), formats=("TIFF",)) as picture:
            tags = picture.tag_v2  # type: ignore[attr-defined]
            compression, bits = tags.get(_TAGS["Compression"], 1), tags.get(_TAGS["BitsPerSample"], (1,))
            _check_layout(tags, bits, path)
            if compression == _LZW:
                # LZW has no checksum, but libtiff misses data, and Pillow makes that an error.
                picture.load()
                # Pillow reduces 16 bits to 8.
                if picture.mode == "RGB" and bits == (8, 8, 8):
                    return np.ascontiguousarray(np.asarray(picture, dtype=np.uint8)[..., ::-1])
            elif compression in _DEFLATE:
                _check_deflate(_segments(data, picture), max_bytes)
            elif compression == _JPEG:
                tables = tags.get(_TAGS["JPEGTables"], b"")
                for segment in _segments(data, picture):
                    # Without its end marker, the tables' file continues with the segment behind its start marker.
                    whole = tables[:-2] + segment[2:] if tables else segment
                    decode_strictly(whole, path, area_px=area_px, orientation=1)
            # Alpha in a plane of its own is beyond Pillow.
            apart = tags.get(_TAGS["PlanarConfiguration"]) == _PLANES
            if picture.mode in ("LA", "La", "RGBA") and bits[0] == 8 and not apart:
                straight = picture.convert("LA") if picture.mode == "La" else picture
                return np.asarray(straight.convert("RGBA"), dtype=np.uint8)[..., [2, 1, 0, 3]]
            if picture.mode == "LAB":
                # Here, because the transform has errors of its own.
                picture.load()
                lab, srgb = (ImageCms.createProfile(space) for space in ("LAB", "sRGB"))
                return np.asarray(ImageCms.profileToProfile(picture, lab, srgb, outputMode="RGB"))[..., ::-1].copy()
    except (InputError, MemoryError):
        raise
    # Pillow raises KeyError, TypeError, OverflowError and others beside the expected errors, where tags are odd.
    except Exception as error:
        raise DamagedError(f"{path}: the TIFF is damaged ({error}); copy it again from the camera") from None
    return None


def _check_layout(tags: Mapping[int, Any], bits: tuple[int, ...], path: Path) -> None:
    """Raise InputError for a layout of which OpenCV returns other pixels."""
    apart = len(bits) > 1 and tags.get(_TAGS["PlanarConfiguration"]) == _PLANES
    if bits[0] > 8 and (apart or tags.get(_TAGS["PhotometricInterpretation"]) in (_WHITE_IS_ZERO, _CIELAB)):
        raise InputError(
            f"{path}: of {bits[0]} bits, only gray from black to white and RGB pixel by pixel can be read; convert it "
            "(gdal_translate -co INTERLEAVE=PIXEL) or reduce it to 8 bits"
        )


def _segments(data: bytes, picture: PillowImage.Image) -> Iterator[bytes]:
    """The compressed strips or tiles; GDAL leaves out empty ones."""
    tags = picture.tag_v2  # type: ignore[attr-defined]
    kind = "Tile" if _TAGS["TileOffsets"] in tags else "Strip"
    names = f"{kind}Offsets", f"{kind}ByteCounts"
    if missing := [name for name in names if _TAGS[name] not in tags]:
        raise ValueError(f"it has no {missing[0]}")
    for offset, size in zip(*(tags[_TAGS[name]] for name in names), strict=True):
        if size:
            yield data[offset : offset + size]


def _check_deflate(segments: Iterator[bytes], max_bytes: int) -> None:
    """Decompress each segment to its checksum, a chunk at a time; ValueError or zlib.error where one is damaged."""
    total = 0
    for segment in segments:
        stream, rest = zlib.decompressobj(), segment
        while not stream.eof:
            length = len(stream.decompress(rest, _CHUNK_BYTES))
            rest = stream.unconsumed_tail
            total += length
            if not (length or rest or stream.eof):
                raise ValueError("its data ends early")
            if total > max_bytes:
                raise ValueError("more data than its picture has")
