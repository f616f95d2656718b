from pathlib import Path

import pytest

from skymosaic.common import temporary


@pytest.fixture
def page_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "tiles"
    (folder / "7").mkdir(parents=True)
    for name in ("index.html", "7/old.webp", "notes.txt"):
        (folder / name).write_text("old")
    return folder


def contents(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_a_staged_folder_leaves_nothing_of_its_old_self_and_all_of_others(
    page_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved, rename = list[str](), Path.rename

    def note_and_rename(path: Path, target: Path) -> Path:
        moved.append(path.name)
        return rename(path, target)

    with temporary.staged_folder(page_folder, r"\d+|index\.html") as staged:
        (staged / "6").mkdir()
        for name in ("index.html", "6/new.webp"):
            (staged / name).write_text("new")
        assert contents(page_folder) == ["7/old.webp", "index.html", "notes.txt"]
        monkeypatch.setattr(Path, "rename", note_and_rename)
    # The page, by which readers come in, goes first and comes last.
    assert moved == ["index.html", "7", "6", "index.html"]
    assert contents(page_folder) == ["6/new.webp", "index.html", "notes.txt"]
    assert (page_folder / "notes.txt").read_text() == "old"
    assert (page_folder / "index.html").read_text() == "new"
    assert [path.name for path in page_folder.parent.iterdir()] == ["tiles"]


def test_a_staged_folder_that_was_to_be_new_replaces_nothing(page_folder: Path) -> None:
    def write_page(name: str) -> None:
        with temporary.staged_folder(page_folder, r"\d+|index\.html") as staged:
            (staged / name).write_text("new")

    temporary.expect_new(page_folder, new=True)
    with pytest.raises(FileExistsError, match="files have appeared in it"):
        write_page("index.html")
    assert (page_folder / "index.html").read_text() == "old"
    (page_folder / "index.html").unlink()
    (page_folder / "7/old.webp").rename(page_folder / "old.webp")
    (page_folder / "7").rmdir()
    temporary.expect_new(page_folder, new=True)
    # What is there besides is somebody's, and once it is written, the folder may be written anew.
    for _ in range(2):
        write_page("index.html")
    assert contents(page_folder) == ["index.html", "notes.txt", "old.webp"]


@pytest.mark.parametrize("name", ["tiles", "new/tiles"])
def test_a_staged_folder_that_fails_changes_nothing(page_folder: Path, name: str) -> None:
    def write_half() -> None:
        with temporary.staged_folder(page_folder.parent / name, ".*") as staged:
            (staged / "index.html").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert contents(page_folder.parent) == ["tiles/7/old.webp", "tiles/index.html", "tiles/notes.txt"]
    assert not (page_folder.parent / "new").exists()
