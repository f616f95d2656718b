"""Another program's map and a contact sheet in the folder are named; photographs of another camera stay."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from skymosaic.flight.pairing.belonging import find_strangers
from skymosaic.imagery.exif import Metadata, Position

TAKEN = Metadata(position=Position(46.0, 8.0), focal_half_diagonals=1.2)


def view(name: str, size: tuple[int, int] = (4000, 3000), taken: Metadata = TAKEN, *, opaque: bool = True) -> Any:
    return SimpleNamespace(name=name, size=size, taken=taken, gps=taken.position, visible=None if opaque else size)


FLIGHT = [view(f"DJI_{number:04}.JPG", (4000, 3000) if number % 3 else (3000, 4000)) for number in range(12)]
ORTHOPHOTO = view("odm_orthophoto.tif", (1920, 1908), Metadata(), opaque=False)
SHEET = view("contact_sheet.jpg", (1200, 699), Metadata())


def test_a_map_and_a_contact_sheet_are_named_with_what_differs() -> None:
    strangers = find_strangers([ORTHOPHOTO, *FLIGHT, SHEET])
    assert list(strangers) == [0, 13]
    assert strangers[13] == (
        "contact_sheet.jpg: no photograph of this flight (1200x699 px instead of 4000x3000 px, no GPS instead of GPS, "
        "no focal length instead of a focal length); `keep_all` takes it"
    )
    assert "odm_orthophoto.tif: no photograph of this flight (1920x1908 px" in strangers[0]
    assert ".tif instead of .jpg, transparent parts instead of all opaque" in strangers[0]


@pytest.mark.parametrize(
    "other",
    [
        view("crop.jpg", (2000, 1500)),
        view("other_camera.jpg", (5472, 3648), replace(TAKEN, position=None)),
        view("without_exif.JPG", taken=Metadata()),
        view("rotated.png", opaque=False),
    ],
)
def test_a_photograph_that_differs_a_little_stays(other: Any) -> None:
    assert not find_strangers([*FLIGHT, other])


@pytest.mark.parametrize("views", [[*FLIGHT[:4], SHEET], [*FLIGHT[:6], *[SHEET] * 4], [*FLIGHT * 2, *[SHEET] * 3]])
def test_of_few_photographs_or_of_several_kinds_all_are_taken(views: list[Any]) -> None:
    assert not find_strangers(views)
    assert list(find_strangers([*FLIGHT[:5], SHEET])) == [5]
    # Two of ten: what eight have is usual, and two of one size are no other source.
    assert list(find_strangers([*FLIGHT[:8], *[SHEET] * 2])) == [8, 9]


def test_photographs_without_records_make_none_of_those_with_them_strange() -> None:
    bare = [view(f"{number}.jpg", (1280, 960), Metadata()) for number in range(9)]
    assert not find_strangers([*bare, FLIGHT[0]])
