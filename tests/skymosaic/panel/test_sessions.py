"""A session runs one job at a time, has limits, and keeps no file that is not shown."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path

import cv2
import nicegui.core
import numpy as np
import pytest

from skymosaic.panel import session as session_module
from skymosaic.panel.session import Session
from skymosaic.panel.sessions import Sessions
from skymosaic.panel.uploads import intake, storage
from skymosaic.panel.uploads.received import UploadRefusedError

Scenario = Callable[[], Awaitable[None]]

pytestmark = pytest.mark.usefixtures("workers")


@pytest.fixture
def sessions() -> Iterator[Sessions]:
    created = Sessions()
    yield created
    created.close()


@pytest.fixture
def run_in_loop(monkeypatch: pytest.MonkeyPatch) -> Callable[[Scenario], None]:
    """Runs a coroutine in the event loop that NiceGUI gives its background tasks to."""

    def run(scenario: Scenario) -> None:
        async def with_limit() -> None:
            monkeypatch.setattr(nicegui.core, "loop", asyncio.get_running_loop())
            await scenario()

        asyncio.run(with_limit())

    return run


async def body(data: bytes) -> AsyncIterator[bytes]:
    yield data


def picture(seed: int) -> bytes:
    noise = np.random.default_rng(seed).integers(0, 256, (96, 96), np.uint8)
    return cv2.imencode(".png", noise)[1].tobytes()


async def idle(session: Session) -> None:
    while session.job is not None:
        await asyncio.sleep(0.02)


def files(session: Session, folder: str) -> set[str]:
    return {path.name for path in session._folder(folder).rglob("*") if path.is_file()}


def test_the_files_of_replaced_uploads_are_removed(sessions: Sessions, run_in_loop: Callable[[Scenario], None]) -> None:
    session = sessions.get("one")

    async def scenario() -> None:
        for seed in (1, 2):
            await session.upload("template", body(picture(seed)), "car.png")
        await session.upload("photograph", body(picture(3)), "field.png")
        assert files(session, "uploads") == {"car_2.png", "field.png"}
        assert files(session, "views") == {"car_2.png.png", "field.png.png"}
        session.load_built_in(2)
        await idle(session)
        first = {"car_2.png", *(upload.name for upload in session.photographs)}
        assert len(first) == 3
        assert files(session, "uploads") == first
        session.make_mosaic()
        await idle(session)
        views = files(session, "views")
        session.keep_photographs(())
        assert files(session, "uploads") == {"car_2.png"}
        assert files(session, "views") == views, "the mosaic still shows them"

    run_in_loop(scenario)


def test_no_second_job_starts_while_one_runs(sessions: Sessions, run_in_loop: Callable[[Scenario], None]) -> None:
    session = sessions.get("one")

    async def scenario() -> None:
        session.load_built_in(2)
        await idle(session)
        session.make_mosaic()
        running, (run,) = session.job, session._folder("runs").iterdir()
        session.make_mosaic()
        session.load_built_in(9)
        session.load_built_in_film()
        assert session.job is running
        assert list(session._folder("runs").iterdir()) == [run]
        await idle(session)
        assert session.fault == ""
        assert session.mosaic_result.folder == run

    run_in_loop(scenario)


def test_the_next_run_removes_the_files_of_runs_without_a_result(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None]
) -> None:
    session = sessions.get("one")

    async def scenario() -> None:
        session.load_built_in(2)
        await idle(session)
        for _ in range(3):
            session.make_mosaic()
            session.cancel()
            await idle(session)
            assert session.fault == "Making the mosaic: cancelled"
        assert len(list(session._folder("runs").iterdir())) == 1

    run_in_loop(scenario)


@pytest.mark.parametrize(("limit", "says"), [("MOST_BYTES", "larger than the 0 MB"), ("MOST_PHOTOGRAPHS", "no more")])
def test_uploads_beyond_a_limit_are_refused(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch, limit: str, says: str
) -> None:
    session = sessions.get("one")
    monkeypatch.setattr(session_module, limit, 1)

    async def scenario() -> None:
        refusals = []
        for seed in (1, 2):
            try:
                await session.upload("photograph", body(picture(seed)), "field.png")
            except UploadRefusedError as error:
                refusals.append(error)
        assert refusals
        assert all(error.status == 413 and says in str(error) for error in refusals)

    run_in_loop(scenario)
    assert len(files(session, "uploads")) == len(session.photographs) <= 1


def test_the_oldest_idle_session_makes_room(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(storage, "MOST_SESSIONS", 2)
    monkeypatch.setattr(storage, "IDLE_SECONDS", 0)
    three = [sessions.get(number) for number in ("one", "two", "three")]

    async def scenario() -> None:
        for seed, session in enumerate(three[:2]):
            await session.upload("photograph", body(picture(seed)), "field.png")
        three[0].load_built_in(2)
        seen = []
        three[1].changed.subscribe(lambda: seen.append(list(three[1].photographs)))
        await three[2].upload("photograph", body(picture(3)), "field.png")
        assert [len(session.photographs) for session in three] == [1, 0, 1], "the first one's job was running"
        assert seen == [[]]
        await idle(three[0])
        assert len(three[0].photographs) == 2

    run_in_loop(scenario)


def test_an_active_session_keeps_its_files(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(storage, "MOST_BYTES", 1)
    one, two = sessions.get("one"), sessions.get("two")

    async def scenario() -> None:
        await one.upload("photograph", body(picture(1)), "field.png")
        with pytest.raises(UploadRefusedError, match="no space") as refused:
            await two.upload("photograph", body(picture(2)), "field.png")
        assert refused.value.status == 503
        assert len(one.photographs) == 1
        one.last_active -= 2 * storage.IDLE_SECONDS
        await two.upload("photograph", body(picture(2)), "field.png")
        assert (one.photographs, len(two.photographs)) == ([], 1)

    run_in_loop(scenario)


def test_the_limit_of_photographs_holds_for_uploads_at_once(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_module, "MOST_PHOTOGRAPHS", 3)
    session = sessions.get("one")

    async def scenario() -> None:
        uploads = (session.upload("photograph", body(picture(seed)), "field.png") for seed in range(8))
        results = await asyncio.gather(*uploads, return_exceptions=True)
        assert [result for result in results if result is None] == [None] * 3
        assert len(session.photographs) == 3
        assert len(files(session, "uploads")) == 3
        monkeypatch.setattr(intake, "MOST_UPLOADS", 0)
        with pytest.raises(UploadRefusedError, match="too many files"):
            await session.upload("template", body(picture(9)), "car.png")
        assert not session.is_busy

    run_in_loop(scenario)


def test_a_visitor_who_goes_ends_the_worker(sessions: Sessions, run_in_loop: Callable[[Scenario], None]) -> None:
    session = sessions.get("one")

    async def gone() -> bool:
        return True

    async def scenario() -> None:
        with pytest.raises(UploadRefusedError, match="cancelled"):
            await session.upload("photograph", body(picture(1)), "field.png", gone)
        assert files(session, "uploads") == set()

    run_in_loop(scenario)


def test_an_identifier_is_one_session(sessions: Sessions) -> None:
    one = sessions.get("one")
    assert sessions.get("one") is one
    assert sessions.get("two") is not one


def test_closing_removes_every_file(
    run_in_loop: Callable[[Scenario], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    sessions = Sessions()
    session = sessions.get("one")

    async def scenario() -> None:
        await session.upload("photograph", body(picture(1)), "field.png")
        assert any(tmp_path.rglob("*.png"))
        sessions.close()

    run_in_loop(scenario)
    assert not any(tmp_path.rglob("*.png"))
