"""Feeds mutated files to everything that reads files: ``python -m tools.fuzz 10000`` prints a report.

Every input must end in a result or in the one-line error of its reader. What a cache returns must be what was saved.
"""

import contextlib
import faulthandler
import functools
import io
import itertools
import json
import os
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import typer
from PIL import Image as PillowImage
from PIL.ExifTags import IFD

from golden_model.config import load_config, preset_config, to_toml
from golden_model.records import FRAME_STATUS, MATCH, Tag
from sim.backends import board
from sim.backends.interface import BackendError, silent
from sim.simulators.build_cache import build_once
from skymosaic.errors import InputError
from skymosaic.flight.cache import ResultCache
from skymosaic.imagery import images
from skymosaic.imagery.exif import read_metadata
from skymosaic.imagery.lens import load_lens
from tools.mutators import mutated, mutated_text

app = typer.Typer(help=__doc__, add_completion=False)

MAX_PROCESSOR_SECONDS = 20
MAX_MEMORY_MB = 2048
EXPECTED = (InputError, BackendError)
CAMERA = """width_px = 640
height_px = 480
focal_x_px = 500
focal_y_px = 500
centre_x_px = 319.5
centre_y_px = 239.5
k1 = -0.2
"""
Target = Callable[[Path, np.random.Generator], str]


@dataclass
class Report:
    """What became of the inputs.

    Attributes
    ----------
    classes : Counter
        Number of inputs by target and outcome.
    failures : list of str
        Tracebacks, wrong values and inputs that took too long.
    slowest_seconds : float
        Processor time of the slowest input.
    peak_memory_mb : int
        Of the process.
    """

    classes: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    slowest_seconds: float = 0.0
    peak_memory_mb: int = 0

    def text(self) -> str:
        lines = [f"inputs {self.classes.total()}, failures {len(self.failures)}, "]
        lines[0] += f"slowest {self.slowest_seconds:.2f} s, peak memory {self.peak_memory_mb} MB"
        return "\n".join([*lines, *(f"  {name}: {count}" for name, count in sorted(self.classes.items()))])


def _scene() -> np.ndarray:
    rng = np.random.default_rng(3)
    return cv2.GaussianBlur(rng.integers(0, 256, (96, 128, 3), dtype=np.uint8), (0, 0), 1.5)


@functools.cache
def _encoded() -> list[tuple[str, bytes]]:
    """One small photograph in every format and depth that is read."""
    scene = _scene()
    deep = scene.astype(np.uint16) * 257
    pictures = [(suffix, scene) for suffix in (".jpg", ".png", ".tif", ".webp", ".bmp", ".ppm")]
    pictures += [(".png", deep), (".tif", deep), (".tif", scene[..., 0].astype(np.float32)), (".pgm", deep[..., 0])]
    found = [(suffix, cv2.imencode(suffix, pixels)[1].tobytes()) for suffix, pixels in pictures]
    for options in ({"progressive": True}, {"subsampling": 0}, {"comment": b"x" * 300}):
        file = io.BytesIO()
        PillowImage.fromarray(scene).save(file, "JPEG", **options)
        found.append((".jpg", file.getvalue()))
    file = io.BytesIO()
    PillowImage.fromarray(scene).save(file, "PNG", icc_profile=b"profile" * 20, exif=_exif())
    return [*found, (".png", file.getvalue())]


def _exif() -> PillowImage.Exif:
    exif = PillowImage.Exif()
    exif[0x0112], exif[0x010F], exif[0x829A] = 6, "maker", (1, 500)
    exif.get_ifd(IFD.GPSInfo).update({1: "N", 2: (46.0, 30.0, 36.0), 3: "E", 4: (7.0, 15.0, 0.0), 6: 520.5})
    return exif


@functools.cache
def _photograph_with_exif() -> bytes:
    file = io.BytesIO()
    PillowImage.fromarray(_scene()).save(file, "JPEG", exif=_exif())
    return file.getvalue()


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


def _exif_of_a_photograph(folder: Path, rng: np.random.Generator) -> str:
    whole = _photograph_with_exif()
    start, end = whole.index(b"Exif\0\0") + 6, whole.index(b"\xff\xdb")
    changed = mutated(whole[start:end], rng)[: end - start].ljust(end - start, b"\0")
    path = folder / "exif.jpg"
    path.write_bytes(whole[:start] + changed + whole[end:])
    return _read_photograph(path, rng)


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
        return "refused" if str(path) in str(error) else "refused without a name"
    return "read"


def _cache_entries(folder: Path, rng: np.random.Generator) -> str:
    cache = ResultCache(folder / "cache")
    arrays = {"values": np.arange(300.0), "facts": np.array("text")}
    cache.save("entry", arrays)
    path = folder / "cache" / "entry.entry"
    whole = path.read_bytes()
    path.write_bytes(mutated(whole, rng))
    found = cache.load("entry")
    if found is None:
        return "refused"
    assert path.read_bytes() == whole or all(np.array_equal(found[name], arrays[name]) for name in arrays)
    return "read"


def _builds(_folder: Path, rng: np.random.Generator) -> str:
    def build(made: Path) -> None:
        (made / "library").write_bytes(b"compiled " * 100)

    made = build_once("thing", build, what="the thing", progress=silent)
    path = made / str(rng.choice(["library", "checksums"]))
    path.write_bytes(mutated(path.read_bytes(), rng))
    made = build_once("thing", build, what="the thing", progress=silent)
    assert (made / "library").read_bytes() == b"compiled " * 100
    return "read"


def _records(_folder: Path, rng: np.random.Generator) -> str:
    """The answer of a board, after the server has accepted the request."""
    config = preset_config("aerial").front_end
    feature = config.pattern.record.dtype
    status = np.zeros((), FRAME_STATUS.dtype)
    status["tag"], status["good"], status["width"], status["height"] = Tag.FRAME_STATUS, 1, 96, 64
    parts = [np.zeros(3, feature).tobytes(), status.tobytes(), np.zeros(2, MATCH.dtype).tobytes(), status.tobytes()]
    header, body = json.dumps({"lengths": [*map(len, parts)]}).encode() + b"\n", b"".join(parts)
    answer = mutated(header, rng) + body if rng.random() < 0.5 else header + mutated(body, rng)
    limits = board._limit_packets(config.max_features, feature)
    packets = board._read_packets(io.BytesIO(answer), "board", limits)
    result = board._decode_packets(tuple(packets), feature)
    board._check_status(result, 0, (64, 96), "board")
    return "read"


TARGETS: dict[str, Target] = {
    "photographs": _photographs,
    "EXIF": _exif_of_a_photograph,
    "TOML": _toml,
    "cache entries": _cache_entries,
    "builds": _builds,
    "records": _records,
}


def fuzz(count: int, seed: int = 0) -> Report:
    """Feed ``count`` inputs to the targets in turn; input ``n`` depends on the seed and ``n`` alone."""
    report = Report()
    with tempfile.TemporaryDirectory() as folder, _cache_in(Path(folder)):
        for number, (name, target) in zip(range(count), itertools.cycle(TARGETS.items()), strict=False):
            started = time.process_time()
            try:
                outcome = target(Path(folder), np.random.default_rng((seed, number)))
            except EXPECTED as error:
                outcome = "refused" if "\n" not in str(error) else "refused in two lines"
            except Exception:
                outcome = "traceback"
                report.failures.append(f"{name}, input {number}: {traceback.format_exc()}")
            seconds = time.process_time() - started
            if seconds > MAX_PROCESSOR_SECONDS or outcome not in ("read", "refused", "traceback"):
                report.failures.append(f"{name}, input {number}: {outcome} after {seconds:.1f} s")
            report.slowest_seconds = max(report.slowest_seconds, seconds)
            report.classes[f"{name}, {outcome}"] += 1
    report.peak_memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    return report


@contextlib.contextmanager
def _cache_in(folder: Path) -> Iterator[None]:
    """The user's cache is elsewhere meanwhile."""
    before = os.environ.get("XDG_CACHE_HOME")
    os.environ["XDG_CACHE_HOME"] = str(folder / "builds")
    try:
        yield
    finally:
        del os.environ["XDG_CACHE_HOME"]
        if before is not None:
            os.environ["XDG_CACHE_HOME"] = before


@contextlib.contextmanager
def _muted_libraries() -> Iterator[None]:
    """Discard what libpng, libjpeg and others print about damaged files: they write to the descriptor itself."""
    with os.fdopen(os.dup(2), "w") as errors, Path(os.devnull).open("w") as nowhere:
        # A library that crashes still leaves a traceback.
        faulthandler.enable(errors)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(errors.fileno(), 2)
            faulthandler.disable()


@app.command()
def main(count: int, seed: int = 0) -> None:
    """Feed COUNT inputs, and print a report; exit status 1 after a failure."""
    with _muted_libraries():
        report = fuzz(count, seed)
    print(report.text())
    for failure in report.failures:
        print(failure)
    sys.exit(bool(report.failures) or report.peak_memory_mb > MAX_MEMORY_MB)


if __name__ == "__main__":
    app()
