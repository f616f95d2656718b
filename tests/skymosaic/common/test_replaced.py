"""What an output would replace, under each of its names."""

import os
from pathlib import Path

import pytest

from skymosaic.common.errors import InputError
from skymosaic.common.replaced import find_replaced, refuse_inputs


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
