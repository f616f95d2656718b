"""Selects the key frames of a video that a mosaic needs, and puts them in the video's place among photographs."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from golden_model.arrays import Float32, Pixels
from golden_model.temporary import temporary_folder
from skymosaic.common.errors import InputError
from skymosaic.common.later import Later
from skymosaic.imagery.borders import find_shown
from skymosaic.imagery.decoding import check_file, check_size
from skymosaic.imagery.exif import Metadata
from skymosaic.imagery.folders import VIDEO_SUFFIXES
from skymosaic.imagery.images import check_given, reduce_to_width, save
from skymosaic.imagery.patterns import is_folder
from skymosaic.imagery.photographs import Images, Source, list_images, list_sources
from skymosaic.imagery.subtitles import read_track

DEFAULT_RATE = Fraction(25)
"""Frames per second of a video that does not state them."""
KEY_OVERLAP = 0.65
"""Share of its area that a key frame has in common with the next, or slightly more: enough for reliable registration,
with as few frames as possible."""
FLOW_WIDTH_PX = 320
"""Frames are reduced to this width to compute their optical flow."""
FLOW_CORNERS = 400
MIN_QUALITY = 0.001
"""Strength of the weakest corner, relative to the strongest: white text over soil leaves no others at 0.01."""
MIN_CORNERS = 12
STILL_SHARE = 0.25
"""Corners that have moved less than this share of what the farthest tenth has may move with the camera: an on-screen
display, dirt on the lens."""
MIN_SHARE_MOVING = 0.2
"""If fewer of the corners move, the camera hovers above something that moves."""
BLIND_SECONDS = 1.0
"""Time between key frames in which nothing can be tracked: darkness, fog, smooth water."""


@contextlib.contextmanager
def flight_sources(
    images: Images, tell: Callable[[str], None] = lambda _line: None, *, recursive: bool = False
) -> Iterator[list[Source]]:
    """As `skymosaic.imagery.photographs.list_sources`, with each video replaced by its key frames.

    The key frames are JPEG files in a temporary folder, which is deleted when the context ends; those with a border of
    a stabiliser are PNG files in which it is transparent. ``tell`` receives also
    a line per note about a video, for instance that it was cut off.

    Raises
    ------
    InputError
        As for `list_sources`; also for a single photograph, a video that cannot be read, or a full disk.
    """
    with temporary_folder() as folder:
        sources: list[Source] = []
        given = list_images(images)
        for image in given:
            if isinstance(image, str | Path) and _is_video(Path(image)):
                frames = folder / str(len(sources))
                frames.mkdir()
                sources += _store_key_frames(image, frames, tell)
            else:
                sources += list_sources([image], tell, recursive=recursive)
        if len(sources) == 1 and isinstance(sources[0].content, Path):
            # A misspelt folder, rather than too few photographs.
            check_file(sources[0].content, "a folder, a video or at least two photographs")
            raise InputError(
                f"{given[0]}: only one photograph; a mosaic takes two that overlap, or more, so add others"
            )
        # An array is called by its number among all of them.
        names = [each.name if isinstance(each.content, Path) else f"image {n}" for n, each in enumerate(sources)]
        yield [dataclasses.replace(sources[n], index=n, name=name) for n, name in enumerate(names)]


def _is_video(path: Path) -> bool:
    return path.suffix.lower() in VIDEO_SUFFIXES and not is_folder(path)


def _store_key_frames(video: str | Path, folder: Path, tell: Callable[[str], None]) -> Iterator[Source]:
    for name, frame, taken, _ in read_key_frames(video, tell):
        # Later, the file would be named, which the user does not know.
        check_size(name, frame.pixels.shape[1], frame.pixels.shape[0])
        shown = find_shown(frame.pixels)
        path = folder / f"{frame.number}.{'jpg' if shown is None else 'png'}"
        save(path, frame.pixels if shown is None else np.dstack((frame.pixels, shown)))
        yield Source(0, name, path, taken=taken)


def read_key_frames(
    video: str | Path, tell: Callable[[str], None]
) -> Iterator[tuple[str, "KeyFrame", Metadata, float]]:
    """The key frames of a video or stream, each with its name, where it was taken, and when, s after the first frame.

    Where, if subtitles beside it say that. ``tell`` receives a line per note about the video.
    """
    reader = Later("skymosaic.imagery.video").VideoReader(video)
    track = None if reader.is_stream else read_track(Path(video), reader.length_s, reader.notes.append)
    seconds: list[float] = []

    def timed() -> Iterator[Pixels]:
        for pixels in reader:
            seconds.append(reader.seconds)
            yield pixels

    for frame in select_key_frames(timed(), reader.frame_rate, reader.notes.append):
        taken = Metadata() if track is None else Metadata(track(seconds[frame.number]))
        yield name_frame(video, frame.number), frame, taken, seconds[frame.number]
    for note in reader.notes:
        tell(f"note {video}: {note}")


def name_frame(video: str | Path, number: int) -> str:
    """The name of a video's frame, with the video as the user gave it."""
    return f"{video}/frame {number}"


class KeyFrame(NamedTuple):
    """A frame for registration, and its number in the video, from 0."""

    number: int
    pixels: Pixels


def select_key_frames(
    frames: Iterable[Pixels],
    frame_rate: Fraction | float = DEFAULT_RATE,
    tell: Callable[[str], None] = lambda _line: None,
) -> Iterator[KeyFrame]:
    """Select the first frame, then repeatedly the last one that still shows `KEY_OVERLAP` of the previous key frame.

    The video's last frame is a key frame too. A hovering camera gives two key frames; a steady flight gives frames that
    overlap by slightly more than that. Where the view moves farther between two frames, both are key frames. Where
    nothing can be tracked, one is at most every `BLIND_SECONDS`.

    Parameters
    ----------
    frames : iterable of (H, W, 3) or (H, W) uint8 ndarray
        All of one shape; anything else is an `InputError`. A key frame is yielded only once a later frame is known.
    frame_rate : Fraction or float
        Frames per second.
    tell : callable
        Receives a line at the end if nothing could be tracked in some frames.
    """
    flow, candidate, blind = None, None, 0
    for current in _check_frames(frames):
        if flow is not None and flow.is_blind:
            now = _Flow(current)
            blind += now.is_blind
            if now.is_blind and current.number < flow.number + BLIND_SECONDS * frame_rate:
                candidate = current
            else:
                yield current
                flow, candidate = now, None
        elif flow is not None and flow.common_share(current) >= KEY_OVERLAP:
            candidate = current
        elif candidate is None:
            yield current
            flow = _Flow(current)
            blind += flow.is_blind
        else:
            yield candidate
            # The current frame follows the new key frame, and is its first candidate.
            flow, candidate = _Flow(candidate), current
            blind += flow.is_blind
            flow.common_share(current)
    if candidate is not None:
        yield candidate
    if blind:
        tell(f"frames in which nothing can be tracked (dark, fog, smooth water?): {blind}; one a second is used")


def _check_frames(frames: Iterable[Pixels]) -> Iterator[KeyFrame]:
    """Number the frames, and check that all have one shape."""
    first: tuple[int, ...] = ()
    for number, pixels in enumerate(frames):
        check_given(pixels, f"frame {number}")
        # A path has no shape.
        first = first or np.shape(pixels)
        if not first or np.shape(pixels) != first:
            raise InputError(f"frame {number}: no array of the first frame's shape; read it, or resize it")
        yield KeyFrame(number, pixels)


class _Flow:
    """Tracks a key frame's corners by pyramidal Lucas-Kanade (thesis, equations II-8 to II-11)."""

    def __init__(self, key: KeyFrame) -> None:
        self.number = key.number
        self._last = _small_gray(key.pixels)
        corners = cv2.goodFeaturesToTrack(self._last, FLOW_CORNERS, qualityLevel=MIN_QUALITY, minDistance=7)
        self._points = np.zeros((0, 1, 2), np.float32) if corners is None else corners
        self._key_points = self._points
        # The strongest corners of fog are too weak to be found even where they are.
        self._track(self._last)
        self.is_blind = len(self._points) < MIN_CORNERS
        """Whether too few corners can be tracked, wherever the camera moves."""

    def _track(self, gray: Pixels) -> None:
        """Find the points in the next frame, and drop those that are lost."""
        if len(self._points):
            points, status, _ = cv2.calcOpticalFlowPyrLK(self._last, gray, self._points, None)
            tracked = status[:, 0] == 1
            self._points, self._key_points = points[tracked], self._key_points[tracked]
        self._last = gray

    def common_share(self, frame: KeyFrame) -> float:
        """Share of the key frame's area that the next frame shows; 0 if tracking fails."""
        gray = _small_gray(frame.pixels)
        self._track(gray)
        if len(self._points) < MIN_CORNERS:
            return 0.0
        motion = _motion(self._key_points, self._points)
        if motion is None:
            return 0.0
        # The area of the key frame's outline, clipped to the new frame. The determinant undoes the change of scale.
        height, width = gray.shape
        border = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
        common, _ = cv2.intersectConvexConvex(border, cv2.transform(border[None], motion)[0])
        return float(common / (np.linalg.det(motion[:, :2]) * width * height))


def _motion(key_points: Float32, points: Float32) -> Float32 | None:
    """The similarity (2, 3) that most of the moving corners follow; None if too few do.

    The corners of an on-screen display stay, but for a drift by what passes behind them, and all others that stay with
    them fit the motion as well as those that move.
    """
    distance_px = np.linalg.norm(points - key_points, axis=(1, 2))
    moves = distance_px > STILL_SHARE * np.percentile(distance_px, 90)
    if np.count_nonzero(moves) < MIN_SHARE_MOVING * len(moves):
        moves[:] = True
    motion, inliers = cv2.estimateAffinePartial2D(key_points[moves], points[moves], ransacReprojThreshold=2.0)
    return None if motion is None or inliers.sum() < MIN_CORNERS else np.asarray(motion, dtype=np.float32)


def _small_gray(pixels: Pixels) -> Pixels:
    small, _ = reduce_to_width(pixels, FLOW_WIDTH_PX)
    return small if small.ndim == 2 else np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
