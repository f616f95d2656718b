"""No command replaces what is there unless it is told to."""

from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from sim.scene import make_pair
from skymosaic.cli.commands import app
from skymosaic.common.errors import InputError
from tests.made import write_pictures

COMMANDS = {
    "mosaic": ("mosaic", "left.png", "right.png", "-o", "taken.png"),
    "report": ("mosaic", "left.png", "right.png", "-o", "new.png", "--report", "folder"),
    "camera": ("mosaic", "left.png", "right.png", "left.png", "-o", "new.png", "--save-camera", "taken.toml"),
    "groups": ("mosaic", "left.png", "right.png", "left.png", "-o", "group.png", "--all-groups"),
    "live": ("live", "photographs", "-o", "taken.png"),
    "live preview": ("live", "photographs", "-o", "grown.png"),
    "track": ("track", "left.png", "film.mkv", "-o", "taken.mp4"),
    "corners": ("track", "left.png", "film.mkv", "-o", "new.mp4", "--corners", "taken.csv"),
    "waves": ("compare", "left.png", "right.png", "--waves", "taken.vcd"),
    "demo": ("demo", "-o", "folder", "--backend", "golden"),
    "thesis": ("thesis", "-o", "folder"),
    "fuzzy": ("fuzzy", "ransac", "--plot", "-o", "folder"),
    "export": ("export", "board", "pynq_z2", "-o", "folder"),
}
TAKEN = (
    "taken.png", "taken.mp4", "taken.csv", "taken.vcd", "taken.toml", "grown.preview.jpg", "group_2.png",
    "folder/README.md",
)  # fmt: skip


@pytest.fixture
def full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with two photographs and a file under each name of `TAKEN`."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "photographs").mkdir()
    write_pictures(tmp_path, make_pair(seed=5, size=(320, 240)).images, ("left.png", "right.png"))
    for name in TAKEN:
        (tmp_path / name).write_text("somebody's work")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", COMMANDS)
def test_what_exists_is_kept_and_nothing_else_is_written(full: Path, name: str) -> None:
    before = sorted(full.rglob("*"))
    result = CliRunner().invoke(app, COMMANDS[name])
    assert isinstance(result.exception, InputError)
    assert "add `overwrite`" in str(result.exception)
    assert sorted(full.rglob("*")) == before
    assert {(full / taken).read_text() for taken in TAKEN} == {"somebody's work"}


@pytest.mark.parametrize("name", ["mosaic", "report", "fuzzy"])
def test_overwrite_replaces_it(full: Path, name: str) -> None:
    result = CliRunner().invoke(app, [*COMMANDS[name], "--overwrite"])
    assert result.exception is None
    made = {"mosaic": "taken.png", "report": "folder/mosaic.jpg", "fuzzy": "folder/ransac.png"}[name]
    assert cv2.imread(str(full / made)) is not None
    assert (full / "folder" / "README.md").read_text() == "somebody's work"


def test_outputs_among_the_photographs_are_no_photographs(full: Path) -> None:
    for side in ("left", "right"):
        (full / f"{side}.png").rename(full / "photographs" / f"{side}.png")
    command = ["mosaic", "photographs", "-o", "photographs/m.png", "--report", "photographs", "--overwrite"]
    for _ in range(2):
        result = CliRunner().invoke(app, command)
        assert result.exception is None
        assert "2 photographs of 2" in result.output
    assert len(list((full / "photographs").glob("*.[jp][pn]g"))) == 7


def test_overwritten_tiles_and_reports_have_nothing_of_the_old_ones(full: Path) -> None:
    old = [full / "tiles" / "9" / "1" / "1.webp", full / "tiles" / "index.html", full / "folder" / "mosaic_2.jpg"]
    for path in old:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("old")
    command = ["mosaic", "left.png", "right.png", "-o", "new.png", "--tiles", "tiles", "--report", "folder"]
    result = CliRunner().invoke(app, [*command, "--overwrite"])
    assert result.exception is None
    assert [path.exists() for path in old] == [False, True, False]
    assert len(list((full / "tiles").rglob("*.webp"))) >= 2
    assert (full / "folder" / "README.md").read_text() == "somebody's work"
    assert not list(full.glob(".skymosaic-*-*-*"))
