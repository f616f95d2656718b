"""Reads and writes video with FFmpeg's libraries, and selects the key frames of a video that a mosaic needs."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import av
import cv2
import numpy as np
from av.error import FFmpegError

from golden_model.arrays import Pixels
from skymosaic.errors import InputError
from skymosaic.imagery.decoding import MAX_AREA_PX, check_file
from skymosaic.imagery.images import reduce_to_width, write_atomically

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".ts", ".mts", ".m2ts", ".webm", ".wmv", ".mpg", ".mpeg")
"""Suffixes of files that are treated as videos where photographs are accepted too."""
OUTPUT_SUFFIXES = (".mp4", ".mov", ".mkv")
DEFAULT_RATE = Fraction(25)
"""Frames per second if the video does not state it."""
CONSTANT_QUALITY = "18"
"""x264's constant rate factor; 18 is visually lossless."""
KEY_OVERLAP = 0.65
"""Share of its area that a key frame has in common with the next, or slightly more: enough for reliable registration,
with as few frames as possible."""
FLOW_WIDTH_PX = 320
"""Frames are reduced to this width to compute their optical flow."""
FLOW_CORNERS = 200
MIN_CORNERS = 12


FILE_OPTIONS = {
    "protocol_whitelist": "file",
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,asf",
}
"""FFmpeg recognises formats by content, among them play lists, which open other files and addresses."""
STREAM_OPTIONS = {"protocol_whitelist": "rtsp,rtp,udp,tcp,tls,http,https,httpproxy,rtmp,rtmps,srt,crypto"}
"""A stream must not name local files."""


class VideoReader:
    """The frames of a video, one at a time, turned upright by its rotation tag.

    Iterating yields uint8 arrays, shape (H, W, 3) BGR. Damaged packets, such as the last one of a recording that was
    cut off, are skipped; after the last frame, `notes` says so.

    Parameters
    ----------
    path : str or Path
        A file, or the address of a stream (``rtsp://...``).

    Attributes
    ----------
    frame_rate : Fraction
        Mean frames per second.
    notes : list of str
        Changes made to the frames, and faults of the file.

    Raises
    ------
    InputError
        If it cannot be opened or contains no video; while iterating, if no frame can be decoded.
    """

    def __init__(self, path: str | Path) -> None:
        self.name = str(path)
        self.notes: list[str] = []
        is_stream = "://" in self.name
        if not is_stream:
            check_file(Path(path), "a video")
        try:
            self._container = av.open(self.name, options=STREAM_OPTIONS if is_stream else FILE_OPTIONS)
        except (FFmpegError, OSError, ValueError):
            raise InputError(
                f"{self.name}: not a readable video, or a recording cut off before its index was written; "
                "give another file or repair it"
            ) from None
        # A stream that is cut off inside its first frame has no codec context.
        streams = [stream for stream in self._container.streams.video if stream.codec_context]
        if not streams:
            self._container.close()
            raise InputError(f"{self.name}: a video without frames; give another file")
        self._stream = streams[0]
        self._stream.thread_type = "AUTO"
        self._stream.codec_context.options = {"max_pixels": str(MAX_AREA_PX)}
        self.frame_rate = self._stream.average_rate or self._stream.guessed_rate or DEFAULT_RATE

    def __iter__(self) -> Iterator[Pixels]:
        quarter_turns, frames, other_size = 0, 0, 0
        first: tuple[int, ...] = ()
        with self._container:
            for turns, stored in self._decoded():
                pixels = np.ascontiguousarray(np.rot90(stored, turns), dtype=np.uint8)
                first = first or pixels.shape
                # Optical flow, tracking and the encoder need frames of one size.
                if pixels.shape != first:
                    other_size += 1
                    continue
                quarter_turns = turns
                frames += 1
                yield pixels
        if not frames:
            raise InputError(f"{self.name}: no frame of the video can be decoded; give another file")
        if quarter_turns:
            self.notes.append("turned upright by its rotation tag")
        if other_size:
            self.notes.append(f"the size changes; {other_size} frames that are not {first[1]}x{first[0]} are left out")
        if frames + other_size < self._stream.frames:
            self.notes.append(f"{frames} of {self._stream.frames} frames can be decoded; the others are left out")

    def _decoded(self) -> Iterator[tuple[int, Pixels]]:
        """The quarter turns and the pixels of each frame, as they are stored."""
        packets = self._container.demux(self._stream)
        # The demuxer raises an error if the file ends in the middle of a packet.
        with contextlib.suppress(FFmpegError):
            for packet in packets:
                if not packet.is_corrupt:
                    yield from _frames_of(packet)


def _frames_of(packet: av.Packet) -> list[tuple[int, Pixels]]:
    # Besides FFmpeg's own errors, PyAV raises ValueError for a pixel format that it cannot convert.
    with contextlib.suppress(FFmpegError, ValueError):
        return [(round(frame.rotation / 90) % 4, frame.to_ndarray(format="bgr24")) for frame in packet.decode()]
    return []


@contextlib.contextmanager
def write_video(path: Path, frame_rate: Fraction) -> Iterator[Callable[[Pixels], None]]:
    """Write H.264 under a temporary name, which is renamed to ``path`` at the end; a failure leaves no file.

    The context is a function that appends a frame, (H, W, 3) uint8 BGR, all of one size. An odd last row or column is
    dropped, because colour is stored at half resolution.

    Parameters
    ----------
    path : Path
        Its suffix, one of `OUTPUT_SUFFIXES`, determines the container.
    frame_rate : Fraction
        Frames per second.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    muxer = {".mp4": "mp4", ".mov": "mov", ".mkv": "matroska"}[path.suffix.lower()]
    with write_atomically(path) as temporary, av.open(str(temporary), "w", format=muxer) as container:
        stream = container.add_stream("libx264", rate=frame_rate, options={"crf": CONSTANT_QUALITY, "preset": "fast"})

        def write(pixels: Pixels) -> None:
            even = np.ascontiguousarray(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])
            # The size is only known with the first frame, and may not change once the encoder is open.
            if not stream.codec_context.is_open:
                stream.height, stream.width = even.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="bgr24")))

        yield write
        # The encoder holds frames back to reorder them; encoding nothing returns the last ones.
        container.mux(stream.encode())


class KeyFrame(NamedTuple):
    """A frame selected for registration, and its number in the video, from 0."""

    number: int
    pixels: Pixels


def select_key_frames(frames: Iterable[Pixels], *, overlap: float = KEY_OVERLAP) -> Iterator[KeyFrame]:
    """Select the first frame, then repeatedly the last one that still shows ``overlap`` of the previous key frame.

    The video's last frame is a key frame too. A hovering camera gives two key frames, a steady flight gives frames that
    overlap by slightly more than ``overlap``. Where the view moves farther between two frames, both are key frames.

    Parameters
    ----------
    frames : iterable of (H, W, 3) uint8 ndarray
        All of one size. A key frame is yielded only after a later frame has been seen.
    overlap : float
        Share of the area, 0..1.
    """
    flow, held = None, None
    for current in map(KeyFrame, itertools.count(), frames):
        gray = _small_gray(current.pixels)
        if flow is None:
            yield current
            flow = _Flow(gray)
        elif flow.common_share(gray) >= overlap:
            held = current
        elif held is None:
            yield current
            flow = _Flow(gray)
        else:
            yield held
            flow, held = _Flow(_small_gray(held.pixels)), current
            flow.common_share(gray)
    if held is not None:
        yield held


class _Flow:
    """Tracks the corners of a key frame by pyramidal Lucas-Kanade (thesis, equations II-8 to II-11)."""

    def __init__(self, key: Pixels) -> None:
        self._last = key
        corners = cv2.goodFeaturesToTrack(key, FLOW_CORNERS, qualityLevel=0.01, minDistance=7)
        self._key_points = np.zeros((0, 1, 2), np.float32) if corners is None else corners
        self._points = self._key_points

    def common_share(self, gray: Pixels) -> float:
        """Share of the key frame's area that the next frame shows; 0 if tracking failed."""
        if len(self._points) < MIN_CORNERS:
            return 0.0
        points, found, _ = cv2.calcOpticalFlowPyrLK(self._last, gray, self._points, None)
        followed = found[:, 0] == 1
        self._last, self._points, self._key_points = gray, points[followed], self._key_points[followed]
        if len(self._points) < MIN_CORNERS:
            return 0.0
        motion, inliers = cv2.estimateAffinePartial2D(self._key_points, self._points, ransacReprojThreshold=2.0)
        if motion is None or inliers.sum() < MIN_CORNERS:
            return 0.0
        # The key frame's outline in the new frame, clipped to it; the determinant undoes the change of scale.
        height, width = gray.shape
        frame = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
        common, _ = cv2.intersectConvexConvex(frame, cv2.transform(frame[None], motion)[0])
        return float(common / (np.linalg.det(motion[:, :2]) * width * height))


def _small_gray(pixels: Pixels) -> Pixels:
    small, _ = reduce_to_width(pixels, FLOW_WIDTH_PX)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
