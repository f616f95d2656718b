"""Tasks for uploads, run in a worker: decode a file with every check, or render the built-in examples.

Every task reads and writes files in ``folder`` by the names it is given, and saves what the page shows in ``pictures``.
"""

from collections.abc import Sequence
from pathlib import Path

from golden_model.arrays import Pixels
from sim.scene import make_lawnmower, make_pair, make_pursuit
from skymosaic.errors import InputError
from skymosaic.imagery.decoding import MAX_AREA_PX
from skymosaic.imagery.images import load, reduce_to_width, save
from skymosaic.imagery.video import DEFAULT_RATE, VideoReader, write_video
from skymosaic.panel.results import Upload
from skymosaic.panel.steps import Progress
from skymosaic.registration.options import WORKING_WIDTH_PX

BUILT_IN_SEED = 9
FLIGHT_SIZE = (800, 600)
PURSUIT_FRAMES = 60
CAR_MAGNIFICATION = 3.0
"""Makes the car about 90 px long, which is enough for a template."""
TEMPLATE_MARGIN_PX = 6


def inspect_photograph(
    folder: Path, name: str, pictures: Path, *, progress: Progress, keep_damaged: bool = False
) -> Upload:
    """Decode a photograph, or what can be decoded of it, and save its working picture.

    Raises
    ------
    InputError
        As `skymosaic.imagery.images.load`.
    """
    progress(f"reading {name}")
    photograph = load(folder / name, keep_damaged=keep_damaged)
    return _describe(name, photograph.pixels, photograph.notes, pictures)


def inspect_video(folder: Path, name: str, pictures: Path, *, progress: Progress) -> Upload:
    """Decode a video's first frame and save it.

    Raises
    ------
    InputError
        If it cannot be decoded, or its frames are larger than a quarter of the largest photograph.
    """
    progress(f"reading {name}")
    reader = VideoReader(folder / name)
    first = next(iter(reader))
    if first.shape[0] * first.shape[1] > MAX_AREA_PX // 4:
        raise InputError(f"{name}: frames of {first.shape[1]}x{first.shape[0]} pixels are too large; reduce it first")
    return _describe(name, first, (f"{float(reader.frame_rate):.3g} frames/s",), pictures)


def render_pair(folder: Path, names: Sequence[str], pictures: Path, *, progress: Progress) -> list[Upload]:
    """Render the built-in pair."""
    return _save_all(folder, names, make_pair(seed=BUILT_IN_SEED).images, pictures, progress)


def render_flight(folder: Path, names: Sequence[str], pictures: Path, *, progress: Progress) -> list[Upload]:
    """Render the built-in flight, one photograph for each name."""
    return _save_all(folder, names, make_lawnmower(BUILT_IN_SEED, len(names), FLIGHT_SIZE).images, pictures, progress)


def render_pursuit(
    folder: Path, template: str, video: str, pictures: Path, *, progress: Progress
) -> tuple[Upload, Upload]:
    """Render the built-in film of a car, and cut the template out of its first frame."""
    film = make_pursuit(BUILT_IN_SEED, PURSUIT_FRAMES, magnification=CAR_MAGNIFICATION)
    with write_video(folder / video, DEFAULT_RATE) as write:
        for number, frame in enumerate(film.images):
            progress("rendering the built-in film", number + 1, PURSUIT_FRAMES)
            write(frame)
    low, high = film.corners[0].min(axis=0), film.corners[0].max(axis=0)
    (left, top), (right, bottom) = low.astype(int) - TEMPLATE_MARGIN_PX, high.astype(int) + TEMPLATE_MARGIN_PX
    save(folder / template, film.images[0][top:bottom, left:right])
    return inspect_photograph(folder, template, pictures, progress=progress), inspect_video(
        folder, video, pictures, progress=progress
    )


def _save_all(
    folder: Path, names: Sequence[str], images: Sequence[Pixels], pictures: Path, progress: Progress
) -> list[Upload]:
    for number, (name, image) in enumerate(zip(names, images, strict=True), 1):
        progress("rendering photographs", number, len(names))
        save(folder / name, image)
    return [inspect_photograph(folder, name, pictures, progress=progress) for name in names]


def _describe(name: str, pixels: Pixels, notes: tuple[str, ...], pictures: Path) -> Upload:
    """Save a reduced picture for the page, and describe the file."""
    working, _ = reduce_to_width(pixels, WORKING_WIDTH_PX)
    path = pictures / f"{name}.png"
    save(path, working)
    return Upload(name, (pixels.shape[1], pixels.shape[0]), notes, path, (working.shape[1], working.shape[0]))
