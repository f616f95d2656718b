"""Uploads and folders: their limits, and what is said of what cannot be read."""

import asyncio
import errno
from collections.abc import AsyncIterator, Callable
from types import SimpleNamespace
from typing import Any

import pytest

from skymosaic.panel.inputs import Inputs
from skymosaic.panel.session import Session
from skymosaic.panel.tasks.jobs import JobFailedError
from skymosaic.panel.uploads import UploadRefusedError
from tests.skymosaic.panel.visitor import Scenario, body, noise_png

pytestmark = pytest.mark.usefixtures("workers")


@pytest.fixture
def inputs(session: Session) -> Inputs:
    return session.inputs


async def refuse(inputs: Inputs, says: str, status: int) -> None:
    with pytest.raises(UploadRefusedError, match=says) as refused:
        await inputs.upload("photograph", body(noise_png(1)), "field.png")
    assert refused.value.status == status


def test_a_file_keeps_its_name(inputs: Inputs, run_in_loop: Callable[[Scenario], None]) -> None:
    """Its letters of any script; with a number where another file has that name, or a run will write it."""

    async def scenario() -> None:
        for name in ("DJI_0018.png", "DJI_0018.png", "mosaic.png", "Überflug Süd (2).png"):
            await inputs.upload("photograph", body(noise_png(1)), name)

    run_in_loop(scenario)
    names = [each.name for each in inputs.photographs]
    assert names == ["DJI_0018.png", "DJI_0018_2.png", "mosaic_2.png", "Überflug_Süd_2.png"]


def test_a_full_disk_refuses_an_upload_in_one_line(
    inputs: Inputs, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("anyio.AsyncFile.write", fail)

    run_in_loop(lambda: refuse(inputs, r"field\.png: cannot be stored", 507))
    assert not any(inputs._files.folder("uploads").iterdir())


def test_other_photographs_end_the_reading_of_a_folder(inputs: Inputs, run_in_loop: Callable[[Scenario], None]) -> None:
    ended = list[str]()
    reading: Any = SimpleNamespace(cancel=lambda: ended.append("reading"))

    async def scenario() -> None:
        inputs.reading, inputs.unread = reading, "1 of 9 photographs could not be read"
        inputs.set_photographs(())
        assert (ended, inputs.reading, inputs.unread) == (["reading"], None, "")

    run_in_loop(scenario)


@pytest.mark.parametrize(
    ("before", "faults", "unread"),
    [
        ("", [], ""),
        ("1 .xyz", [], "1 .xyz"),
        ("1 .xyz", ["a.png: damaged"], "1 .xyz; a.png: damaged"),
        ("", ["a.png: damaged", "b.png: too"], "2 of 3 photographs could not be read; the first: a.png: damaged"),
        ("", JobFailedError("the worker died"), "the worker died"),
    ],
)
def test_what_of_a_folder_cannot_be_read_is_one_line(
    inputs: Inputs, run_in_loop: Callable[[Scenario], None], before: str, faults: Any, unread: str
) -> None:
    class Reading:
        async def run(self, _queue: object) -> Any:
            if isinstance(faults, Exception):
                raise faults
            return faults

    async def scenario() -> None:
        reading: Any = Reading()
        inputs.reading, inputs.unread = reading, before
        other: Any = Reading()
        await inputs._finish_reading(other, 3)
        assert (inputs.reading, inputs.unread) == (reading, before), "another folder is read"
        await inputs._finish_reading(reading, 3)
        assert (inputs.reading, inputs.unread) == (None, unread)

    run_in_loop(scenario)


def test_a_limited_number_of_uploads_is_under_way(
    inputs: Inputs, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skymosaic.panel.inputs.MAX_UPLOADS_AT_ONCE", 1)

    async def slow() -> AsyncIterator[bytes]:
        yield b"RIFF"
        await asyncio.sleep(60)

    async def scenario() -> None:
        stalled = asyncio.create_task(inputs.upload("video", slow(), "film.avi"))
        await asyncio.sleep(0.05)
        with pytest.raises(UploadRefusedError, match="arriving already") as caught:
            await inputs.upload("video", slow(), "second.avi")
        assert caught.value.status == 429
        stalled.cancel()
        await asyncio.gather(stalled, return_exceptions=True)
        await inputs.upload("photograph", body(noise_png(1)), "field.png")
        assert len(inputs.photographs) == 1

    run_in_loop(scenario)
