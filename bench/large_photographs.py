"""Processor time and memory of the largest photographs: ``python bench/large_photographs.py``.

Each file is written by one process and read by another one, as the command line reads it: EXIF, header, decoding, 8
bits, and the reduction for the front end. The limits are those of docs/reliability.md.
"""

from __future__ import annotations

import argparse
import json
import resource
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
from PIL import Image as PillowImage

from skymosaic.errors import InputError
from skymosaic.imagery import images
from skymosaic.imagery.exif import read_metadata
from skymosaic.registration.options import WORKING_WIDTH_PX

MOST_SECONDS = 20.0
MOST_MEMORY_MB = 2048
SIZES = {20: (5472, 3648), 50: (8660, 5773), 89: (11540, 7690)}
"""Megapixels: width and height."""


def scene(megapixels: int, dtype: type[np.generic] = np.uint8, channels: int = 3) -> np.ndarray:
    """Noise over a blurred pattern: about as many bits a pixel as a sharp photograph of foliage."""
    width, height = SIZES[megapixels]
    rng = np.random.default_rng(3)
    tile = (
        cv2.GaussianBlur(rng.integers(0, 256, (512, 512, channels), np.uint8), (0, 0), 2).astype(np.float32) * 3 - 256
    )
    tile = (tile + rng.normal(0, 6, tile.shape)).clip(0, 255)
    if dtype is np.uint16:
        tile = tile * 257
    repeats = -(-height // 512), -(-width // 512), 1
    tile = tile.reshape(512, 512, channels).astype(dtype)
    return np.squeeze(np.tile(tile, repeats)[:height, :width])


def by_opencv(path: Path, pixels: np.ndarray, *options: int) -> None:
    """Write a file with OpenCV."""
    assert cv2.imwrite(str(path), pixels, options)


def by_pillow(path: Path, pixels: np.ndarray, **options: Any) -> None:
    """Write a file with Pillow."""
    PillowImage.fromarray(pixels).save(path, **options)


def scans(path: Path, pixels: np.ndarray, count: int) -> None:
    """A progressive JPEG whose last scan is repeated until there are ``count``."""
    by_pillow(path, pixels, progressive=True, quality=90)
    data = path.read_bytes()
    starts = [at for at in range(len(data) - 1) if data[at] == 0xFF and data[at + 1] == 0xDA]
    last = data[starts[-1] : -2]
    path.write_bytes(data[:-2] + last * (count - len(starts)) + b"\xff\xd9")


def arithmetic(path: Path, pixels: np.ndarray) -> None:
    """A JPEG with arithmetic coding, which GDAL can write."""
    height, width = pixels.shape[:2]
    with rasterio.open(
        path, "w", driver="JPEG", height=height, width=width, count=3, dtype="uint8", ARITHMETIC="YES", quality=90
    ) as file:
        file.write(pixels.transpose(2, 0, 1))
    path.with_name(f"{path.name}.aux.xml").unlink(missing_ok=True)


def damaged(path: Path, pixels: np.ndarray) -> None:
    """A JPEG with zeros in its middle, which is decoded twice where it is kept."""
    by_opencv(path, pixels)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 400] = bytes(400)
    path.write_bytes(data)


def interlaced(path: Path, megapixels: int) -> None:
    """A gray PNG of 16 bits, zeros, in the seven passes of Adam7; Pillow writes none."""
    width, height = SIZES[megapixels]
    passes = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
    packer = zlib.compressobj(1)
    body = b""
    for left, top, across, down in passes:
        row = bytes(1 + 6 * -(-(width - left) // across))
        for _ in range(-(-(height - top) // down)):
            body += packer.compress(row)
    chunks = (b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 1)), (b"IDAT", body + packer.flush())
    with path.open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in (*chunks, (b"IEND", b"")):
            file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))


def chunks(path: Path) -> None:
    """A PNG of empty chunks."""
    by_opencv(path, np.zeros((64, 64, 3), np.uint8))
    data = path.read_bytes()
    path.write_bytes(data[:33] + (bytes(4) + b"teST" + struct.pack(">I", zlib.crc32(b"teST"))) * 10_000_000 + data[33:])


def declared(path: Path, width: int, height: int) -> None:
    """A PNG or JPEG that declares another size than it has."""
    by_opencv(path, np.zeros((64, 64, 3), np.uint8))
    data = bytearray(path.read_bytes())
    if path.suffix == ".png":
        data[16:24] = struct.pack(">II", width, height)
        data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    else:
        at = data.index(b"\xff\xc0") + 5
        data[at : at + 4] = struct.pack(">HH", height, width)
    path.write_bytes(data)


def padded(path: Path, after_start: bytes) -> None:
    """A JPEG with bytes after its start marker."""
    by_opencv(path, np.zeros((64, 64, 3), np.uint8))
    data = path.read_bytes()
    path.write_bytes(data[:2] + after_start + data[2:])


def tags(path: Path, count: int, size: int) -> None:
    """A TIFF whose tags all name the same bytes."""
    entries = b"".join(struct.pack("<HHII", tag, 7, size, 8) for tag in range(1, count + 1))
    body = bytes(size)
    path.write_bytes(b"II*\0" + struct.pack("<I", 8 + size) + body + struct.pack("<H", count) + entries + bytes(4))


QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 97)
CASES: dict[str, tuple[str, Callable[[Path], None]]] = {
    "JPEG, 20 MP": (".jpg", lambda path: by_opencv(path, scene(20), *QUALITY)),
    "JPEG, 50 MP": (".jpg", lambda path: by_opencv(path, scene(50), *QUALITY)),
    "JPEG, 89 MP": (".jpg", lambda path: by_opencv(path, scene(89), *QUALITY)),
    "JPEG, 89 MP, turned by EXIF": (
        ".jpg",
        lambda path: by_pillow(path, scene(89), exif=b"Exif\0\0II*\0\x08\0\0\0\1\0\x12\1\3\0\1\0\0\0\6\0\0\0\0\0\0\0"),
    ),
    "JPEG, 89 MP, damaged": (".jpg", lambda path: damaged(path, scene(89))),
    "JPEG, 89 MP, CMYK": (".jpg", lambda path: PillowImage.fromarray(scene(89)).convert("CMYK").save(path)),
    "JPEG, 20 MP, arithmetic": (".jpg", lambda path: arithmetic(path, scene(20))),
    "JPEG, 89 MP, arithmetic": (".jpg", lambda path: arithmetic(path, scene(89))),
    "JPEG, 20 MP, progressive": (".jpg", lambda path: by_pillow(path, scene(20), progressive=True, quality=90)),
    "JPEG, 89 MP, progressive": (".jpg", lambda path: by_pillow(path, scene(89), progressive=True, quality=90)),
    "JPEG, 89 MP, 13 scans": (".jpg", lambda path: scans(path, scene(89), 13)),
    "JPEG, 20 MP, 60 scans": (".jpg", lambda path: scans(path, scene(20), 60)),
    "JPEG, 20 MP, 61 scans": (".jpg", lambda path: scans(path, scene(20), 61)),
    "JPEG of 100 million fill bytes": (".jpg", lambda path: padded(path, b"\xff" * 100_000_000)),
    "JPEG of 20 million segments": (".jpg", lambda path: padded(path, b"\xff\xe5\x00\x02" * 20_000_000)),
    "PNG, 89 MP": (".png", lambda path: by_opencv(path, scene(89), cv2.IMWRITE_PNG_COMPRESSION, 1)),
    "PNG, 50 MP, alpha": (".png", lambda path: by_opencv(path, scene(50, channels=4), cv2.IMWRITE_PNG_COMPRESSION, 1)),
    "PNG, 89 MP, 16 bits": (".png", lambda path: by_opencv(path, scene(89, np.uint16))),
    "PNG, 89 MP, 16 bits, interlaced": (".png", lambda path: interlaced(path, 89)),
    "TIFF, 89 MP": (".tif", lambda path: by_opencv(path, scene(89), cv2.IMWRITE_TIFF_COMPRESSION, 1)),
    "TIFF, 89 MP, 16 bits": (
        ".tif",
        lambda path: by_opencv(path, scene(89, np.uint16), cv2.IMWRITE_TIFF_COMPRESSION, 1),
    ),
    "TIFF, 89 MP, 16 bits, LZW": (
        ".tif",
        lambda path: by_opencv(path, scene(89, np.uint16), cv2.IMWRITE_TIFF_COMPRESSION, 5),
    ),
    "TIFF, 89 MP, 16 bits, Deflate": (
        ".tif",
        lambda path: by_opencv(path, scene(89, np.uint16), cv2.IMWRITE_TIFF_COMPRESSION, 8),
    ),
    "TIFF, 89 MP, 16 bits, zeros": (
        ".tif",
        lambda path: by_opencv(path, np.zeros((*SIZES[89][::-1], 3), np.uint16), cv2.IMWRITE_TIFF_COMPRESSION, 8),
    ),
    "TIFF, 89 MP, float": (
        ".tif",
        lambda path: by_opencv(path, scene(89, np.float32, 1), cv2.IMWRITE_TIFF_COMPRESSION, 1),
    ),
    "TIFF of 60000 tags of 50 MB": (".tif", lambda path: tags(path, 60_000, 50_000_000)),
    "WebP, 89 MP": (".webp", lambda path: by_opencv(path, scene(89), cv2.IMWRITE_WEBP_QUALITY, 90)),
    "WebP, 50 MP, lossless": (".webp", lambda path: by_opencv(path, scene(50), cv2.IMWRITE_WEBP_QUALITY, 101)),
    "BMP, 89 MP": (".bmp", lambda path: by_opencv(path, scene(89))),
    "PPM, 89 MP, 16 bits": (".ppm", lambda path: by_opencv(path, scene(89, np.uint16))),
    "PPM of 300 million bytes of comment": (".ppm", lambda path: path.write_bytes(b"P6\n#" + b"x" * 300_000_000)),
    "PNG of 10 million chunks": (".png", chunks),
    "PNG that declares 4e18 px": (".png", lambda path: declared(path, 2**31 - 1, 2**31 - 1)),
    "PNG that declares 89 MP": (".png", lambda path: declared(path, *SIZES[89])),
    "JPEG that declares 4e9 px": (".jpg", lambda path: declared(path, 65535, 65535)),
    "JPEG that declares 89 MP": (".jpg", lambda path: declared(path, *SIZES[89])),
}


def read(path: Path) -> None:
    """Read one file as a mosaic does, and print what it took as JSON."""
    seconds = time.process_time()
    try:
        read_metadata(path)
        photograph = images.load(path, keep_damaged=True)
        pixels, _ = images.reduce_for_front_end(photograph.pixels, WORKING_WIDTH_PX, photograph.name)
        outcome = f"read, reduced to {pixels.shape[1]}x{pixels.shape[0]}"
    except InputError as error:
        outcome = str(error).removeprefix(f"{path}: ")
    seconds = time.process_time() - seconds
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    print(json.dumps({"seconds": seconds, "memory_mb": memory_mb, "outcome": outcome}))


def in_child(*words: str | Path) -> str:
    """What this script prints with other arguments."""
    command = [sys.executable, __file__, *map(str, words)]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def main() -> None:
    """Print a row for each case; exit status 1 if one exceeds a limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--only", default="", help="cases whose names contain this")
    options = parser.parse_args()
    if options.write:
        CASES[options.write[0]][1](Path(options.write[1]))
        return
    if options.read:
        read(options.read)
        return
    exceeded = False
    print("| photograph | MB | s | peak MB | outcome |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, (suffix, _) in CASES.items():
            if options.only not in name:
                continue
            path = Path(folder) / f"photograph{suffix}"
            in_child("--write", name, path)
            found = json.loads(in_child("--read", path))
            size_mb = path.stat().st_size / 1e6
            path.unlink()
            exceeded |= found["seconds"] > MOST_SECONDS or found["memory_mb"] > MOST_MEMORY_MB
            row = f"{size_mb:.0f} | {found['seconds']:.1f} | {found['memory_mb']} | {found['outcome']}"
            print(f"| {name} | {row} |", flush=True)
    sys.exit(exceeded)


if __name__ == "__main__":
    main()
