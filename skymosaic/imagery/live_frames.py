"""Frame sources of a live mosaic: a folder to which pictures are added, a video, a stream, or a camera."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.errors import InputError
from skymosaic.imagery.band_sets import select_band
from skymosaic.imagery.images import Photograph, load
from skymosaic.imagery.photographs import is_folder, list_folder, list_sources
from skymosaic.imagery.video import VideoReader, select_key_frames

POLL_SECONDS = 0.2
SETTLED_SECONDS = 0.5
"""A file that has not changed for this time is considered complete."""


def read_live_frames(
    source: str,
    *,
    idle_seconds: float | None,
    tell: Callable[[str], None],
    made: Collection[Path] = (),
    band: str | None = None,
) -> Iterator[Photograph]:
    """Yield frames as they arrive.

    Parameters
    ----------
    source : str
        A folder, whose pictures are read as they appear; a camera's number; a video file, or a stream's address
        (``rtsp://...``). Of videos, streams and cameras, only key frames are yielded.
    idle_seconds : float or None
        A folder ends when no new picture has appeared for this time; None: never.
    tell : callable
        Receives a line for each file that cannot be used, and for each note about a video.
    made : collection of Path
        Pictures that the caller writes meanwhile; in the folder, they are not frames.
    band : str or None
        Of a folder with multi-band sets, the band whose files are the frames.

    Raises
    ------
    InputError
        For a missing or unreadable source, multi-band sets without ``band``, and ``band`` without a folder.
    """
    if band is not None and not is_folder(Path(source)):
        raise InputError(f"band {band}: only a folder can hold multi-band sets; leave out --band")
    if source.isdecimal():
        for frame in select_key_frames(_camera(int(source))):
            yield Photograph(f"camera {source}, frame {frame.number}", frame.pixels)
    elif is_folder(Path(source)):
        # A folder may be empty, or away for a while once it has been read; one that cannot be read now never will be.
        list_folder(Path(source))
        yield from _appearing(Path(source), idle_seconds, tell, {path.resolve() for path in made}, band)
    else:
        reader = VideoReader(source)
        for frame in select_key_frames(reader):
            yield Photograph(f"{source}, frame {frame.number}", frame.pixels)
        for note in reader.notes:
            tell(f"{source}: {note}")


def _appearing(
    folder: Path,
    idle_seconds: float | None,
    tell: Callable[[str], None],
    made: Collection[Path],
    band: str | None,
) -> Iterator[Photograph]:
    """The pictures of a folder once they are complete, sorted by name; a picture that changes is yielded again."""
    taken: set[tuple[Path, int]] = set()
    last = time.monotonic()
    while idle_seconds is None or time.monotonic() - last < idle_seconds:
        complete = _complete_pictures(folder, band)
        new = [version for version in complete if version not in taken and version[0].resolve() not in made]
        for path, changed in new:
            taken.add((path, changed))
            try:
                yield load(path)
            except InputError as error:
                # This may be a slow copy that paused; if the file changes again, it is read again.
                tell(f"left out: {error}")
        if new:
            last = time.monotonic()
        else:
            time.sleep(POLL_SECONDS)


def _complete_pictures(folder: Path, band: str | None) -> list[tuple[Path, int]]:
    """The folder's complete pictures, or those of one band, each with the time of its last change in ns."""
    try:
        pictures = list_sources([folder])
    except InputError:  # There are no pictures yet.
        return []
    paths = [Path(found.name) for found in select_band(pictures, band)]
    complete = []
    for path in paths:
        with contextlib.suppress(OSError):  # The file may have been renamed or removed meanwhile.
            changed = path.stat().st_mtime_ns
            # The file server's clock may be ahead of ours, which makes the difference negative.
            if abs(time.time_ns() - changed) >= SETTLED_SECONDS * 1e9:
                complete.append((path, changed))
    return complete


def _camera(number: int) -> Iterator[Pixels]:
    # Otherwise OpenCV prints its own messages about a missing camera before ours.
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    capture = cv2.VideoCapture(number)
    cv2.utils.logging.setLogLevel(level)
    try:
        if not capture.isOpened():
            raise InputError(f"camera {number}: cannot be opened; check that it is connected and not in use")
        while True:
            done, pixels = capture.read()
            if not done:
                return
            yield np.asarray(pixels, dtype=np.uint8)
    finally:
        capture.release()
