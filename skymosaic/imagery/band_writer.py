"""Writes PNG pictures of any size band by band, so the whole picture is never in memory."""

import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.common.temporary import write_atomically

COMPRESSION_LEVEL = 3
"""zlib's level for PNG. Higher levels take several times as long and save a few percent."""
_PNG_UP_FILTER = 2
_PNG_COLOUR_TYPE = {1: 0, 3: 2}


def write_png(path: Path, size: tuple[int, int], channels: int, bands: Iterable[Pixels]) -> None:
    """Write a PNG (ISO 15948) of 8 bits, with 1 channel or 3, whose rows arrive in bands from the top.

    It is one zlib stream with an IDAT chunk for each band, and the "up" filter on every row.

    Raises
    ------
    InputError
        If the file cannot be written, for instance on a full disk; no partial file is left.
    """
    with write_atomically(path) as temporary, temporary.open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        _write_chunk(file, b"IHDR", struct.pack(">IIBBBBB", *size, 8, _PNG_COLOUR_TYPE[channels], 0, 0, 0))
        compressor = zlib.compressobj(COMPRESSION_LEVEL)
        above = np.zeros((1, size[0] * channels), dtype=np.uint8)
        for band in bands:
            rows = (band if band.ndim == 2 else cv2.cvtColor(band, cv2.COLOR_BGR2RGB)).reshape(len(band), -1)
            filtered = np.full((len(rows), rows.shape[1] + 1), _PNG_UP_FILTER, dtype=np.uint8)
            # Differences of bytes wrap around, as PNG's filters require.
            filtered[:, 1:] = np.diff(rows, axis=0, prepend=above)
            above = rows[-1:].copy()
            _write_chunk(file, b"IDAT", compressor.compress(filtered.data))
        _write_chunk(file, b"IDAT", compressor.flush())
        _write_chunk(file, b"IEND", b"")


def _write_chunk(file: BinaryIO, kind: bytes, data: bytes) -> None:
    file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))
