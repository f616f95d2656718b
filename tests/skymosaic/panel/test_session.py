"""A session runs one job at a time, has limits, and keeps no file that is not shown."""

import asyncio
import errno
import zipfile
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import pytest

from sim.scene import make_pair
from skymosaic.panel.results import Decoded, InputFile, MosaicResult
from skymosaic.panel.session import Session
from skymosaic.panel.sessions import Sessions
from skymosaic.panel.tasks import upload_tasks
from skymosaic.panel.tasks.jobs import JobFailedError
from skymosaic.panel.uploads import UploadRefusedError
from tests.skymosaic.panel.visitor import Scenario, body, idle, noise_png

pytestmark = pytest.mark.usefixtures("workers")


def picture(seed: int) -> bytes:
    return noise_png(96, seed)


async def load_pair(session: Session) -> None:
    for number, image in enumerate(make_pair(seed=9, size=(240, 180)).images):
        await session.upload("photograph", body(cv2.imencode(".png", image)[1].tobytes()), f"{number}.png")


def files(session: Session, folder: str) -> set[str]:
    return {path.name for path in session.files.folder(folder).rglob("*") if path.is_file()}


def test_the_files_of_what_is_replaced_are_removed_and_the_archive_has_those_of_the_result(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None]
) -> None:
    session = sessions.get("one")

    async def scenario() -> None:
        for seed in (1, 2):
            await session.upload("template", body(picture(seed)), "car.png")
        await session.upload("photograph", body(picture(3)), "field.png")
        assert files(session, "uploads") == {"car_2.png", "field.png"}
        shown = {session.template.thumbnail.name, session.photographs[0].thumbnail.name}
        assert files(session, "pictures") == shown
        session.set_photographs(())
        await load_pair(session)
        assert files(session, "uploads") == {"car_2.png", "0.png", "1.png"}
        session.make_mosaic()
        await idle(session)
        run = f"pictures/{session.mosaic_result.folder.name}"
        shown = files(session, run)
        session.set_photographs(())
        assert files(session, "uploads") == {"car_2.png"}
        assert files(session, run) == shown, "the mosaic still shows them"
        assert files(session, "pictures/uploads") == {session.template.thumbnail.name}

    run_in_loop(scenario)
    folder = session.mosaic_result.folder
    with zipfile.ZipFile(session.files.write_archive(session.results)) as archive:
        assert archive.testzip() is None
        unpacked = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
    contents = {f"mosaic/{path.relative_to(folder)}": path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert unpacked == contents
    assert "mosaic/report/index.html" in unpacked


def test_the_examples_take_the_places_of_photographs_and_of_the_film(sessions: Sessions) -> None:
    any_session: Any = sessions.get("one")
    started: list[Any] = []
    any_session._start = lambda _title, accept, task, _folder, names, _pictures: started.append((accept, task, names))
    any_session.load_built_in(3)
    any_session.load_built_in_film()
    (show, pair, names), (show_film, film, film_names) = started
    assert (pair, film) == (upload_tasks.render_photographs, upload_tasks.render_pursuit)
    assert [name.partition("_")[2] for name in (*names, *film_names)] == ["built-in.png"] * 3 + ["car.png", "film.mp4"]
    inputs = [InputFile.of_upload(name, Decoded((64, 64), (), Path(name), (64, 64))) for name in "abc"]
    show(inputs)
    show_film({"template": inputs[0], "video": inputs[1]})
    assert any_session.photographs == inputs
    assert [any_session.template, any_session.video] == inputs[:2]


def test_a_full_disk_refuses_an_upload_in_one_line(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = sessions.get("one")

    async def fail(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("anyio.AsyncFile.write", fail)

    async def scenario() -> None:
        with pytest.raises(UploadRefusedError, match="field: cannot be stored") as refused:
            await session.upload("photograph", body(picture(1)), "field.png")
        assert refused.value.status == 507

    run_in_loop(scenario)
    assert files(session, "uploads") == set()


def test_no_second_job_starts_while_one_runs(sessions: Sessions, run_in_loop: Callable[[Scenario], None]) -> None:
    session = sessions.get("one")

    async def scenario() -> None:
        await load_pair(session)
        shown: list[Any] = []
        session.changed.subscribe(lambda: shown.append(session.job))
        session.make_mosaic()
        running, (run,) = session.job, session.files.folder("runs").iterdir()
        # A page says what runs, until it has ended.
        assert shown == [running]
        session.make_mosaic()
        session.load_built_in(9)
        session.load_built_in_film()
        assert session.job is running
        assert list(session.files.folder("runs").iterdir()) == [run]
        await idle(session)
        assert session.fault == ""
        assert session.mosaic_result.folder == run
        assert shown[-1] is None

    run_in_loop(scenario)


def test_other_photographs_end_the_reading_of_a_folder(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None]
) -> None:
    session, ended = sessions.get("one"), list[str]()
    reading: Any = SimpleNamespace(cancel=lambda: ended.append("reading"))

    async def scenario() -> None:
        session.reading, session.unread = reading, "1 of 9 photographs could not be read"
        session.set_photographs(())
        assert (ended, session.reading, session.unread) == (["reading"], None, "")

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
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], before: str, faults: Any, unread: str
) -> None:
    session = sessions.get("one")

    class Reading:
        async def run(self, _queue: object) -> Any:
            if isinstance(faults, Exception):
                raise faults
            return faults

    async def scenario() -> None:
        reading: Any = Reading()
        session.reading, session.unread = reading, before
        other: Any = Reading()
        await session._finish_reading(other, 3)
        assert (session.reading, session.unread) == (reading, before), "another folder is read"
        await session._finish_reading(reading, 3)
        assert (session.reading, session.unread) == (None, unread)

    run_in_loop(scenario)


def test_only_the_first_two_of_a_folder_are_decoded(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    session, decoded = sessions.get("one"), list[str]()

    async def decode(_self: Session, photograph: InputFile) -> None:
        decoded.append(photograph.name)
        photograph.decoded = cast(Decoded, "decoded")

    monkeypatch.setattr(Session, "_decode_in_place", decode)

    async def scenario() -> None:
        session.set_photographs(InputFile(f"/flight/{name}", Path(name)) for name in "abcd")
        await asyncio.sleep(0)
        session.swap_first()
        await asyncio.sleep(0)
        assert [each.name for each in session.photographs] == ["b", "a", "c", "d"]
        session.set_photographs(session.photographs[1:])
        await asyncio.sleep(0)

    run_in_loop(scenario)
    assert decoded == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("paths", "title"),
    [
        (("a.png", "b.png", "c.png"), "3 photographs: a.png, b.png"),
        (("/flight/a.png", "/flight/b.png"), "2 photographs: /flight"),
    ],
)
def test_a_run_is_kept_under_a_title_or_shown_where_it_is(
    sessions: Sessions, paths: tuple[str, ...], title: str
) -> None:
    session, titles, started = sessions.get("one"), list[str](), list[Any]()
    made: Any = MosaicResult(Path("run"), Path("pictures"), "", session.options, {}, None, (), {})  # type: ignore[arg-type]
    any_session: Any = session
    any_session._start = lambda *arguments: started.append(arguments)
    any_session._show_result = lambda result: titles.append(str(result.folder))
    any_session.files.new_run = lambda *_: (Path("run"), Path("pictures"))
    session.photographs = [InputFile(path, Path(path)) for path in paths]

    def keep(folder: Path, kept: str) -> Path:
        titles.append(kept)
        if len(titles) > 2:
            raise OSError("no space")
        return folder / "kept"

    any_session.runs = SimpleNamespace(keep=keep)
    session.make_mosaic()
    for _ in range(2):
        started[0][1](made)
    assert titles == [title, "run/kept", title, "run"]
    assert session.fault == "the run is shown, but could not be kept: no space"


def test_the_next_run_removes_the_files_of_runs_without_a_result(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None]
) -> None:
    session = sessions.get("one")

    async def scenario() -> None:
        await load_pair(session)
        for _ in range(2):
            session.make_mosaic()
            session.cancel()
            await idle(session)
            assert session.fault == "Making the mosaic: cancelled"
        assert len(list(session.files.folder("runs").iterdir())) == 1

    run_in_loop(scenario)


def test_uploads_beyond_the_size_of_a_session_are_refused(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = sessions.get("one")
    monkeypatch.setattr("skymosaic.panel.session.MAX_BYTES", 1)

    async def scenario() -> None:
        refusals = []
        for seed in (1, 2):
            try:
                await session.upload("photograph", body(picture(seed)), "field.png")
            except UploadRefusedError as error:
                refusals.append(error)
        assert refusals
        assert all(error.status == 413 and "larger than the 0 MB" in str(error) for error in refusals)

    run_in_loop(scenario)
    assert len(files(session, "uploads")) == len(session.photographs) <= 1


def test_uploads_leave_room_on_the_disk(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = sessions.get("one")
    monkeypatch.setattr("shutil.disk_usage", lambda _folder: SimpleNamespace(free=1 << 30))

    async def scenario() -> None:
        with pytest.raises(UploadRefusedError, match="disk is almost full") as refused:
            await session.upload("photograph", body(picture(1)), "field.png")
        assert refused.value.status == 507

    run_in_loop(scenario)


def test_a_session_has_a_limited_number_of_uploads_under_way(
    sessions: Sessions, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skymosaic.panel.session.MAX_UPLOADS_AT_ONCE", 1)
    one, two = sessions.get("one"), sessions.get("two")

    async def slow() -> AsyncIterator[bytes]:
        yield b"RIFF"
        await asyncio.sleep(60)

    async def scenario() -> None:
        stalled = asyncio.create_task(one.upload("video", slow(), "film.avi"))
        await asyncio.sleep(0.05)
        with pytest.raises(UploadRefusedError, match="arriving already") as caught:
            await one.upload("video", slow(), "second.avi")
        assert caught.value.status == 429
        await two.upload("photograph", body(noise_png(96, 1)), "field.png")
        assert len(two.photographs) == 1
        while not two._queues.arriving.locked():
            await two._queues.arriving.acquire()
        with pytest.raises(UploadRefusedError, match="from all visitors") as caught:
            await two.upload("photograph", body(noise_png(96, 2)), "field.png")
        assert caught.value.status == 503
        stalled.cancel()
        await asyncio.gather(stalled, return_exceptions=True)

    run_in_loop(scenario)
