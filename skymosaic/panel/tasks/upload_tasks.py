"""Tasks for inputs, run in a worker: decode a file with every check, reduce a folder's, or render the examples.

Every task reads and writes files in ``folder`` by the names it is given, and saves what the page shows in ``pictures``.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Pixels
from golden_model.small_files import read_small_file
from sim.scene import make_lawnmower, make_pair, make_pursuit
from skymosaic.common.errors import InputError, reading
from skymosaic.imagery.decoding import MAX_AREA_PX, MAX_DECODED_BYTES, read_header
from skymosaic.imagery.images import load, reduce_to_width, save
from skymosaic.imagery.key_frames import DEFAULT_RATE
from skymosaic.imagery.video import VideoReader, write_video
from skymosaic.panel.results import Decoded, InputFile, new_picture
from skymosaic.panel.tasks.jobs import Progress
from skymosaic.registration.options import WORKING_WIDTH_PX

BUILT_IN_SEED = 9
FLIGHT_SIZE = (800, 600)
PURSUIT_FRAMES = 60
CAR_MAGNIFICATION = 3.0
"""Makes the car about 90 px long, which is enough for a template."""
TEMPLATE_MARGIN_PX = 6
THUMBNAIL_PX = 160
REDUCTIONS = {8: cv2.IMREAD_REDUCED_COLOR_8, 4: cv2.IMREAD_REDUCED_COLOR_4, 2: cv2.IMREAD_REDUCED_COLOR_2}
"""Flags that decode a JPEG at a fraction of its size."""


def inspect_photograph(
    folder: Path, name: str, pictures: Path, *, progress: Progress, keep_damaged: bool = False
) -> Decoded:
    """Decode a photograph, or what can be decoded of it, and save its working picture.

    Raises
    ------
    InputError
        As `skymosaic.imagery.images.load`.
    """
    progress(f"reading {name}")
    photograph = load(folder / name, keep_damaged=keep_damaged)
    return _describe(photograph.pixels, photograph.notes, pictures)


def inspect_video(folder: Path, name: str, pictures: Path, *, progress: Progress) -> Decoded:
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
    return _describe(first, (f"{float(reader.frame_rate):.3g} frames/s",), pictures)


def make_thumbnails(folder: Path, names: Sequence[str], pictures: Path, *, progress: Progress) -> list[str]:
    """Save thumbnails, ``1.jpg`` and so on, of a folder's photographs in their order; returns why some have none."""
    faults = []
    for number, name in enumerate(names, 1):
        try:
            save(pictures / f"{number}.jpg", reduce_to_width(_decode_reduced(folder / name), THUMBNAIL_PX)[0])
        except InputError as error:
            faults.append(str(error))
        progress("reading", number, len(names))
    return faults


def _decode_reduced(path: Path) -> Pixels:
    """A photograph, of a JPEG only a fraction of the pixels: many times as fast, without checks for damage."""
    header = read_header(path)
    flag = next((flag for by, flag in REDUCTIONS.items() if min(header.size) >= by * THUMBNAIL_PX), None)
    if flag is not None and header.kind in ("JPEG", "MPO"):
        # Not imread, which dies of a name that is no text in UTF-8.
        with reading(path, "check the file"):
            data = read_small_file(path, MAX_DECODED_BYTES)
        if (reduced := cv2.imdecode(np.frombuffer(data, np.uint8), flag)) is not None:
            return np.asarray(reduced, dtype=np.uint8)
    return load(path, keep_damaged=True).pixels


def render_photographs(folder: Path, names: Sequence[str], pictures: Path, *, progress: Progress) -> list[InputFile]:
    """Render the built-in pair, or a built-in flight if there are more than two names."""
    is_pair = len(names) == 2
    scene = make_pair(BUILT_IN_SEED) if is_pair else make_lawnmower(BUILT_IN_SEED, len(names), FLIGHT_SIZE)
    for name, image in zip(names, scene.images, strict=True):
        save(folder / name, image)
    decoded = [inspect_photograph(folder, name, pictures, progress=progress) for name in names]
    return list(map(InputFile.of_upload, names, decoded))


def render_pursuit(folder: Path, names: Sequence[str], pictures: Path, *, progress: Progress) -> dict[str, InputFile]:
    """Render the built-in film of a car, and cut the template out of its first frame; both by what they are."""
    template, video = names
    film = make_pursuit(BUILT_IN_SEED, PURSUIT_FRAMES, magnification=CAR_MAGNIFICATION)
    with write_video(folder / video, DEFAULT_RATE) as write:
        for number, frame in enumerate(film.images):
            progress("rendering", number + 1, PURSUIT_FRAMES)
            write(frame)
    low, high = film.corners[0].min(axis=0), film.corners[0].max(axis=0)
    (left, top), (right, bottom) = low.astype(int) - TEMPLATE_MARGIN_PX, high.astype(int) + TEMPLATE_MARGIN_PX
    save(folder / template, film.images[0][top:bottom, left:right])
    seen = inspect_photograph(folder, template, pictures, progress=progress)
    first = inspect_video(folder, video, pictures, progress=progress)
    return {"template": InputFile.of_upload(template, seen), "video": InputFile.of_upload(video, first)}


def _describe(pixels: Pixels, notes: tuple[str, ...], pictures: Path) -> Decoded:
    """Save a reduced picture for the page, and describe the file."""
    working, _ = reduce_to_width(pixels, WORKING_WIDTH_PX)
    path = new_picture(pictures)
    save(path, working)
    return Decoded((pixels.shape[1], pixels.shape[0]), notes, path, (working.shape[1], working.shape[0]))
