"""A session runs one job at a time, has limits, and keeps no file that is not shown."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import pytest

from sim.scene import make_pair
from skymosaic.panel.session import Session
from tests.skymosaic.panel.visitor import Scenario, body, idle, noise_png

pytestmark = pytest.mark.usefixtures("workers")


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
            await session.inputs.upload("template", body(noise_png(seed)), "car.png")
        await session.inputs.upload("photograph", body(noise_png(3)), "field.png")
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


def test_a_run_that_cannot_be_kept_is_shown(
    session: Session, run_in_loop: Callable[[Scenario], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    def keep(_folder: Path, _title: str) -> Path:
        raise OSError("no space")

    monkeypatch.setattr(session.runs, "keep", keep)

    async def scenario() -> None:
        await load_pair(session)
        session.make_mosaic()
        await idle(session)

    run_in_loop(scenario)
    assert session.fault == "the run is shown, but could not be kept: no space"
    assert (session.mosaic_result.folder / "mosaic.png").exists()


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
