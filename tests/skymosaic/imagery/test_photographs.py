import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import DecodedPhotographs, Source, index_names, list_sources, short_names


def test_decoded_photographs_stay_below_their_limit() -> None:
    sources = [Source(index, f"image {index}", np.full((64, 64), index, np.uint8)) for index in range(5)]
    photographs = DecodedPhotographs(3 * 64 * 64)
    first = photographs.pixels(sources[0], Lens())
    assert photographs.pixels(sources[0], Lens()) is first
    for source in sources[1:]:
        assert np.all(photographs.pixels(source, Lens())[0] == source.index)
    assert photographs.size_bytes == 3 * 64 * 64


def test_a_file_that_changes_after_it_was_read_is_another_photograph(tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.png" for name in ("same", "touched", "other", "gone")]
    for path in paths:
        path.write_bytes(b"pixels")
    sources = list_sources([*paths, np.zeros((64, 64), np.uint8)])
    assert [source.change for source in sources] == [""] * 5
    os.utime(paths[1], (1, 1))
    paths[2].write_bytes(b"others")
    os.utime(paths[2], (1, 1))
    paths[3].unlink()
    assert [source.change.removeprefix(f"{tmp_path}/") for source in sources] == [
        "", "", "other.png: was replaced after it had been read", "gone.png: was removed after it had been read", "",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (["/f/a.jpg", "/f/b.jpg"], ["a.jpg", "b.jpg"]),
        (["f/1/a.jpg", "f/2/a.jpg", "f/2/b.jpg"], ["1/a.jpg", "2/a.jpg", "2/b.jpg"]),
        (["f/a.jpg", "f/a.jpg"], ["f/a.jpg", "f/a.jpg"]),
        ([], []),
    ],
)
def test_names_are_as_short_as_tells_files_apart(names: list[str], short: list[str]) -> None:
    assert short_names(names) == short


def test_an_unreadable_folder_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_path: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        list_sources([tmp_path])


@pytest.mark.parametrize(
    ("name", "indices"),
    [
        ("img_1.jpg", [0, 1]),
        ("B/IMG_1.JPG", [1]),
        ("b\\img_1.jpg", [1]),
        ("/flight/a/IMG_1.JPG", [0]),
        ("g_1.jpg", []),
        ("c/img_1.jpg", []),
        ("", []),
    ],
)
def test_a_name_finds_the_photographs_whose_paths_end_in_it(name: str, indices: list[int]) -> None:
    assert index_names(["/flight/a/IMG_1.JPG", "/flight/b/IMG_1.jpg", "/flight/b/IMG_2.jpg"])(name) == indices


def test_one_string_and_a_pattern_stand_for_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "flight").mkdir()
    for name in ("IMG_10.png", "IMG_2.png", "IMG_[3].png"):
        (tmp_path / "flight" / name).write_bytes(b"x")
    monkeypatch.chdir(tmp_path)
    in_order = ["flight/IMG_2.png", "flight/IMG_10.png", "flight/IMG_[3].png"]
    for given in ("flight", Path("flight"), "flight/*.png", Path("flight/*.png"), [str(tmp_path / "flight/*")]):
        assert [source.name.removeprefix(f"{tmp_path}/") for source in list_sources(given)] == in_order
    # A file of that very name is no pattern.
    assert [source.name for source in list_sources("flight/IMG_[3].png")] == ["flight/IMG_[3].png"]
    # As in a shell, one that matches nothing stands for itself, and is no file.
    assert [source.name for source in list_sources("flight/*.jpg")] == ["flight/*.jpg"]


@pytest.mark.parametrize("given", ["flight/**/*.png", "flight/**", "flight/**/*", "**/**/*.png"])
def test_two_stars_stand_for_folders_at_any_depth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    monkeypatch.chdir(tmp_path)
    names = ["flight/IMG_3.png", "flight/a/IMG_2.png", "flight/a/b/IMG_1.png"]
    for name in (*names, "flight/.hidden/4.png", "flight/report/index.html", "flight/report/tiles/5.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    for circle in ("one", "two"):
        (tmp_path / "flight/a" / circle).symlink_to(tmp_path / "flight")
    for pattern in (given, str(tmp_path / given)):
        assert [source.name.removeprefix(f"{tmp_path}/") for source in list_sources(pattern)] == names
    assert [source.name for source in list_sources("**/b")] == ["flight/a/b/IMG_1.png"]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (None, "image 0: NoneType is no photograph; give a path"),
        (["a.png", None], "image 1: NoneType is no photograph"),
        (b"flight", "image 0: int is no photograph"),
        (["a.png", np.zeros((64, 64), np.float32)], r"image 1: an array of float32, shape \(64, 64\); give uint8"),
        (np.zeros((3, 64, 64, 4), np.uint8), "image 0: an array of uint8"),
    ],
)
def test_what_is_no_photograph_says_what_is(given: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        list_sources(given)


def test_an_array_is_one_photograph_or_a_stack_of_them() -> None:
    assert len(list_sources(np.zeros((64, 80, 3), np.uint8))) == 1
    assert len(list_sources(np.zeros((4, 64, 80, 3), np.uint8))) == 4
