"""Processor time and memory of the largest photographs.

    python -m bench.photographs [NAME ...]

Each file is written by one process and read by another one, as the command line reads it: EXIF, header, decoding, 8
bits, and the reduction for the front end.
"""

import resource
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import typer
from PIL import Image as PillowImage

from bench.report import JsonFile, PartsOfNames, Row, in_process, report
from skymosaic.common.errors import InputError
from skymosaic.imagery import images
from skymosaic.imagery.exif import read_metadata
from skymosaic.registration.options import WORKING_WIDTH_PX

MAX_SECONDS = 20.0
MAX_MEMORY_MB = 2048
SIZES = {20: (5472, 3648), 50: (8660, 5773), 105: (12544, 8368)}
"""Megapixels: width and height."""


def scene(megapixels: int, dtype: type[np.generic] = np.uint8, channels: int = 3) -> np.ndarray:
    """Noise over a blurred pattern: about as many bits per pixel as a sharp photograph of foliage."""
    width, height = SIZES[megapixels]
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, (512, 512, channels), np.uint8)
    tile = cv2.GaussianBlur(noise, (0, 0), 2).astype(np.float32) * 3 - 256
    tile = (tile + rng.normal(0, 6, tile.shape)).clip(0, 255)
    if dtype is np.uint16:
        tile = tile * 257
    tile = tile.reshape(512, 512, channels).astype(dtype)
    return np.squeeze(np.tile(tile, (-(-height // 512), -(-width // 512), 1))[:height, :width])


def by_opencv(
    path: Path, megapixels: int, *, compression: int = 1, dtype: type[np.generic] = np.uint8, channels: int = 3
) -> None:
    """Write a file with OpenCV: JPEG of high quality, PNG of little and TIFF by default of no compression."""
    options = {".jpg": (cv2.IMWRITE_JPEG_QUALITY, 97), ".tif": (cv2.IMWRITE_TIFF_COMPRESSION, compression)}
    options |= {".png": (cv2.IMWRITE_PNG_COMPRESSION, 1), ".webp": (cv2.IMWRITE_WEBP_QUALITY, 90)}
    assert cv2.imwrite(str(path), scene(megapixels, dtype, channels), options.get(path.suffix, ()))


def by_pillow(path: Path, megapixels: int, mode: str = "RGB", **options: Any) -> None:
    """Write a file with Pillow."""
    PillowImage.fromarray(scene(megapixels)).convert(mode).save(path, **options)


def with_scans(path: Path, megapixels: int, count: int) -> None:
    """A progressive JPEG whose last scan is repeated until there are ``count``."""
    by_pillow(path, megapixels, progressive=True, quality=90)
    data = path.read_bytes()
    starts = [at for at in range(len(data) - 1) if data[at] == 0xFF and data[at + 1] == 0xDA]
    path.write_bytes(data[:-2] + data[starts[-1] : -2] * (count - len(starts)) + b"\xff\xd9")


def with_zeros(path: Path, megapixels: int) -> None:
    """A JPEG with zeros in its middle, which is decoded twice where it is kept."""
    by_opencv(path, megapixels)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 400] = bytes(400)
    path.write_bytes(data)


LZW, DEFLATE = 5, 8
Write = Callable[[Path, int], None]
CASES: dict[str, tuple[str, int, Write]] = {
    "JPEG, 20 megapixels": (".jpg", 20, by_opencv),
    "JPEG, 50 megapixels": (".jpg", 50, by_opencv),
    "JPEG, 105 megapixels": (".jpg", 105, by_opencv),
    "JPEG, progressive": (".jpg", 105, partial(by_pillow, progressive=True, quality=90)),
    "JPEG, damaged and kept": (".jpg", 105, with_zeros),
    "JPEG, CMYK": (".jpg", 105, partial(by_pillow, mode="CMYK")),
    "JPEG, 11 scans, invalid and kept": (".jpg", 105, partial(with_scans, count=11)),
    "JPEG, 20 megapixels, 60 scans, invalid and kept": (".jpg", 20, partial(with_scans, count=60)),
    "PNG": (".png", 105, by_opencv),
    "PNG, 16 bits": (".png", 105, partial(by_opencv, dtype=np.uint16)),
    "TIFF": (".tif", 105, by_opencv),
    "TIFF, 16 bits": (".tif", 105, partial(by_opencv, dtype=np.uint16)),
    "TIFF, 16 bits, LZW": (".tif", 105, partial(by_opencv, compression=LZW, dtype=np.uint16)),
    "TIFF, 16 bits, Deflate": (".tif", 105, partial(by_opencv, compression=DEFLATE, dtype=np.uint16)),
    "TIFF, gray, float": (".tif", 105, partial(by_opencv, dtype=np.float32, channels=1)),
    "WebP": (".webp", 105, by_opencv),
    "BMP": (".bmp", 105, by_opencv),
    "PPM, 16 bits": (".ppm", 105, partial(by_opencv, dtype=np.uint16)),
}
"""Suffix, megapixels, and what writes the file; 105 megapixels where nothing is said."""


def read(path: Path) -> tuple[float, int, str]:
    """Processor seconds, peak memory in MB, and the outcome of reading a file as a mosaic does."""
    started = time.process_time()
    try:
        read_metadata(path)
        photograph = images.load(path, keep_damaged=True)
        pixels, _ = images.reduce_for_front_end(photograph.pixels, WORKING_WIDTH_PX, photograph.name)
        outcome = f"read, reduced to {pixels.shape[1]}x{pixels.shape[0]}"
    except InputError as error:
        outcome = str(error).removeprefix(f"{path}: ")
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    return time.process_time() - started, memory_mb, outcome


def main(names: PartsOfNames = None, json_file: JsonFile = None) -> None:
    """Print a row for each file; exit status 1 if one takes more than 20 s of processor time or 2048 MB."""
    rows: list[Row] = []
    exceeded = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (suffix, megapixels, write) in CASES.items():
            if names and not any(part in name for part in names):
                continue
            path = Path(folder) / f"photograph{suffix}"
            in_process(write, path, megapixels)
            seconds, memory_mb, outcome = in_process(read, path)
            exceeded += [name] * (seconds > MAX_SECONDS or memory_mb > MAX_MEMORY_MB)
            rows.append(
                {
                    "photograph": name,
                    "file, MB": round(path.stat().st_size / 1e6),
                    "s": f"{seconds:.1f}",
                    "peak, MB": memory_mb,
                    "outcome": outcome,
                }
            )
            path.unlink()
    report("large photographs", rows, json_file, keep_others=bool(names))
    if exceeded:
        raise SystemExit(f"beyond {MAX_SECONDS:g} s or {MAX_MEMORY_MB} MB: {', '.join(exceeded)}")


if __name__ == "__main__":
    typer.run(main)
