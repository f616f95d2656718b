"""Writes pictures of any size band by band, so that the whole picture is never in memory."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.imagery.images import replacing, save

STREAMED_SUFFIXES = (".png", ".tif", ".tiff")
COMPRESSION_LEVEL = 3
"""zlib's level for PNG; higher levels take several times as long and save a few percent."""
TIFF_COMPRESSION_LEVEL = 1
STRIP_ROWS = 64
TIFF_SHORT_TAGS = (258, 259, 262, 277, 317)
"""Tags whose values are stored in 16 bits."""
LARGEST_CLASSIC_TIFF_BYTES = 3_900_000_000
"""Uncompressed size from which BigTIFF is written: classic TIFF's 32-bit offsets end at 4 GiB."""
_PNG_UP_FILTER = 2
_PNG_COLOUR_TYPE = {1: 0, 3: 2}


def write_bands(path: Path, size: tuple[int, int], channels: int, bands: Iterable[Pixels]) -> None:
    """Write a picture whose rows arrive in bands from the top.

    Parameters
    ----------
    path : Path
        PNG and TIFF are written as the bands arrive; for other formats, all bands are collected first.
    size : (int, int)
        Width and height, px.
    channels : {1, 3}
        Gray, or BGR.
    bands : iterable of ndarray of uint8, shape (rows, width) or (rows, width, 3)

    Raises
    ------
    InputError
        If the file cannot be written, for instance on a full disk; no partial file is left.
    """
    suffix = path.suffix.lower()
    if suffix not in STREAMED_SUFFIXES:
        save(path, np.concatenate(list(bands)))
        return
    with replacing(path) as temporary, temporary.open("wb") as file:
        (_write_png if suffix == ".png" else _write_tiff)(file, size, channels, _in_rgb(bands))


def _in_rgb(bands: Iterable[Pixels]) -> Iterator[Pixels]:
    for band in bands:
        yield band if band.ndim == 2 else np.asarray(cv2.cvtColor(band, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _write_png(file: BinaryIO, size: tuple[int, int], channels: int, bands: Iterable[Pixels]) -> None:
    """Write PNG (ISO 15948): one zlib stream with an IDAT chunk per band, and the "up" filter on every row."""
    file.write(b"\x89PNG\r\n\x1a\n")
    _write_chunk(file, b"IHDR", struct.pack(">IIBBBBB", *size, 8, _PNG_COLOUR_TYPE[channels], 0, 0, 0))
    compressor = zlib.compressobj(COMPRESSION_LEVEL)
    above = np.zeros(size[0] * channels, dtype=np.uint8)
    for band in bands:
        rows = band.reshape(len(band), -1)
        filtered = np.empty((len(rows), rows.shape[1] + 1), dtype=np.uint8)
        filtered[:, 0] = _PNG_UP_FILTER
        filtered[0, 1:] = rows[0] - above
        filtered[1:, 1:] = rows[1:] - rows[:-1]
        above = rows[-1].copy()
        _write_chunk(file, b"IDAT", compressor.compress(filtered.data))
    _write_chunk(file, b"IDAT", compressor.flush())
    _write_chunk(file, b"IEND", b"")


def _write_chunk(file: BinaryIO, kind: bytes, data: bytes) -> None:
    file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))


def _write_tiff(file: BinaryIO, size: tuple[int, int], channels: int, bands: Iterable[Pixels]) -> None:
    """Write TIFF 6.0 in strips, deflated with horizontal differencing; BigTIFF if 4 GB might not be enough."""
    big = size[0] * size[1] * channels > LARGEST_CLASSIC_TIFF_BYTES
    file.write(struct.pack("<2sHHHQ", b"II", 43, 8, 0, 0) if big else struct.pack("<2sHI", b"II", 42, 0))
    offsets, lengths = [], []
    for band in bands:
        for top in range(0, len(band), STRIP_ROWS):
            rows = band[top : top + STRIP_ROWS].reshape(-1, size[0], channels)
            differences = np.diff(rows, axis=1, prepend=np.zeros_like(rows[:, :1]))
            offsets.append(file.tell())
            lengths.append(file.write(zlib.compress(differences.data, TIFF_COMPRESSION_LEVEL)))
    tags = {
        256: [size[0]],
        257: [size[1]],
        258: [8] * channels,
        259: [8],  # deflate
        262: [2 if channels == 3 else 1],  # RGB, or black is zero
        273: offsets,
        277: [channels],
        278: [STRIP_ROWS],
        279: lengths,
        317: [2],  # each pixel minus its left neighbour
    }
    _write_directory(file, tags, big=big)


def _write_directory(file: BinaryIO, tags: dict[int, list[int]], *, big: bool) -> None:
    """Append the directory of tags, which must be in rising order, and write its offset into the file's header."""
    long_kind, long, count, inline_bytes = (16, "Q", "Q", 8) if big else (4, "I", "H", 4)
    entries = []
    for tag, values in tags.items():
        kind, letter = (3, "H") if tag in TIFF_SHORT_TAGS else (long_kind, long)
        encoded = struct.pack(f"<{len(values)}{letter}", *values)
        if len(encoded) > inline_bytes:
            offset = _to_even_end(file)
            file.write(encoded)
            encoded = struct.pack(f"<{long}", offset)
        entries.append(struct.pack(f"<HH{long}", tag, kind, len(values)) + encoded.ljust(inline_bytes, b"\0"))
    start = _to_even_end(file)
    file.write(struct.pack(f"<{count}", len(tags)) + b"".join(entries) + struct.pack(f"<{long}", 0))
    file.seek(8 if big else 4)
    file.write(struct.pack(f"<{long}", start))


def _to_even_end(file: BinaryIO) -> int:
    """Seek to the end of the file, or one byte further if that is odd: TIFF requires even offsets."""
    end = file.seek(0, 2)
    return file.seek(end + end % 2)
