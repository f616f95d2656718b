"""Errors, options, numbers of files, and what outputs replace."""

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from golden_model.version import VERSION
from skymosaic.common import errors, temporary
from skymosaic.common.errors import InputError
from skymosaic.common.options import Checked, choose_options, command_words, document_options, option, options_of
from skymosaic.common.provenance import finite, provenance, to_json
from skymosaic.common.replaced import find_replaced, refuse_inputs


@pytest.mark.parametrize("name", [name for name in vars(errors) if name.endswith("Error") and name[0] != "_"])
def test_a_message_is_one_printable_line_for_any_name_of_a_file(name: str) -> None:
    message = str(getattr(errors, name)("two\nlines\x1b[2J.jpg: damaged"))
    assert message.isprintable()
    assert message.endswith(".jpg: damaged")


def test_of_several_outputs_each_that_fails_is_a_line() -> None:
    failures: list[str] = []
    for fault in (errors.OutputError("a.png: full"), OSError(28, "No space left", "b.csv"), None):
        with errors.noting(failures):
            if fault:
                raise fault
    assert failures == ["a.png: full", "b.csv: cannot be written (No space left); check the disk"]
    with pytest.raises(errors.RegistrationError), errors.noting(failures):
        raise errors.RegistrationError("no overlap")


@document_options
@dataclass(frozen=True, kw_only=True)
class Options(Checked):
    """Some options."""

    share: float | None = option(None, "A share.", above=0, maximum=1)
    tiles: int = option(2, "Tiles.", minimum=1, maximum=8)
    kind: Literal["plain", "odd"] | bytes = option("plain", "A kind.")
    name: str | None = option(None, "A name.", "Output")
    strict: bool = option(False, "Strict.")
    room_bytes: int = option(1 << 20, "Room.", "Input", unit=1 << 20, unit_name="megabytes")
    private: int = 3


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        *(({"share": each}, "") for each in (None, 1e-9, 1, 1.0, np.float32(0.5))),
        *(({"share": each}, "; it must be more than 0 and at most 1") for each in (0, 1.1, np.inf, np.nan, "1")),
        *(({"tiles": each}, "") for each in (1, 8, np.int16(3))),
        *(({"tiles": each}, "; it must be at least 1 and at most 8") for each in (0, 9, 2.0, "2")),
        *(({"kind": each}, "") for each in ("odd", b"own")),
        *(({"kind": each}, "; valid: plain, odd") for each in ("even", 1)),
        ({"name": 3}, "`name` is 3; it must be str or None"),
        ({"strict": 0}, "`strict` is 0; it must be bool"),
        ({"name": "x", "strict": True}, ""),
    ],
)
def test_an_option_takes_what_is_valid(given: dict[str, Any], fault: str) -> None:
    options = choose_options(Options, Options(tiles=3), given)
    if fault:
        with pytest.raises(InputError, match=f"{fault}$"):
            options.check()
    else:
        options.check()
        assert options == Options(**{"tiles": 3, **given})


def test_options_are_those_of_their_class_and_have_words() -> None:
    assert [each.name for each in options_of(Options)] == ["room_bytes", "share", "tiles", "kind", "strict", "name"]
    assert choose_options(Options, None, {"tiles": 5}) == Options(tiles=5)
    with pytest.raises(InputError, match=r"^options is 3; give Options\(\.\.\.\), or single options by their names$"):
        choose_options(Options, 3, {})  # type: ignore[arg-type]
    given = Options(share=0.5, kind="odd", strict=True, room_bytes=5 << 20)
    assert command_words(given) == ["--room", "5", "--share", "0.5", "--kind", "odd", "--strict"]


def test_a_file_says_what_wrote_it_and_what_json_does_not_know_is_null() -> None:
    nested = {"a": (1.5, math.inf, [-math.inf, {"b": math.nan}]), Path("c"): [Path("d"), None, True, 7]}
    assert finite(nested) == {"a": [1.5, None, [None, {"b": None}]], "c": ["d", None, True, 7]}

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    read = json.loads(to_json({"written": "by hand", "error_px": math.nan}), parse_constant=refuse)
    assert read == {**provenance(), "written": "by hand", "error_px": None}
    assert (read["program"], read["version"]) == ("skymosaic", VERSION)


def test_a_file_is_replaced_under_each_of_its_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    photograph, folder = Path("a.jpg"), Path("folder")
    photograph.write_text("photograph")
    folder.mkdir()
    Path("soft.jpg").symlink_to("a.jpg")
    os.link("a.jpg", "hard.jpg")
    Path("linked").symlink_to(tmp_path)
    for name in ("a.jpg", "folder/../a.jpg", "./a.jpg", tmp_path / "a.jpg", "soft.jpg", "hard.jpg", "linked/a.jpg"):
        for output, file in ((Path(name), photograph), (photograph, Path(name))):
            assert find_replaced(output, [Path("other.jpg"), file]) == (output, file), (output, file)
    for name in ("b.jpg", "folder/a.jpg", "folder", "a.jpg.png"):
        assert find_replaced(Path(name), [photograph, Path("missing.jpg")]) is None, name


def test_of_a_folder_only_own_names_are_replaced(tmp_path: Path) -> None:
    deep = tmp_path / "7" / "3"
    deep.mkdir(parents=True)
    for path in (deep / "a.jpg", tmp_path / "b.jpg", tmp_path / "page.html"):
        path.touch()
    (tmp_path / "8").symlink_to(tmp_path / "elsewhere")
    other = tmp_path / "elsewhere" / "c.jpg"
    other.parent.mkdir()
    other.touch()
    own = r"\d|page\.html"
    assert find_replaced(tmp_path, [deep / "a.jpg"], own) == (deep / "a.jpg", deep / "a.jpg")
    assert find_replaced(tmp_path, [other], own) == (tmp_path / "8" / "c.jpg", other)
    assert find_replaced(tmp_path, [tmp_path / "page.html"], own) is not None
    assert (
        find_replaced(tmp_path, [tmp_path / "b.jpg", tmp_path, tmp_path.parent, deep / "a.jpg" / "x"][:3], own) is None
    )
    # An output that is not there yet, as systems write it that take both for the same.
    assert find_replaced(tmp_path / "new", [tmp_path / "new" / "PAGE.html"], own) is not None


def test_the_line_names_the_file(tmp_path: Path) -> None:
    photograph, link = tmp_path / "a.jpg", tmp_path / "b.jpg"
    photograph.touch()
    link.symlink_to(photograph)
    with pytest.raises(InputError, match=r"a\.jpg: is one of the inputs; choose another name"):
        refuse_inputs(photograph, [photograph])
    with pytest.raises(InputError, match=r"b\.jpg: is the same file as .*a\.jpg, one of the inputs"):
        refuse_inputs(link, [photograph])
    with pytest.raises(InputError, match=r": its b\.jpg holds .*a\.jpg, one of the inputs; choose another folder"):
        refuse_inputs(tmp_path, [photograph], r"b\.jpg")


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
