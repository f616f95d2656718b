"""What workers do with uploads: read them with every check, or render what is built in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from golden_model.arrays import Pixels
from sim.backend import Progress
from sim.scene import lawnmower, pursuit
from sim.scene import pair as rendered_pair
from skymosaic.errors import InputError
from skymosaic.imagery.images import LARGEST_AREA_PX, load, reduced, save
from skymosaic.imagery.video import DEFAULT_RATE, VideoReader, writing
from skymosaic.panel.results import Upload
from skymosaic.registration import WORKING_WIDTH_PX

BUILT_IN_SEED = 9
FLIGHT_SIZE = (800, 600)
PURSUIT_FRAMES = 60
CAR_MAGNIFICATION = 3.0
"""The car is about 90 px long: enough for a template."""
TEMPLATE_MARGIN_PX = 6


def inspect(name: str, views: Path, *, progress: Progress) -> Upload:
    """Decode a photograph and keep its working picture in ``views``."""
    progress(f"reading {name}")
    photograph = load(name)
    return _shown(name, photograph.pixels, photograph.notes, views)


def inspect_video(name: str, views: Path, *, progress: Progress) -> Upload:
    """Decode a video's first frame and keep it in ``views``."""
    progress(f"reading {name}")
    reader = VideoReader(name)
    first = next(iter(reader))
    if first.shape[0] * first.shape[1] > LARGEST_AREA_PX // 4:
        raise InputError(f"{name}: frames of {first.shape[1]}x{first.shape[0]} pixels are too large; reduce it first")
    return _shown(name, first, (f"{float(reader.frame_rate):.3g} frames/s",), views)


def render_pair(names: Sequence[str], views: Path, *, progress: Progress) -> list[Upload]:
    """Render the built-in pair."""
    return _rendered(names, rendered_pair(seed=BUILT_IN_SEED).images, views, progress)


def render_flight(names: Sequence[str], views: Path, *, progress: Progress) -> list[Upload]:
    """Render the built-in flight of as many photographs as there are names."""
    return _rendered(names, lawnmower(BUILT_IN_SEED, len(names), FLIGHT_SIZE).images, views, progress)


def render_pursuit(template: str, video: str, views: Path, *, progress: Progress) -> tuple[Upload, Upload]:
    """Render the built-in film of a car, and cut the car out of its first frame."""
    film = pursuit(BUILT_IN_SEED, PURSUIT_FRAMES, magnification=CAR_MAGNIFICATION)
    with writing(Path(video), DEFAULT_RATE) as write:
        for number, frame in enumerate(film.images):
            progress(f"rendering the built-in film: {number + 1} of {PURSUIT_FRAMES} frames")
            write(frame)
    low, high = film.corners[0].min(axis=0), film.corners[0].max(axis=0)
    (left, top), (right, bottom) = low.astype(int) - TEMPLATE_MARGIN_PX, high.astype(int) + TEMPLATE_MARGIN_PX
    save(Path(template), film.images[0][top:bottom, left:right])
    return inspect(template, views, progress=progress), inspect_video(video, views, progress=progress)


def _rendered(names: Sequence[str], images: Sequence[Pixels], views: Path, progress: Progress) -> list[Upload]:
    for number, (name, image) in enumerate(zip(names, images, strict=True), 1):
        progress(f"rendering photograph {number} of {len(names)}")
        save(Path(name), image)
    return [inspect(name, views, progress=progress) for name in names]


def _shown(name: str, pixels: Pixels, notes: tuple[str, ...], views: Path) -> Upload:
    working, _ = reduced(pixels, WORKING_WIDTH_PX)
    path = views / f"{name}.png"
    save(path, working)
    return Upload(name, (pixels.shape[1], pixels.shape[0]), notes, path, (working.shape[1], working.shape[0]))
