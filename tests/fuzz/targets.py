"""What the fuzzer feeds: each target damages one kind of input, and reads it as the program does.

A target returns "read" or "refused", or raises the error of its reader; what it reads must be what was written, where
the kind of file can tell.
"""

import contextlib
import functools
import io
import tempfile
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PillowImage
from PIL.ExifTags import IFD

from golden_model.config import preset_config
from golden_model.config_file import load_config, to_toml
from golden_model.fuzzy.fll import load_system
from golden_model.fuzzy.rules import SHIPPED
from skymosaic.fuzzy.quantised import quantise
from skymosaic.imagery import images
from skymosaic.imagery.exif import read_metadata
from skymosaic.imagery.lens import load_lens
from skymosaic.imagery.video import VideoReader, write_video
from tests.fuzz.mutators import change_directory, damage_block, mutated, mutated_text
from tests.golden_model.fuzzy.tipper import TIPPER

MAX_WRONG_SHARE = 0.01
"""Share of the pixels that may be wrong in a damaged photograph that is read all the same."""
MAX_FRAMES = 30
CAMERA = """width_px = 640
height_px = 480
focal_x_px = 500
focal_y_px = 500
centre_x_px = 319.5
centre_y_px = 239.5
k1 = -0.2
"""
Target = Callable[[Path, np.random.Generator], str]


def _scene() -> np.ndarray:
    rng = np.random.default_rng(3)
    return cv2.GaussianBlur(rng.integers(0, 256, (96, 128, 3), dtype=np.uint8), (0, 0), 1.5)


def _saved(kind: str, **options: object) -> bytes:
    """The scene as Pillow writes it."""
    file = io.BytesIO()
    PillowImage.fromarray(_scene()).save(file, kind, **options)
    return file.getvalue()


@functools.cache
def _encoded() -> list[tuple[str, bytes]]:
    """One small photograph in every format and depth that is read."""
    scene = _scene()
    deep = scene.astype(np.uint16) * 257
    pictures = [(suffix, scene) for suffix in (".jpg", ".png", ".tif", ".webp", ".bmp", ".ppm")]
    pictures += [(".png", deep), (".tif", deep), (".tif", scene[..., 0].astype(np.float32)), (".pgm", deep[..., 0])]
    found = [(suffix, cv2.imencode(suffix, pixels)[1].tobytes()) for suffix, pixels in pictures]
    # Twice, since what EXIF says is read, too.
    options = ({"progressive": True}, {"comment": b"x" * 300}, {"exif": _exif()}, {"exif": _exif(), "quality": 5})
    return [*found, *((".jpg", _saved("JPEG", **each)) for each in options)]


def _exif() -> PillowImage.Exif:
    exif = PillowImage.Exif()
    exif[0x0112], exif[0x010F], exif[0x829A] = 6, "maker", (1, 500)
    exif.get_ifd(IFD.GPSInfo).update({1: "N", 2: (46.0, 30.0, 36.0), 3: "E", 4: (7.0, 15.0, 0.0), 6: 520.5})
    return exif


def _read_photograph(path: Path, rng: np.random.Generator) -> str:
    read_metadata(path)
    photograph = images.load(path, keep_damaged=bool(rng.integers(2)))
    assert photograph.pixels.dtype == np.uint8
    images.reduce_for_front_end(photograph.pixels, 640, photograph.name)
    return "read"


def _photographs(folder: Path, rng: np.random.Generator) -> str:
    encoded = _encoded()
    suffix, data = encoded[rng.integers(len(encoded))]
    path = folder / f"photograph{suffix}"
    path.write_bytes(mutated(data, rng))
    return _read_photograph(path, rng)


def _refused(error: ValueError, path: Path) -> str:
    text = str(error)
    return "refused" if text.startswith(str(path)) and "\n" not in text else f"refused with {text!r}"


def _toml(folder: Path, rng: np.random.Generator) -> str:
    path = folder / "file.toml"
    if rng.random() < 0.5:
        path.write_bytes(mutated_text(CAMERA, rng))
        load_lens(path, None)
        return "read"
    path.write_bytes(mutated_text(to_toml(preset_config("aerial")), rng))
    try:
        load_config(path)
    except ValueError as error:
        return _refused(error, path)
    return "read"


@functools.cache
def _telling() -> list[tuple[str, bytes]]:
    """One photograph in every format that can tell damage; a small JPEG may decode to just as many blocks."""
    tiffs = [(".tif", _saved("TIFF", compression=each)) for each in ("tiff_lzw", "tiff_deflate", "jpeg")]
    return [(".png", cv2.imencode(".png", _scene())[1].tobytes()), *tiffs]


def _tiff_directories(folder: Path, rng: np.random.Generator) -> str:
    tiffs = [data for suffix, data in _telling() if suffix == ".tif"]
    path = folder / "directory.tif"
    path.write_bytes(change_directory(tiffs[rng.integers(len(tiffs))], rng))
    return _read_photograph(path, rng)


def _damaged_photographs(folder: Path, rng: np.random.Generator) -> str:
    """400 zeroed bytes, which must not be accepted for a photograph."""
    suffix, whole = _telling()[rng.integers(len(_telling()))]
    path = folder / f"damaged{suffix}"
    path.write_bytes(whole)
    expected = images.load(path).pixels
    path.write_bytes(damage_block(whole, rng))
    found = images.load(path).pixels
    assert found.shape == expected.shape
    assert (found != expected).any(axis=2).mean() <= MAX_WRONG_SHARE
    return "read"


@functools.cache
def _films() -> list[tuple[str, bytes]]:
    """A short film in every container that is written, as bytes."""
    scene, films = _scene(), []
    for suffix in (".mp4", ".mkv"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"film{suffix}"
            with write_video(path, Fraction(25)) as write:
                for shift in range(8):
                    write(np.roll(scene, shift, axis=1))
            films.append((suffix, path.read_bytes()))
    return films


def _videos(folder: Path, rng: np.random.Generator) -> str:
    suffix, whole = _films()[rng.integers(len(_films()))]
    path = folder / f"film{suffix}"
    path.write_bytes(mutated(whole, rng))
    for number, frame in enumerate(VideoReader(path)):
        assert frame.dtype == np.uint8
        if number == MAX_FRAMES:
            break
    return "read"


def _fuzzy_systems(folder: Path, rng: np.random.Generator) -> str:
    shipped = sorted(SHIPPED.glob("*.fll"))
    texts = [("fll", path.read_text(encoding="utf-8"), ":") for path in shipped] + [("fis", TIPPER, "=")]
    suffix, text, sign = texts[rng.integers(len(texts))]
    path = folder / f"rules.{suffix}"
    path.write_bytes(mutated_text(text, rng, sign))
    try:
        system = load_system(path)
    except ValueError as error:
        return _refused(error, path)
    # Not every system has an integer model.
    with contextlib.suppress(ValueError):
        quantise(system, 17)
    return "read"


TARGETS: dict[str, Target] = {
    "photographs": _photographs,
    "TOML": _toml,
    "TIFF directories": _tiff_directories,
    "damaged photographs": _damaged_photographs,
    "videos": _videos,
    "fuzzy systems": _fuzzy_systems,
}
