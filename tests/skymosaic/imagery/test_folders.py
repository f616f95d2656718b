"""Folders are read by one rule, and nothing in them that may be a photograph is passed over without a word."""

from pathlib import Path

import pytest

from skymosaic.common.errors import InputError
from skymosaic.imagery import patterns
from skymosaic.imagery.folders import Listing, list_pictures
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.photographs import list_sources


@pytest.fixture
def card(tmp_path: Path) -> Path:
    """A folder as a camera leaves it, with what other programs add."""
    for name in (
        "DCIM/DJI_1.JPG", "DCIM/DJI_1.DNG", "DCIM/DJI_2.DNG", "DCIM/DJI_2.SRT", "DCIM/IMG_3.heic", "DCIM/DJI_4.MP4",
        "DCIM/101MEDIA/DJI_10.JPG", "DCIM/101MEDIA/DJI_9.JPG", "DCIM/101MEDIA/more/DJI_11.JPG",
        "DCIM/report/index.html", "DCIM/report/mosaic_1.jpg", "DCIM/.thumbnails/DJI_1.JPG",
    ):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(name.encode())
    return tmp_path / "DCIM"


def test_what_is_not_read_is_counted_by_kind_with_what_to_do(card: Path) -> None:
    told: list[str] = []
    assert [Path(source.name).name for source in list_sources(card, told.append)] == ["DJI_1.JPG"]
    assert told == [
        f"note {card}: not read: "
        "3 pictures in folders inside (101MEDIA, 101MEDIA/more): name them, or add `recursive`; "
        "1 .DNG: develop them as JPEG or TIFF; 1 .MP4: name one by its file; 1 .heic: convert them to JPEG or TIFF"
    ]


@pytest.mark.parametrize(("count", "last"), [(5, "4"), (6, "4, ...")])
def test_five_folders_inside_are_named(count: int, last: str) -> None:
    found = Listing((), {str(number): 2 for number in range(count)}, {})
    assert f"{2 * count} pictures in folders inside (0, 1, 2, 3, {last}): " in found.describe_unread()


def test_three_folders_deep_is_looked_for_what_is_not_read(tmp_path: Path) -> None:
    for depth in range(1, 6):
        inside = tmp_path.joinpath(*"abcde"[:depth])
        inside.mkdir()
        (inside / "x.png").touch()
    assert list(list_pictures(tmp_path).in_folders) == ["a", "a/b", "a/b/c"]
    assert len(list_pictures(tmp_path, recursive=True).pictures) == 5


def test_folders_inside_are_read_if_asked_for_and_named_otherwise(card: Path) -> None:
    told: list[str] = []
    sources = list_sources(card, told.append, recursive=True)
    assert [str(Path(source.name).relative_to(card)) for source in sources] == [
        "DJI_1.JPG", "101MEDIA/DJI_9.JPG", "101MEDIA/DJI_10.JPG", "101MEDIA/more/DJI_11.JPG",
    ]  # fmt: skip
    assert "folders inside" not in told[0]
    (card / "DJI_1.JPG").unlink()
    with pytest.raises(InputError, match=r"contains no pictures .*3 pictures in folders inside \(101MEDIA"):
        list_sources(card)
    assert len(list_sources(card, recursive=True)) == 3


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("a.dng", "1 .dng: develop"),
        ("a.HEIC", "1 .HEIC: convert"),
        ("a.pgm", "1 .pgm: convert"),
        ("a.jfif", "1 .jfif: end their names in .jpg"),
        ("a.mov", "1 .mov: name one"),
    ],
)
def test_a_folder_of_what_cannot_be_read_says_what_to_do(tmp_path: Path, name: str, remedy: str) -> None:
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=f"contains no pictures .*{remedy}"):
        list_sources(tmp_path)


def test_mosaics_and_links_inside_are_no_photographs(card: Path) -> None:
    photographs = list_pictures(card, recursive=True).pictures
    for output in (card / "mosaic.jpg", card / "101MEDIA" / "mosaic.jpg", card / "out" / "mosaic.jpg"):
        output.parent.mkdir(exist_ok=True)
        output.write_bytes(b"a mosaic")
        record_output(output, [card])
    assert list_pictures(card, recursive=True).pictures == photographs
    (card / "DJI_1.JPG").unlink()
    sources = list_sources(card, recursive=True)
    (card / "mosaic.jpg").write_bytes(b"a mosaic")
    record_output(card / "mosaic.jpg", [folder for source in sources for folder in source.folders])
    assert [source.content for source in list_sources(card, recursive=True)] == [source.content for source in sources]


def test_an_unreadable_folder_inside_matters_where_it_is_read(card: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse_inside(folder: Path) -> list[Path]:
        if folder.name == "101MEDIA":
            raise InputError(f"{folder}: cannot be read")
        return list(folder.iterdir())

    monkeypatch.setattr(patterns, "list_folder", refuse_inside)
    assert [path.name for path in list_pictures(card).pictures] == ["DJI_1.JPG"]
    with pytest.raises(InputError, match="101MEDIA: cannot be read"):
        list_pictures(card, recursive=True)


def test_a_link_to_nothing_is_a_photograph_that_is_missing(card: Path) -> None:
    (card / "DJI_5.JPG").symlink_to("/nowhere/DJI_5.JPG")
    assert [path.name for path in list_pictures(card).pictures] == ["DJI_1.JPG", "DJI_5.JPG"]
