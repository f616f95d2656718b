"""Reads and writes video with FFmpeg's libraries."""

import contextlib
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from av.error import FFmpegError
from av.sidedata.sidedata import Type
from av.stream import Disposition
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from skymosaic.common.errors import InputError
from skymosaic.common.temporary import write_atomically
from skymosaic.imagery.decoding import MAX_AREA_PX, check_file
from skymosaic.imagery.key_frames import DEFAULT_RATE
from skymosaic.imagery.orientation import turn_pixels

OUTPUT_SUFFIXES = (".mp4", ".mov", ".mkv")
TICKS_PER_SECOND = 90_000
"""Resolution of time in the videos written; the usual rates are whole numbers of it."""
MIN_STEP_S, MAX_STEP_S = 2 / TICKS_PER_SECOND, 3600.0
"""Shortest and longest time from frame to frame; damaged ones repeat, run back, or on for years."""
MISSING_S = 1.0
"""What a file without a count of frames may last longer than they do: the last one may be shown for long."""
MIN_SHAPE = 0.25
"""Pixels that are said to be longer than this are a mistake; those of film are up to 2:1."""
CONSTANT_QUALITY = "18"
"""x264's constant rate factor; 18 is visually lossless."""
FILE_OPTIONS = {
    "protocol_whitelist": "file",
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,asf",
}
"""FFmpeg recognises formats by content. Among them are play lists, which open other files and addresses."""
PROTOCOLS = "rtsp,rtp,udp,tcp,tls,http,https,httpproxy,rtmp,rtmps,srt,crypto"
STREAM_OPTIONS = {"protocol_whitelist": PROTOCOLS}
"""A stream must not name local files."""

OPEN_SECONDS = 10.0
STREAM_FAULTS: dict[type[Exception], str] = {
    av.error.ConnectionRefusedError: "nothing answers there; check host and port, and that the camera is on",
    av.error.ExitError: f"nothing came for {OPEN_SECONDS:g} seconds; check that the camera sends, and the network",
    av.error.HTTPUnauthorizedError: "it asks for a name and a password; put them before the host, NAME:PASSWORD@HOST",
    av.error.HTTPNotFoundError: "the host has no such stream; check the end of the address",
    av.error.ProtocolNotFoundError: f"unknown kind of address; valid: {PROTOCOLS.replace(',', ', ')}",
}
UNREADABLE = "not a readable video, or a recording cut off before its index was written; give another file or repair it"


class VideoReader:
    """The frames of a video, one at a time, turned and mirrored as its display matrix says.

    Iterating yields uint8 arrays, shape (H, W, 3) BGR. Damaged packets, such as the last one of a recording that was
    cut off, are skipped, which `notes` states after the last frame.

    Parameters
    ----------
    path : str or Path
        A file, or the address of a stream (``rtsp://...``).

    Raises
    ------
    InputError
        If it cannot be opened or contains no video; or while iterating, if no frame can be decoded.
    """

    def __init__(self, path: str | Path) -> None:
        self.name = str(path)
        self.notes: list[str] = []
        """Changes to the frames, and faults of the file."""
        self.seconds = 0.0
        """When the latest frame is shown, after the first. Telephones and screen recorders vary the rate."""
        self.is_stream = "://" in self.name
        if not self.is_stream:
            check_file(Path(path), "a video")
        options, timeout_s = (STREAM_OPTIONS, (OPEN_SECONDS, None)) if self.is_stream else (FILE_OPTIONS, None)
        try:
            self._container = av.open(self.name, options=options, timeout=timeout_s)
        except (FFmpegError, OSError, ValueError) as error:
            raise InputError(f"{self.name}: {_explain(error) if self.is_stream else UNREADABLE}") from None
        # A stream that was cut off inside its first frame has no codec context.
        streams = [stream for stream in self._container.streams.video if stream.codec_context]
        if not streams:
            self._container.close()
            raise InputError(f"{self.name}: a video without frames; give another file")
        # A thermal camera's track, or a picture for a list of films, may be the first.
        self._stream = max(streams, key=lambda each: (not _is_cover(each), each.width * each.height))
        others = [
            f"{each.width}x{each.height}{' (a cover)' * _is_cover(each)}" for each in streams if each != self._stream
        ]
        if others:
            self.notes.append(
                f"of its tracks that of {self._stream.width}x{self._stream.height} is read, not {', '.join(others)}"
            )
        self._stream.thread_type = "AUTO"
        # A hostile file may declare frames of any size.
        self._stream.codec_context.options = {"max_pixels": str(MAX_AREA_PX)}
        # What a telephone trimmed off stays in the file.
        trimmed = sum(entry.is_discard for entry in self._stream.index_entries)
        self._declared = self._stream.frames - trimmed
        self.length_s = float((self._container.duration or 0) / av.time_base)
        self._damaged = 0
        # An AVI counts the frames, too, that its camera had no time for; its index does not. A cut one, whose duration
        # FFmpeg shortens, has no index.
        if self._container.format.name == "avi" and self._stream.duration == self._stream.frames:
            self._declared = len(self._stream.index_entries)
        self.frame_rate = self._stream.average_rate or self._stream.guessed_rate or DEFAULT_RATE
        """Mean frames per second."""

    def __iter__(self) -> Iterator[Pixels]:
        frames, other_size = 0, 0
        first: tuple[int, ...] = ()
        usual_s, last = float(1 / self.frame_rate), None
        with self._container:
            for matrix, stored, time in self._decode():
                pixels = self._make_upright(self._make_square(stored), matrix)
                first = first or pixels.shape
                # Optical flow, tracking and the encoder need frames of one size.
                if pixels.shape != first:
                    other_size += 1
                    continue
                if frames:
                    step_s = usual_s if time is None or last is None else time - last
                    self.seconds += max(step_s, MIN_STEP_S) if step_s < MAX_STEP_S else usual_s
                last = time
                frames += 1
                yield pixels
        if not frames:
            raise InputError(f"{self.name}: no frame of the video can be decoded; give another file")
        if other_size:
            self.notes.append(f"the size changes; {other_size} frames that are not {first[1]}x{first[0]} are left out")
        if frames + other_size < self._declared:
            self.notes.append(f"{frames} of {self._declared} frames can be decoded; the others are left out")
        elif self._declared <= 0 and not self.is_stream:
            self._note_missing(self.seconds + usual_s)

    def _note_missing(self, shown_s: float) -> None:
        """Note what is missing of a file that does not count its frames, as Matroska and MPEG-TS."""
        if self._damaged:
            self.notes.append(f"damaged packets or frames that are left out: {self._damaged}")
        if self.length_s > shown_s + MISSING_S:
            self.notes.append(f"the last frame ends at {shown_s:.1f} of {self.length_s:.1f} s; the others are missing")

    def _make_upright(self, stored: Pixels, matrix: NDArray[np.int32]) -> Pixels:
        """Turn and mirror a frame by the quarter nearest to its display matrix, (2, 2), which row vectors x, y meet."""
        upright = turn_pixels(stored, matrix.T)
        (right, right_down), (down_right, down) = matrix.tolist()
        mirrored = right * down < right_down * down_right
        note = "mirrored as its display matrix says" if mirrored else "turned upright by its rotation tag"
        if (abs(right_down) > abs(right) or min(right, down) < 0) and note not in self.notes:
            self.notes.append(note)
        return upright

    def _make_square(self, stored: Pixels) -> Pixels:
        """Widen frames whose pixels are narrower than they are high, and the other way round."""
        shape = self._stream.sample_aspect_ratio or 1
        if not MIN_SHAPE < shape < 1 / MIN_SHAPE or shape == 1:
            return stored
        height, width = stored.shape[:2]
        size = (round(width * shape), height) if shape > 1 else (width, round(height / shape))
        if (note := f"pixels of {shape} made square: {size[0]}x{size[1]}") not in self.notes:
            self.notes.append(note)
        return np.asarray(cv2.resize(stored, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)

    def _decode(self) -> Iterator[tuple[NDArray[np.int32], Pixels, float | None]]:
        """Decode the frames as they are stored; yields the display matrix (2, 2), the pixels and the time of each."""
        packets = self._container.demux(self._stream)
        try:
            for packet in packets:
                try:
                    frames = [] if packet.is_corrupt else packet.decode()
                    whole = [each for each in frames if not each.is_corrupt]
                    yield from [(_matrix(each), each.to_ndarray(format="bgr24"), each.time) for each in whole]
                    self._damaged += packet.is_corrupt + len(frames) - len(whole)
                # Besides FFmpeg's errors, PyAV raises ValueError for a pixel format that it cannot convert.
                except (FFmpegError, ValueError):
                    self._damaged += 1
        # The demuxer raises an error if the file ends in the middle of a packet.
        except FFmpegError as error:
            if self.is_stream:
                self.notes.append(f"the stream broke off: {error.strerror}")


def _is_cover(stream: av.VideoStream) -> bool:
    return bool(stream.disposition & Disposition.attached_pic)


def _matrix(frame: av.VideoFrame) -> NDArray[np.int32]:
    """The part (2, 2) of a frame's display matrix that turns and mirrors."""
    data = frame.side_data.get(Type.DISPLAYMATRIX)
    return np.eye(2, dtype=np.int32) if data is None else np.frombuffer(bytes(data), np.int32).reshape(3, 3)[:2, :2]


def _explain(error: Exception) -> str:
    """Why a stream cannot be opened, and what to do."""
    fault = next((fault for kind, fault in STREAM_FAULTS.items() if isinstance(error, kind)), "")
    reason = getattr(error, "strerror", None) or str(error)
    return f"the stream cannot be opened: {fault or f'{reason}; check the address and the network'}"


@contextlib.contextmanager
def write_video(
    path: Path, frame_rate: Fraction, seconds: Callable[[], float] | None = None
) -> Iterator[Callable[[Pixels], None]]:
    """Write H.264 under a temporary name, which is renamed to ``path`` at the end; a failure leaves no file.

    The context is a function that appends a frame, (H, W, 3) uint8 BGR, all of one size. An odd last row or column is
    dropped, because H.264 stores colour at half resolution. The suffix, one of `OUTPUT_SUFFIXES`, determines the
    container. ``seconds`` says when the frame is shown, later than the last; without it, all follow at ``frame_rate``.

    Raises
    ------
    OutputError
    """
    muxer = {".mp4": "mp4", ".mov": "mov", ".mkv": "matroska"}[path.suffix.lower()]
    # The temporary name has no suffix from which FFmpeg could tell the format.
    with write_atomically(path) as temporary, av.open(str(temporary), "w", format=muxer) as container:
        stream = container.add_stream("libx264", rate=frame_rate, options={"crf": CONSTANT_QUALITY, "preset": "fast"})
        if seconds:
            stream.codec_context.time_base = Fraction(1, TICKS_PER_SECOND)

        def write(pixels: Pixels) -> None:
            even = np.ascontiguousarray(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])
            # The size is known with the first frame, and may not change once the encoder is open.
            if not stream.codec_context.is_open:
                stream.height, stream.width = even.shape[:2]
            frame = av.VideoFrame.from_ndarray(even, format="bgr24")
            if seconds:
                frame.pts, frame.time_base = int(seconds() * TICKS_PER_SECOND + 0.5), Fraction(1, TICKS_PER_SECOND)
            container.mux(stream.encode(frame))

        yield write
        # The encoder holds frames back to reorder them. Encoding nothing returns the last ones.
        container.mux(stream.encode())
