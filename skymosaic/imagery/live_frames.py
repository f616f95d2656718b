"""Frame sources of a live mosaic: a folder that receives pictures, a video, a stream, or a camera."""

import contextlib
import re
import time
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from golden_model.arrays import Pixels
from skymosaic.common.errors import InputError
from skymosaic.common.temporary import resolved
from skymosaic.imagery.band_sets import select_band
from skymosaic.imagery.exif import Metadata
from skymosaic.imagery.folders import list_pictures
from skymosaic.imagery.images import Photograph, load
from skymosaic.imagery.key_frames import name_frame, read_key_frames, select_key_frames
from skymosaic.imagery.patterns import is_folder
from skymosaic.imagery.photographs import Source, list_sources

POLL_SECONDS = 0.2
SETTLED_SECONDS = 0.5
"""A file that has not changed for this time is complete."""
CAMERA_NUMBER = re.compile(r"\d{1,2}")
"""OpenCV's cameras; longer numbers are names of files and folders, such as a year or ``100``."""


class LiveFrame(NamedTuple):
    """A frame; its photograph's name is that of its file, or of the video with the frame's number.

    ``seen`` is how many frames the source has shown up to it, those of a video that are passed over included. ``stamp``
    is when it is shown, s after the first frame of a video or stream.
    """

    photograph: Photograph
    seen: int = 0
    file: Path | None = None
    taken: Metadata | None = None
    stamp: float | None = None


def read_live_frames(
    source: str,
    *,
    idle_seconds: float | None,
    tell: Callable[[str], None],
    unusable: dict[str, str] | None = None,
    made: Collection[Path] = (),
    band: str | None = None,
    recursive: bool = False,
    keep_damaged: bool = False,
) -> Iterator[LiveFrame]:
    """Yield frames as they arrive.

    Parameters
    ----------
    source : str
        A folder, whose pictures are read as they appear; a camera's number; a video file, or a stream's address
        (``rtsp://...``). Videos, streams and cameras give their key frames only.
    idle_seconds : float or None
        A folder ends when no new picture has appeared for this time; None: never.
    tell : callable
        Receives a line per file that cannot be used, per note about a video, and about what else a folder has.
    unusable : dict
        Receives why files could not be used, by their names, and loses one that can be used after it has changed.
    made : collection of Path
        Pictures that the caller writes meanwhile, which are no frames even in the folder.
    band : str or None
        The band whose files are the frames, for a folder of multi-band sets.
    recursive : bool
        Whether the pictures of folders inside the folder are frames too.
    keep_damaged : bool
        Whether damaged files are frames as far as they can be decoded.

    Raises
    ------
    InputError
        For a missing or unreadable source, multi-band sets without ``band``, and ``band`` without a folder.
    """
    if band is not None and not is_folder(Path(source)):
        raise InputError(f"`band` {band}: only a folder can hold multi-band sets; leave it out")
    if CAMERA_NUMBER.fullmatch(source):
        for frame in select_key_frames(_camera(int(source))):
            name = name_frame(f"camera {source}", frame.number)
            yield LiveFrame(Photograph(name, frame.pixels), frame.number + 1)
    elif is_folder(Path(source)):
        # Only a folder that has been read once may later be away for a while.
        if unread := list_pictures(Path(source), recursive=recursive).describe_unread():
            tell(f"note {source}: not read: {unread}")
        own = {resolved(path) for path in made}
        read = partial(list_sources, [source], recursive=recursive)
        unusable = {} if unusable is None else unusable
        yield from _watch_folder(read, idle_seconds, tell, unusable, own, band=band, keep_damaged=keep_damaged)
    else:
        for name, frame, taken, stamp in read_key_frames(source, tell):
            yield LiveFrame(Photograph(name, frame.pixels), frame.number + 1, taken=taken, stamp=stamp)


def _watch_folder(
    read: Callable[[], list[Source]],
    idle_seconds: float | None,
    tell: Callable[[str], None],
    unusable: dict[str, str],
    made: Collection[Path],
    *,
    band: str | None,
    keep_damaged: bool,
) -> Iterator[LiveFrame]:
    """Yield the pictures of a folder once they are complete, sorted by name; a picture that changes comes again."""
    done: set[tuple[Path, int]] = set()
    last = time.monotonic()
    while True:
        complete = _complete_pictures(read, band)
        new = [version for version in complete if version not in done and resolved(version[0]) not in made]
        for path, changed in new:
            done.add((path, changed))
            try:
                photograph = load(path, keep_damaged=keep_damaged)
                unusable.pop(str(path), None)
                yield LiveFrame(photograph, len(done), path)
            except InputError as error:
                # A slow copy may have paused. If the file changes again, it is read again.
                unusable[str(path)] = str(error)
                tell(f"left out: {error}")
        if new:
            last = time.monotonic()
        elif idle_seconds is not None and time.monotonic() - last >= idle_seconds:
            return
        else:
            time.sleep(POLL_SECONDS)


def _complete_pictures(read: Callable[[], list[Source]], band: str | None) -> list[tuple[Path, int]]:
    """The folder's complete pictures, or those of one band, each with the time of its last change in ns."""
    try:
        pictures = read()
    # There are no pictures yet.
    except InputError:
        return []
    complete = []
    for source in select_band(pictures, band):
        path = Path(source.name)
        # The file may have been renamed or removed meanwhile.
        with contextlib.suppress(OSError):
            changed = path.stat().st_mtime_ns
            # If the file server's clock is ahead of ours, the difference is negative.
            if abs(time.time_ns() - changed) >= SETTLED_SECONDS * 1e9:
                complete.append((path, changed))
    return complete


def _camera(number: int) -> Iterator[Pixels]:
    # OpenCV would print messages of its own about a missing camera.
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
