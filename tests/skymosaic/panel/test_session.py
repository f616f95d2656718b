"""A session runs one job at a time, has limits, and keeps no file that is not shown."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import pytest

from sim.scene import make_pair
from skymosaic.panel.results import Decoded, InputFile, MosaicResult
from skymosaic.panel.session import Session
from skymosaic.panel.tasks import upload_tasks
from tests.skymosaic.panel.visitor import Scenario, body, idle, noise_png

pytestmark = pytest.mark.usefixtures("workers")


def picture(seed: int) -> bytes:
    return noise_png(96, seed)


async def load_pair(session: Session) -> None:
    for number, image in enumerate(make_pair(seed=9, size=(240, 180)).images):
        await session.inputs.upload("photograph", body(cv2.imencode(".png", image)[1].tobytes()), f"{number}.png")


def files(session: Session, folder: str) -> set[str]:
    return {path.name for path in session.files.folder(folder).rglob("*") if path.is_file()}


def test_the_files_of_what_is_replaced_are_removed_and_the_archive_has_those_of_the_result(
    session: Session, run_in_loop: Callable[[Scenario], None]
) -> None:
    async def scenario() -> None:
        for seed in (1, 2):
            await session.inputs.upload("template", body(picture(seed)), "car.png")
        await session.inputs.upload("photograph", body(picture(3)), "field.png")
        assert files(session, "uploads") == {"car_2.png", "field.png"}
        shown = {session.inputs.template.thumbnail.name, session.inputs.photographs[0].thumbnail.name}
        assert files(session, "pictures") == shown
        session.inputs.set_photographs(())
        await load_pair(session)
        assert files(session, "uploads") == {"car_2.png", "0.png", "1.png"}
        session.make_mosaic()
        await idle(session)
        run = f"pictures/{session.mosaic_result.pictures.name}"
        shown = files(session, run)
        assert "mosaic.jpg" in shown
        session.inputs.set_photographs(())
        assert files(session, "uploads") == {"car_2.png"}
        assert files(session, run) == shown, "the mosaic still shows them"
        assert files(session, "pictures/uploads") == {session.inputs.template.thumbnail.name}

    run_in_loop(scenario)
    folder = session.mosaic_result.folder
    with zipfile.ZipFile(session.files.write_archive(session.results)) as archive:
        assert archive.testzip() is None
        unpacked = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
    contents = {f"mosaic/{path.relative_to(folder)}": path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert unpacked == contents
    assert "mosaic/report/index.html" in unpacked


def test_the_examples_take_the_places_of_photographs_and_of_the_film(session: Session) -> None:
    any_session: Any = session
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
    assert session.inputs.photographs == inputs
    assert [session.inputs.template, session.inputs.video] == inputs[:2]


def test_no_second_job_starts_while_one_runs(session: Session, run_in_loop: Callable[[Scenario], None]) -> None:
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
        assert [folder for folder, _, _ in session.runs] == [session.mosaic_result.folder]
        assert shown[-1] is None

    run_in_loop(scenario)


@pytest.mark.parametrize(
    ("paths", "title"),
    [
        (("a.png", "b.png", "c.png"), "3 photographs: a.png, b.png"),
        (("/flight/a.png", "/flight/b.png"), "2 photographs: /flight"),
    ],
)
def test_a_run_is_kept_under_a_title_or_shown_where_it_is(session: Session, paths: tuple[str, ...], title: str) -> None:
    titles, started = list[str](), list[Any]()
    made: Any = MosaicResult(Path("run"), Path("pictures"), "", session.options, {}, None, (), {})  # type: ignore[arg-type]
    any_session: Any = session
    any_session._start = lambda *arguments: started.append(arguments)
    any_session._show_result = lambda result: titles.append(str(result.folder))
    any_session.files.new_run = lambda *_: (Path("run"), Path("pictures"))
    session.inputs.photographs = [InputFile(path, Path(path)) for path in paths]

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
    session: Session, run_in_loop: Callable[[Scenario], None]
) -> None:
    async def scenario() -> None:
        await load_pair(session)
        for _ in range(2):
            session.make_mosaic()
            session.cancel()
            await idle(session)
            assert (session.note, session.fault) == ("Making the mosaic: cancelled", "")
        assert len(list(session.files.folder("runs").iterdir())) == 1

    run_in_loop(scenario)
