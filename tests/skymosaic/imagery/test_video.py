import http.server
import re
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.stream import Disposition

from golden_model.arrays import Pixels
from skymosaic.common.errors import InputError
from skymosaic.imagery.video import VideoReader, write_video
from tests.made import limited_files

RATE = Fraction(30000, 1001)


@pytest.fixture(scope="module")
def texture() -> np.ndarray:
    grain = np.random.default_rng(0).integers(0, 256, (300, 500, 3), dtype=np.uint8)
    return cv2.GaussianBlur(grain, (0, 0), 3)


@pytest.fixture(scope="module")
def frames(texture: Pixels) -> list[np.ndarray]:
    return [np.ascontiguousarray(texture[i : i + 240, 2 * i : 2 * i + 320]) for i in range(30)]


def encode(path: Path, frames: list[np.ndarray], rotation: int = 0, shape: str = "1", **options: str) -> Path:
    """Write a video of pixels of a shape without the module under test."""
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=25)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(shape)
        if rotation:
            stream.set_display_rotation(rotation)
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="bgr24")))
        container.mux(stream.encode())
    return path


def _write(path: Path, frames: Iterable[np.ndarray]) -> None:
    with write_video(path, RATE) as write:
        for frame in frames:
            write(frame)


def difference(frame: np.ndarray, other: np.ndarray) -> float:
    """Mean absolute difference of the gray levels: colour is stored at half size."""
    return float(np.abs(frame.mean(axis=2) - other.mean(axis=2)).mean())


def test_what_is_written_is_read_again(tmp_path: Path, frames: list[Pixels]) -> None:
    odd = [frame[:239, :319] for frame in frames]
    _write(tmp_path / "v.mp4", odd)
    reader = VideoReader(tmp_path / "v.mp4")
    read = list(reader)
    assert [path.name for path in tmp_path.iterdir()] == ["v.mp4"]
    assert reader.frame_rate == RATE
    assert len(read) == len(frames)
    assert reader.notes == []
    for frame, original in zip(read, odd, strict=True):
        assert frame.shape == (238, 318, 3)
        assert frame.dtype == np.uint8
        # The encoder's loss; the next frame differs by more than twice that.
        assert difference(frame, original[:238, :318]) < 3
    with av.open(str(tmp_path / "v.mp4")) as container:
        assert container.streams.video[0].codec_context.name == "h264"


@pytest.mark.parametrize(("rotation", "quarter_turns"), [(90, 1), (-90, 3), (180, 2)])
def test_frames_are_upright(tmp_path: Path, frames: list[Pixels], rotation: int, quarter_turns: int) -> None:
    reader = VideoReader(encode(tmp_path / "v.mp4", frames[:3], rotation))
    upright = [np.rot90(frame, quarter_turns) for frame in frames[:3]]
    assert all(difference(*pair) < 3 for pair in zip(reader, upright, strict=True))
    assert reader.notes == ["turned upright by its rotation tag"]


@pytest.mark.parametrize(("name", "cover"), [("v.mp4", False), ("v.mkv", False), ("v.mp4", True)])
def test_the_largest_track_that_is_no_cover_is_read(
    tmp_path: Path, frames: list[Pixels], name: str, *, cover: bool
) -> None:
    other = cv2.resize(frames[0], (640, 480) if cover else (160, 120))
    with av.open(str(tmp_path / name), "w") as container:
        # Only a cover may be larger than the film.
        first = container.add_stream("mjpeg" if cover else "libx264", rate=25)
        (first.height, first.width), first.pix_fmt = other.shape[:2], "yuvj420p" if cover else "yuv420p"
        first.disposition = Disposition.attached_pic if cover else Disposition.default
        second = container.add_stream("libx264", rate=25)
        (second.height, second.width), second.pix_fmt = frames[0].shape[:2], "yuv420p"
        for number, frame in enumerate(frames):
            if not (cover and number):
                container.mux(first.encode(av.VideoFrame.from_ndarray(other, format="bgr24")))
            container.mux(second.encode(av.VideoFrame.from_ndarray(frame, format="bgr24")))
        for stream in (first, second):
            container.mux(stream.encode())
    reader = VideoReader(tmp_path / name)
    assert [difference(*pair) < 3 for pair in zip(reader, frames, strict=True)] == [True] * 30
    other_track = "640x480 (a cover)" if cover else "160x120"
    assert reader.notes == [f"of its tracks that of 320x240 is read, not {other_track}"]


@pytest.mark.parametrize("mirrored", [(-1, 0, 0, 1), (1, 0, 0, -1), (0, 1, 1, 0), (0, -1, -1, 0)])
def test_mirrored_frames_are_mirrored_back(tmp_path: Path, frames: list[Pixels], mirrored: tuple[int, ...]) -> None:
    path = encode(tmp_path / "v.mp4", frames[:3])
    data = bytearray(path.read_bytes())
    # The matrix in the track's header, rows of three.
    start = data.index(b"tkhd") + 44
    for place, value in zip((0, 4, 12, 16), mirrored, strict=True):
        data[start + place : start + place + 4] = (value << 16).to_bytes(4, "big", signed=True)
    path.write_bytes(data)
    a, b, c, d = mirrored
    reader = VideoReader(path)
    for shown, stored in zip(reader, frames, strict=False):
        expected = stored[::d, ::a] if a else stored.swapaxes(0, 1)[::b, ::c]
        assert difference(shown, expected) < 3
    assert reader.notes == ["mirrored as its display matrix says"]


@pytest.mark.parametrize("name", ["v.mp4", "v.avi", "v.mkv"])
def test_a_recording_cut_off_is_used_up_to_its_last_whole_frame(
    tmp_path: Path, frames: list[Pixels], name: str
) -> None:
    path = encode(tmp_path / name, frames, movflags="faststart")
    cut(path, 0.95)
    reader = VideoReader(path)
    read = list(reader)
    assert 10 < len(read) < len(frames)
    # A frame that was not whole would be patched up from its neighbours.
    assert all(min(difference(frame, original) for original in frames) < 2.5 for frame in read[-3:])
    if name != "v.mkv":  # Matroska does not say how many frames there should be.
        assert reader.notes == [f"{len(read)} of 30 frames can be decoded; the others are left out"]


@pytest.mark.parametrize(
    ("name", "kept", "note"),
    [
        ("v.mkv", 0.4, r"the last frame ends at \d\.\d of 2\.4 s; the others are missing"),
        ("v.ts", 1, r"damaged packets or frames that are left out: \d+"),
    ],
)
def test_what_is_missing_of_a_file_without_a_count_is_told(
    tmp_path: Path, frames: list[Pixels], name: str, kept: float, note: str
) -> None:
    path = encode(tmp_path / name, [*frames, *frames])
    assert len(list(reader := VideoReader(path))) == 60
    assert reader.notes == []
    data = path.read_bytes()
    middle = len(data) // 3
    damaged = data[:middle] + bytes(1000) + data[middle + 1000 :]
    path.write_bytes((data if kept < 1 else damaged)[: int(kept * len(data))])
    reader = VideoReader(path)
    read = list(reader)
    assert 10 < len(read) < 60
    assert all(min(difference(frame, original) for original in frames) < 2.5 for frame in read[-3:])
    assert re.fullmatch(note, "; ".join(reader.notes)), reader.notes


def test_frames_are_shown_as_long_as_they_were(tmp_path: Path, frames: list[Pixels]) -> None:
    milliseconds = [100, 133, 500, 500, 900, 400_000_000]
    with av.open(str(tmp_path / "v.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.height, stream.width, stream.pix_fmt = 240, 320, "bgr0"
        stream.codec_context.time_base = Fraction(1, 1000)
        for pixels, time in zip(frames, milliseconds, strict=False):
            frame = av.VideoFrame.from_ndarray(pixels, format="bgr24")
            frame.pts, frame.time_base = time, Fraction(1, 1000)
            container.mux(stream.encode(frame))
    reader = VideoReader(tmp_path / "v.mkv")
    seconds = []
    with write_video(tmp_path / "copy.mp4", reader.frame_rate, lambda: reader.seconds) as write:
        for read in reader:
            seconds.append(reader.seconds)
            write(read)
    assert seconds == pytest.approx([0, 0.033, 0.4, 0.4, 0.8, 0.8 + 1 / 30], abs=1e-4)
    with av.open(str(tmp_path / "copy.mp4")) as container:
        assert [frame.time for frame in container.decode(video=0)] == pytest.approx(seconds, abs=1e-4)
    assert float(VideoReader(tmp_path / "copy.mp4").frame_rate) == pytest.approx(6 / (0.8 + 1 / 30), rel=1e-3)


def write_sound(path: Path) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=8000, layout="mono")
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        silence.rate = 8000
        container.mux(stream.encode(silence))
        container.mux(stream.encode())


BAD: dict[str, Callable[[Path, list[np.ndarray]], object]] = {
    "no such file": lambda path, _: None,
    "empty": lambda path, _: path.touch(),
    "not a file": lambda path, _: path.mkdir(),
    "not a readable video": lambda path, _: path.write_text("words, not frames\n" * 100),
    "cut off before its index": lambda path, frames: cut(encode(path, frames), 0.5),
    "without frames|no frame of the video can be decoded": lambda path, frames: cut(
        encode(path, frames, movflags="faststart"), b"mdat"
    ),
    "without frames": lambda path, _: write_sound(path),
}
"""What is said of what is made."""


def cut(path: Path, end: float | bytes) -> None:
    """Keep a share of a file, or 200 bytes behind a mark."""
    data = path.read_bytes()
    path.write_bytes(data[: data.index(end) + 200 if isinstance(end, bytes) else int(end * len(data))])


@pytest.mark.parametrize("says", BAD)
def test_a_bad_video_gets_one_line_that_names_it(tmp_path: Path, frames: list[Pixels], says: str) -> None:
    path = tmp_path / "v.mp4"
    BAD[says](path, frames)
    with pytest.raises(InputError, match=says) as caught:
        list(VideoReader(path))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_nothing_is_left_of_a_video_that_could_not_be_finished(tmp_path: Path, frames: list[Pixels]) -> None:
    def interrupted() -> Iterator[np.ndarray]:
        yield frames[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _write(tmp_path / "v.mp4", interrupted())
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_and_nothing_is_left(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (40, 240, 320, 3), dtype=np.uint8)
    with limited_files(30_000), pytest.raises(InputError, match=r"v\.mp4: cannot be written"):
        _write(tmp_path / "v.mp4", noise)
    assert list(tmp_path.iterdir()) == []


class Refusing(http.server.BaseHTTPRequestHandler):
    """A camera that asks for a password at /private, and has nothing else."""

    def do_GET(self) -> None:
        self.send_error(401 if self.path == "/private" else 404)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def camera() -> Iterator[str]:
    """Address of a server, without its scheme."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Refusing) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_stream_that_cannot_be_opened_says_why(camera: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skymosaic.imagery.video.OPEN_SECONDS", 0.2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
        unused.bind(("127.0.0.1", 0))
        silent = f"udp://127.0.0.1:{unused.getsockname()[1]}"
    faults = {
        "rtsp://127.0.0.1:9/camera": "nothing answers there; check host and port",
        f"http://{camera}/private": "it asks for a name and a password",
        f"http://{camera}/camera": "the host has no such stream",
        "telepathy://camera": "unknown kind of address; valid: rtsp, rtp, udp",
        silent: "nothing came for 10 seconds; check that the camera sends",
        "rtsp://camera.invalid/": "Input/output error; check the address and the network",
    }
    for address, fault in faults.items():
        with pytest.raises(InputError) as refused:
            VideoReader(address)
        assert str(refused.value).startswith(f"{address}: the stream cannot be opened: {fault}")


@pytest.mark.parametrize(
    ("shape", "size"), [("64/45", (455, 240)), ("1/2", (320, 480)), ("1", (320, 240)), ("5", (320, 240))]
)
@pytest.mark.parametrize("rotation", [0, 90])
def test_pixels_that_are_not_square_become_square(
    tmp_path: Path, frames: list[np.ndarray], shape: str, size: tuple[int, int], rotation: int
) -> None:
    reader = VideoReader(encode(tmp_path / "v.mp4", frames[:3], rotation, shape))
    read = list(reader)
    assert {frame.shape[1::-1] for frame in read} == {size if rotation == 0 else size[::-1]}
    assert [note for note in reader.notes if "square" in note] == (
        [] if size == (320, 240) else [f"pixels of {shape} made square: {size[0]}x{size[1]}"]
    )
