"""Finished runs outlive the panel, whole or not at all, and nothing else is read or removed by their names."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from sim.scene import make_pair
from skymosaic.panel.folders import Roots
from skymosaic.panel.runs import MANIFEST, Runs, open_runs
from skymosaic.panel.session import Session
from tests.skymosaic.panel.visitor import Scenario, body, idle


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of runs with one run, which has a file in a folder, and a secret beside it."""
    kept, run = tmp_path / "kept", tmp_path / "run"
    kept.mkdir()
    (run / "report").mkdir(parents=True)
    (run / "report" / "index.html").write_text("a page")
    (tmp_path / "secret").write_text("secret")
    Runs(kept, tmp_path).keep(run, "3 photographs")
    return kept


@pytest.mark.usefixtures("workers")
def test_finished_runs_outlive_the_panel_and_nothing_else_does(
    tmp_path: Path, run_in_loop: Callable[[Scenario], None]
) -> None:
    images = make_pair(seed=9, size=(240, 180)).images

    async def scenario() -> None:
        with open_runs(tmp_path) as runs:
            session = Session(runs, Roots([tmp_path]))
            for number, image in enumerate(images):
                data = cv2.imencode(".png", image)[1].tobytes()
                await session.inputs.upload("photograph", body(data), f"{number}.png")
            session.make_mosaic()
            await idle(session)
            assert session.fault == ""
            assert {path.name for path in session.mosaic_result.folder.iterdir()} >= {"mosaic.png", "matches.csv"}

    run_in_loop(scenario)
    with open_runs(tmp_path) as again:
        ((run, title, _finished),) = again
        assert title.startswith("2 photographs: ")
        assert (run / "mosaic.png").exists()
        again.delete(run.name)
        again.delete(run.name)
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_panel_leaves_is_no_run(folder: Path, tmp_path: Path) -> None:
    (folder / "20250101-000000").mkdir()
    for number, text in enumerate(("", "{", "[]", '{"title": 1}')):
        (folder / f"2025-{number}").mkdir()
        (folder / f"2025-{number}" / MANIFEST).write_text(text)
    assert [title for _, title, _ in Runs(folder, tmp_path)] == ["3 photographs"]


@pytest.mark.parametrize(
    ("name", "path"),
    [("", "secret"), (".", "secret"), ("..", "secret"), ("{run}", "../../secret"), ("{run}", "link"), ("{run}", ""),
     ("{run}", "report"), ("{run}", "/etc/passwd"), ("link", "secret"), ("{run}/report", "index.html"), ("{run}", "\0"),
     ("absent", MANIFEST)],
)  # fmt: skip
def test_no_name_reads_another_file(folder: Path, tmp_path: Path, name: str, path: str) -> None:
    runs = Runs(folder, tmp_path)
    ((run, _, _),) = runs
    (run / "link").symlink_to(tmp_path / "secret")
    (folder / "link").symlink_to(tmp_path)
    assert runs.find_file(run.name, "report/index.html").read_text() == "a page"
    assert runs.find_file(name.format(run=run.name), path) is None


@pytest.mark.parametrize("name", ["", ".", "..", "link", "../outside", "/"])
def test_no_name_deletes_another_folder(folder: Path, tmp_path: Path, name: str) -> None:
    shutil.copytree(next(iter(folder.iterdir())), tmp_path / "outside")
    (folder / "link").symlink_to(tmp_path / "outside")
    Runs(folder, tmp_path).delete(name)
    assert (tmp_path / "outside" / MANIFEST).exists()
    assert len(list(folder.iterdir())) == 2
