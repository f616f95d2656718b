import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from skymosaic.panel import uploads
from skymosaic.panel.uploads import PHOTOGRAPH, VIDEO, sanitise_stem
from tests.made import leave_free


def test_kinds_are_recognised_by_their_first_bytes() -> None:
    assert VIDEO.suffix_of(b"\0\0\0\x20ftypisom") == ".mp4"
    assert VIDEO.suffix_of(b"RIFF....AVI LIST") == ".avi"
    assert VIDEO.suffix_of(b"#EXTM3U\n#EXT-X-TA") is None
    assert VIDEO.suffix_of(b"ffconcat version 1") is None
    assert PHOTOGRAPH.suffix_of(b"RIFF....WEBPVP8 ") == ".webp"
    assert PHOTOGRAPH.suffix_of(b"RIFF....AVI LIST") is None
    assert PHOTOGRAPH.suffix_of(b"MM\0*\0\0\0\x08") == ".tif"
    assert VIDEO.suffix_of(b"\x1a\x45\xdf\xa3\x93\x42") == ".mkv"
    for suffix in (".png", ".jpg", ".tif", ".webp", ".bmp"):
        encoded = cv2.imencode(suffix, np.full((8, 8, 3), 90, np.uint8))[1].tobytes()
        assert PHOTOGRAPH.suffix_of(encoded[:16]) == suffix
        assert VIDEO.suffix_of(encoded[:16]) is None


def test_stems_have_harmless_characters_only() -> None:
    assert sanitise_stem("DJI 0012 (copy).JPG") == "DJI_0012_copy"
    assert sanitise_stem("U\u0308berflug Süd (2).jpg") == "Überflug_Süd_2"
    assert sanitise_stem("飞行_1\u202egpj.png") == "飞行_1_gpj"
    assert sanitise_stem("../../etc/passwd") == "passwd"
    assert sanitise_stem("-rf.png") == "rf"
    assert sanitise_stem("") == "file"
    assert len(sanitise_stem("x" * 500)) == 40


def test_an_upload_without_progress_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "STALLED_SECONDS", 0.1)

    sent: list[bytes] = []

    async def stalled() -> AsyncIterator[bytes]:
        # A byte now and then is no progress.
        while len(sent) < 1000:
            sent.append(b"\xff\xd8\xff")
            yield sent[-1]
            await asyncio.sleep(0.05)

    async def scenario() -> None:
        with pytest.raises(uploads.UploadRefusedError, match=r"field\.jpg: hardly anything arrived for 0") as caught:
            await uploads.receive(stalled(), "field.jpg", PHOTOGRAPH, tmp_path / "1.part", room_bytes=1000)
        assert caught.value.status == 408

    asyncio.run(scenario())
    assert len(sent) < 1000
    assert not list(tmp_path.iterdir())


HEADS = {"photograph": b"\x89PNG\r\n\x1a\n" + bytes(12), "video": b"RIFF....AVI LIST"}
HEADS["template"] = HEADS["photograph"]


async def singly(data: bytes) -> AsyncIterator[bytes]:
    for number in range(len(data)):
        yield data[number : number + 1]


@pytest.mark.parametrize(
    ("slot", "left", "status"),
    [
        ("photograph", ((1 << 30) + (64 << 20), 4 << 30), 0),
        ("template", ((1 << 30) + (64 << 20) - 1, 4 << 30), 507),
        ("video", ((1 << 30) + (512 << 20), 4 << 30), 0),
        ("video", ((1 << 30) + (512 << 20) - 1, 4 << 30), 507),
        # Of a session that has hardly any room left, so much must fit on the disk.
        ("photograph", ((1 << 30) + 20, 20), 0),
        ("photograph", ((1 << 30) + 19, 20), 507),
        ("photograph", (1 << 40, 19), 413),
        ("photograph", (1 << 40, -5), 413),
    ],
)
def test_an_upload_is_refused_where_it_does_not_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, slot: str, left: tuple[int, int], status: int
) -> None:
    """On the disk, or into the 4 GiB of a session; its kind is known when its first bytes have come one by one."""
    free_bytes, room_bytes = left
    leave_free(monkeypatch, free_bytes)
    given = singly(HEADS[slot]), "field.dat", uploads.KINDS[slot], tmp_path / "1.part"
    if status:
        with pytest.raises(uploads.UploadRefusedError) as refused:
            asyncio.run(uploads.receive(*given, room_bytes=room_bytes))
        assert refused.value.status == status
        assert not list(tmp_path.iterdir())
    else:
        path = asyncio.run(uploads.receive(*given, room_bytes=room_bytes))
        assert (path.stem, path.read_bytes()) == ("field", HEADS[slot])
