"""Files that are sent and asked for as a browser does it, hostile ones among them; the panel survives each."""

import asyncio
import errno
import io
import re
import shutil
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import httpx
import numpy as np
import pytest
from starlette.responses import Response

from skymosaic.panel.file_routes import FileRoutes
from skymosaic.panel.results import Run
from skymosaic.panel.session_files import SessionFiles
from tests.skymosaic.panel.visitor import enter, noise_png, upload


class Client:
    """A browser without a screen, of the owner."""

    def __init__(self, http: httpx.Client) -> None:
        self.http, self.get = http, http.get
        self._before: set[str] = set()
        self._before = set(self.pictures())

    def upload(self, name: str, body: bytes | Iterator[bytes], slot: str = "photograph") -> httpx.Response:
        return upload(self.http, name, body, slot)

    def pictures(self) -> list[str]:
        """What the page shows that it did not show at first."""
        return sorted(set(re.findall(r"/picture/[\w.-]+/[\w.-]+", self.get("/").text)) - self._before)


@pytest.fixture
def client(owner_address: str) -> Iterator[Client]:
    with enter(owner_address) as http:
        yield Client(http)
        assert http.get("/").status_code == 200, "the panel no longer answers"


def png(width: int, height: int, data: bytes) -> bytes:
    """A PNG with a header of any size and any compressed data."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize("name", ["field.png", "../../../etc/passwd", "a\0b.png", "<img src=x>.png", ""])
def test_a_photograph_is_shown_and_its_name_cannot_choose_a_path(client: Client, name: str) -> None:
    assert client.upload(name, noise_png()).status_code == 204
    (shown,) = client.pictures()
    assert client.get(shown).content.startswith(b"\x89PNG")
    assert re.fullmatch(r"/picture/uploads/[0-9a-f]{32}\.png", shown)


def film(width: int, height: int) -> bytes:
    """A video of one flat frame."""
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = width, height, "gray"
        frame = av.VideoFrame.from_ndarray(np.zeros((height, width), np.uint8), format="gray")
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return file.getvalue()


def test_a_video_is_accepted_and_its_first_frame_shown(client: Client) -> None:
    assert client.upload("flight.mkv", film(320, 240), "video").status_code == 204
    assert client.upload("car.png", noise_png(), "template").status_code == 204
    shown = sorted(set(re.findall(r"/picture/[\w.-]+/[\w.-]+", client.get("/tracking").text)))
    assert len(shown) == 2
    assert all(client.get(each).content.startswith(b"\x89PNG") for each in shown)
    assert client.get("/picture/uploads/flight.mkv").status_code == 404


@pytest.mark.parametrize(
    ("slot", "body", "status", "message"),
    [
        ("photograph", b"words, not pixels\n", 415, "is not a photograph"),
        ("photograph", b"", 415, "is empty"),
        ("photograph", b"#EXTM3U\n#EXT-X-MEDIA-SEQUENCE:0\nfile:///etc/passwd\n", 415, "is not a photograph"),
        ("photograph", noise_png()[:900], 422, "truncated"),
        ("photograph", b"\xff\xd8\xff" + bytes(range(256)), 422, "not an image"),
        ("photograph", noise_png(side_px=16), 422, "16x16"),
        ("photograph", png(60_000, 60_000, zlib.compress(bytes(1 << 22))), 422, "larger than 105 megapixels"),
        ("photograph", png(640, 480, zlib.compress(b"short")), 422, ""),
        ("video", noise_png(), 415, "is not a video"),
        ("video", b"#EXTM3U\nfile:///etc/passwd\n", 415, "is not a video"),
        ("video", film(320, 240)[:300], 422, "not a readable video"),
        ("video", film(6000, 4500), 422, "frames of 6000x4500 pixels are too large"),
        ("template", film(320, 240), 415, "is not a photograph"),
        ("uploads", noise_png(), 422, ""),
        ("..%2fviews", noise_png(), 404, ""),
    ],
    ids=[
        *("text", "nothing", "play list", "truncated", "noise", "small", "bomb", "header that lies"),
        *("no video", "play list of films", "cut off", "large frames", "film", "other slot", "way out"),
    ],
)
def test_what_is_no_picture_and_no_film_is_refused_with_a_reason(
    client: Client, slot: str, body: bytes, status: int, message: str
) -> None:
    refused = client.upload("what it is.png", body, slot)
    assert refused.status_code == status, refused.text
    assert message in refused.text
    assert "/tmp" not in refused.text
    if slot == "photograph":
        assert re.search(r"\.(png|jpg)\b", refused.text)
        assert "\n" not in refused.text
        assert client.pictures() == []


@pytest.mark.parametrize(
    ("slot", "head"),
    [("photograph", b"\x89PNG\r\n\x1a\n"), ("video", b"\0\0\0\x20ftypisom")],
    ids=["photograph", "video"],
)
def test_an_oversized_upload_is_stopped(client: Client, slot: str, head: bytes) -> None:
    def endless() -> Iterator[bytes]:
        yield head
        while True:
            yield bytes(1 << 20)

    try:
        refused = client.upload("large", endless(), slot)
    except httpx.WriteError:
        return  # the server closed the connection before the client listened
    assert refused.status_code == 413


def test_no_path_reads_another_file(client: Client) -> None:
    assert client.upload("mine.png", noise_png()).status_code == 204
    for path in (
        "/picture/..%2f..%2fetc%2fpasswd", "/picture/%2fetc%2fpasswd", "/picture/../archive", "/picture/mine.png",
        "/picture/%2e%2e/uploads%2fmine.png", "/picture/uploads/%2e%2e", "/picture/uploads/mine.png",
        "/picture/uploads/..%2f..%2fuploads%2fmine.png", "/picture/.",
        "/_nicegui/../../etc/passwd", "/uploads/mine.png", "/upload/photograph",
    ):  # fmt: skip
        assert client.get(path).status_code in (404, 405), path


def test_files_and_pages_of_a_result_are_sent_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "run" / "tiles" / "3").mkdir(parents=True)
    for name in ("mosaic.tif", "tiles/index.html", "tiles/3/1.webp", "../secret"):
        (tmp_path / "run" / name).write_text(name)
    (tmp_path / "run" / "link").symlink_to(tmp_path / "secret")
    session = SimpleNamespace(results={"mosaic": SimpleNamespace(folder=tmp_path / "run")})
    routes: Any = FileRoutes(session)  # type: ignore[arg-type]

    def get(path: str, kind: str = "mosaic") -> Response:
        answer: Response = asyncio.run(routes.file(kind, path))
        return answer

    assert "attachment" in get("mosaic.tif").headers["content-disposition"]
    page, tile = get("tiles/index.html"), get("tiles/3/1.webp")
    assert page.status_code == tile.status_code == 200
    assert "content-disposition" not in page.headers
    assert page.media_type == "text/html"
    for path in ("../secret", "link", "tiles", "absent", "/etc/passwd", "\0"):
        assert get(path).status_code == 404
    assert get("mosaic.tif", "tracking").status_code == 404


def test_a_full_disk_or_a_deleted_run_costs_the_archive_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(zipfile.ZipFile, "write", fail)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mosaic.png").touch()
    session = SimpleNamespace(results={"mosaic": Run(tmp_path / "run", tmp_path, "")}, files=SessionFiles(tmp_path))
    routes: Any = FileRoutes(session)  # type: ignore[arg-type]
    answer: Response = asyncio.run(routes.archive())
    assert (answer.status_code, b"No space left" in answer.body) == (507, True)
    assert not list((tmp_path / "archives").iterdir())
    shutil.rmtree(tmp_path / "run")
    answer = asyncio.run(routes.archive())
    assert (answer.status_code, b"the run was deleted" in answer.body) == (404, True)
