"""Where the frames of a live mosaic come from: a folder that fills, a video, or a camera."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.errors import InputError
from skymosaic.imagery.images import Photograph, load
from skymosaic.imagery.photographs import sources
from skymosaic.imagery.video import VideoReader, key_frames

POLL_SECONDS = 0.2
SETTLED_SECONDS = 0.5
"""A file that has not changed for so long is complete."""


def live_frames(
    source: str, *, idle_seconds: float | None, tell: Callable[[str], None], made: Collection[Path] = ()
) -> Iterator[Photograph]:
    """Frames as they come.

    Parameters
    ----------
    source : str
        A folder, whose pictures are taken as they appear; a camera's number; a video file, or a stream's address
        (``rtsp://...``). Of a video and a camera, the key frames.
    idle_seconds : float or None
        A folder ends when nothing new has appeared for so long; None: never.
    tell : callable
        Receives a line for each file that cannot be used, and for what was noticed of a video.
    made : collection of Path
        Pictures that are written meanwhile: in the folder, they are no frames.

    Raises
    ------
    InputError
        For a source that is missing or cannot be read.
    """
    if source.isdecimal():
        for frame in key_frames(_camera(int(source))):
            yield Photograph(f"camera {source}, frame {frame.number}", frame.pixels)
    elif Path(source).is_dir():
        yield from _appearing(Path(source), idle_seconds, tell, {path.resolve() for path in made})
    else:
        reader = VideoReader(source)
        for frame in key_frames(reader):
            yield Photograph(f"{source}, frame {frame.number}", frame.pixels)
        for note in reader.notes:
            tell(f"{source}: {note}")


def _appearing(
    folder: Path, idle_seconds: float | None, tell: Callable[[str], None], made: Collection[Path]
) -> Iterator[Photograph]:
    """The pictures of a folder when they are complete, in the order of their names; again if they change."""
    taken: set[tuple[Path, int]] = set()
    last = time.monotonic()
    while idle_seconds is None or time.monotonic() - last < idle_seconds:
        complete = _complete_pictures(folder)
        new = [version for version in complete if version not in taken and version[0].resolve() not in made]
        for path, changed in new:
            taken.add((path, changed))
            try:
                yield load(path)
            except InputError as error:
                # A slow copy may only have paused: what changes once more is looked at again.
                tell(f"left out: {error}")
        if new:
            last = time.monotonic()
        else:
            time.sleep(POLL_SECONDS)


def _complete_pictures(folder: Path) -> list[tuple[Path, int]]:
    """Pictures that have settled, each with the time of its last change in ns."""
    try:
        paths = [Path(found.name) for found in sources([folder])]
    except InputError:  # None so far.
        return []
    complete = []
    for path in paths:
        with contextlib.suppress(OSError):  # It was renamed or removed meanwhile.
            changed = path.stat().st_mtime_ns
            # A clock that differs from the file server's only makes the wait longer or shorter.
            if abs(time.time_ns() - changed) >= SETTLED_SECONDS * 1e9:
                complete.append((path, changed))
    return complete


def _camera(number: int) -> Iterator[Pixels]:
    # OpenCV's own lines about a missing camera would come before ours.
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
