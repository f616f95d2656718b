"""What many tests make in one way: files of pictures, and photographs that say where they were taken."""

import contextlib
import resource
import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD

METRES_PER_DEGREE = 111_147
"""Along a meridian near 46 degrees north."""


def write_pictures(folder: Path, images: Iterable[np.ndarray], names: Iterable[str] = ()) -> list[Path]:
    """Write ``0.png`` and so on, or files with these names."""
    images = list(images)
    paths = [folder / name for name in [*names] or [f"{number}.png" for number in range(len(images))]]
    for path, image in zip(paths, images, strict=True):
        assert cv2.imwrite(str(path), image)
    return paths


def write_located(
    path: Path,
    image: np.ndarray,
    place: tuple[float, float],
    moved_m: tuple[float, float],
    tags: Mapping[int, int] = {},
) -> None:
    """Write a JPEG, in BGR, whose EXIF has a place so far east and north of another one in degrees, and other tags."""
    north, east = place
    degrees = (
        north + moved_m[1] / METRES_PER_DEGREE,
        east + moved_m[0] / (METRES_PER_DEGREE * np.cos(np.radians(north))),
    )
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif).update(tags)
    minutes = [(int(abs(each)), float(60 * (abs(each) % 1)), 0.0) for each in degrees]
    sides = "N" if degrees[0] > 0 else "S", "E" if degrees[1] > 0 else "W"
    exif.get_ifd(IFD.GPSInfo).update({1: sides[0], 2: minutes[0], 3: sides[1], 4: minutes[1]})
    Image.fromarray(image[..., ::-1]).save(path, quality=92, exif=exif)


@contextlib.contextmanager
def limited_files(size_bytes: int) -> Iterator[None]:
    """Let no file grow beyond a size, as on a disk that becomes full."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def leave_free(monkeypatch: pytest.MonkeyPatch, free_bytes: int) -> None:
    """Let every disk have so much space left."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=free_bytes))
