"""Files of a session: which are removed, found and packed."""

import zipfile
from pathlib import Path

from skymosaic.panel.results import InputFile, Run
from skymosaic.panel.session_files import SessionFiles


def test_uploads_are_removed_with_their_thumbnails_and_others_stay(tmp_path: Path) -> None:
    files = SessionFiles(tmp_path)
    uploads, opened = files.folder("uploads"), tmp_path / "opened"
    opened.mkdir()
    for path in (uploads / "a.jpg", uploads / "b.jpg", tmp_path / "a.png", opened / "c.jpg", tmp_path / "c.png"):
        path.touch()
    a, c = InputFile("a.jpg", tmp_path / "a.png"), InputFile(str(opened / "c.jpg"), tmp_path / "c.png")
    # Its picture could not be made, and of another one the file is gone, too.
    lost, gone = (InputFile(name, tmp_path / "missing.png") for name in ("b.jpg", "gone.jpg"))
    files.remove([a, c, lost, gone])
    left = sorted(path.name for path in tmp_path.rglob("*") if path.is_file())
    assert left == ["c.jpg", "c.png"]


def test_a_run_keeps_its_uploads_and_earlier_runs_go(tmp_path: Path) -> None:
    files = SessionFiles(tmp_path)
    (files.folder("uploads") / "a.jpg").write_text("pixels")
    given = [InputFile("a.jpg", tmp_path / "a.png"), InputFile(str(tmp_path / "c.jpg"), tmp_path / "c.png")]
    first, shown = files.new_run(given, ())
    second, _ = files.new_run(given, [first.name, shown.name])
    assert (first.name, second.name) == ("01", "02")
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["01", "02"]
    files.remove(given)
    assert [path.read_text() for path in second.iterdir()] == ["pixels"]
    archive = files.write_archive({"result": Run(second, shown, "")})
    with zipfile.ZipFile(archive) as packed:
        assert packed.namelist() == ["result/a.jpg"]
    files.new_run(given[1:], ["02"])
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["02", "04"]


def test_only_files_count_and_only_pictures_are_found(tmp_path: Path) -> None:
    files = SessionFiles(tmp_path / "root")
    assert (files.size_bytes, files.find_picture("uploads", "a.png")) == (0, None)
    for folder, name in (("pictures/uploads", "a.png"), ("uploads", "a.jpg")):
        (files.folder(folder) / name).write_bytes(bytes(7))
    assert files.size_bytes == 14
    assert files.find_picture("uploads", "a.png") == tmp_path / "root" / "pictures/uploads/a.png"
    assert files.find_picture("../uploads", "a.jpg") is None
