"""What the report of a flight says, of mosaics in which some photographs lack what others have."""

import html
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skymosaic.flight.checking.check import FlightCheck, PhotographCheck
from skymosaic.flight.layout.agreement import Agreement, GroundOfPair
from skymosaic.flight.layout.self_calibration import Calibration
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.output import Delivery
from skymosaic.imagery.depth import ValueRange
from skymosaic.imagery.lens import Lens
from skymosaic.maps.georeference import Georeference
from skymosaic.reports import flight as report
from skymosaic.reports.summary import describe_mosaic
from tests.skymosaic.flight import made
from tests.skymosaic.flight.made import PLACE, TURNED, delivered, tie

LENS = Lens((800, 600), np.array([[800.0, 0, 399.5], [0, 800, 299.5], [0, 0, 1]]), np.array([-0.02, 0, 0, 0, 0]))
FINE = FlightCheck(complete=True, photographs=(), problems=())


def page_of(folder: Path, delivery: Delivery, check: FlightCheck = FINE) -> tuple[dict[str, Any], list[str]]:
    """The rows of each table of the report's page, by the first cell of the table, and the items of its lists."""
    report.write_flight_report(folder, [delivery], check)
    page = html.unescape((folder / "index.html").read_text(encoding="utf-8"))
    tables = [re.findall(r"<tr>(.*)</tr>", table) for table in re.findall(r"<table>(.*?)</table>", page, re.DOTALL)]
    cells = [[tuple(re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)) for row in table] for table in tables]
    return {table[0][0]: table for table in cells}, re.findall(r"<li>(.*)</li>", page)


def test_a_plain_mosaic_has_the_rows_that_all_have(tmp_path: Path) -> None:
    assert page_of(tmp_path / "r", delivered())[0]["file"] == [
        ("file", "m.tif, 800x500"),
        ("photographs", "3"),
        ("frame", "1.jpg, without its tilt"),
        ("model", "affine (as good as a homography)"),
        (
            "ground",
            "with relief: expect breaks at objects above the ground (20% of the matches lie 3 to 12 px off the plane)",
        ),
        ("overlaps", "0 of 0 pairs that overlap by half agree; 0 cannot tell"),
        ("linked pairs", "unknown: no matches were kept aside"),
        ("residual of the fit", "median 0.50 px, without the links that contradict it"),
        ("blending and writing", "1.3 s"),
    ]


def test_what_only_some_mosaics_have_is_a_row_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    layout = replace(delivered().layout, links=(tie(0, 1, 120, 20, 3.0), tie(1, 3, 40, 20, 1.0)))
    flat = [replace(link, near=len(link.left_points) + 1) for link in layout.links]
    monkeypatch.setattr(Composition, "cut_off", {"/site/3.jpg": 0.123, "/site/0.jpg": 0.5})
    rich = delivered(
        layout=replace(layout, links=tuple(flat)),
        reduced="to a quarter",
        uneven="burnt",
        band_names=("green", "red", "nir"),
        aligned_px={"green": 0.314, "nir": 1.2},
        values=ValueRange(120.0, 5000.0, deep=True),
        place=replace(PLACE, contradictions=("one", "two")),
        map_note="two cameras of three",
        failures=("tiles: full",),
    )
    rows = dict(page_of(tmp_path / "r", rich)[0]["file"])
    assert rows["ground"] == "flat (1% of the matches lie 3 to 12 px off the plane)"
    assert rows["linked pairs"].startswith("median 2.00 px, 90 % below 3.00 px")
    assert (rows["size"], rows["light"]) == ("to a quarter", "burnt")
    why = "ground towards the horizon, far beyond their matches or too coarse"
    assert rows["cut off"] == f"3.jpg 12%, 0.jpg 50%: {why}"
    nine = {f"/site/{number}.jpg": f"{number}.jpg" for number in range(9)}
    monkeypatch.setattr(Composition, "cut_off", dict.fromkeys(nine, 0.1))
    monkeypatch.setitem(vars(rich.flight), "short_names", nine)
    named = "0.jpg 10%, 1.jpg 10%, 2.jpg 10%, 3.jpg 10%, 4.jpg 10% and 4 more"
    assert describe_mosaic(rich)["cut off"] == f"{named}: {why}"
    assert rows["bands"] == "green, red, nir; registered by red, median error of the others: green 0.31 px, nir 1.20 px"
    assert rows["range"] == "120..5000 of all photographs shown as 0..255; .tif keeps 16 bits"
    assert rows["map"].startswith("EPSG:32615, 0.05 m per pixel; ")
    assert rows["map note"] == "two cameras of three"
    assert (rows["contradiction"], rows["not written"]) == ("one; two", "tiles: full")
    # Of the matches kept aside: 2 px of a working image, which is 12 px of the canvas.
    assert "; layout off by 0.6 m in the median; " in rows["map"]


def test_the_map_says_how_well_it_fits_and_who_disagrees_the_worst_first() -> None:
    assert describe_mosaic(delivered(place=PLACE))["map"] == (
        "EPSG:32615, 0.05 m per pixel; GPS residual 0.40 m (55.71 m of all); 2 check points off by 0.41 m (root mean "
        "square); scale ± 1.23%; layout off by 0.15 m in the median; flown at 81 m (recorded: 120 m); turned by -12 "
        "degrees from the recorded yaw; without the GPS of 3.jpg (75 m off), 2.jpg (60 m off)"
    )
    on_map = Georeference("EPSG:32615", TURNED, 0.4, (0.3, 0.5))
    plain = MapPlace(on_map, ("0.jpg", "1.jpg"), by="control points", height_m=80.0)
    exact = replace(delivered().layout, errors_px=())
    assert describe_mosaic(delivered(place=plain, layout=exact))["map"] == (
        "EPSG:32615, 0.05 m per pixel; control points residual 0.40 m"
    )
    assert describe_mosaic(delivered(place=plain, layout=exact, pair=object()))["map"] == "EPSG:32615, 0.05 m per pixel"


def test_places_and_links_are_listed_the_worst_first(tmp_path: Path) -> None:
    plain, _ = page_of(tmp_path / "r", delivered())
    assert not {"place", "photograph"} & set(plain)
    assert plain["left"][1:] == [("1.jpg", "3.jpg", "40", "40", "2.0"), ("0.jpg", "1.jpg", "120", "120", "0.5")]
    assert page_of(tmp_path / "r", delivered(place=PLACE))[0]["place"][1:] == [
        ("3.jpg", "left out", "75.40"), ("2.jpg", "left out", "60.20"), ("CHK-2", "check point", "0.50"),
        ("0.jpg", "fitted", "0.30"), ("CHK-1", "check point", "0.30"),
    ]  # fmt: skip
    layout = replace(delivered().layout, links=(tie(0, 1, 50, 20, 1.0), tie(1, 3, 50, 9, 6.0)))
    assert page_of(tmp_path / "r", delivered(layout=layout))[0]["photograph"][1:] == [
        ("3.jpg", "6.00", "6.00", "9"), ("0.jpg", "1.00", "1.00", "20"), ("1.jpg", "1.00", "6.00", "29")
    ]  # fmt: skip


def test_ground_that_was_compared_is_drawn_over_the_mosaic_and_what_differs_lies_on_top(tmp_path: Path) -> None:
    pairs = {(0, 1): GroundOfPair(1, 9, 1.0, 0), (0, 3): GroundOfPair(9, 9, 1.0, 0), (1, 3): GroundOfPair(3, 3, 1.0, 0)}
    page_of(tmp_path, delivered(layout=replace(delivered().layout, agreement=Agreement(pairs))))
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert '<image href="mosaic_1.jpg" width="800" height="500"/>' in page
    drawn = re.findall(r'<polygon class="(\w+)" points="(.*?)"><title>(.*?)<', page)
    assert [(kind, names) for kind, _, names in drawn] == [
        ("agree", "0.jpg and 3.jpg"), ("unknown", "1.jpg and 3.jpg"), ("disagree", "0.jpg and 1.jpg")
    ]  # fmt: skip
    # The second photograph is three times as large on the canvas as the first, and begins where that does.
    assert {*drawn[2][1].split()} == {*drawn[0][1].split()}
    assert len({*drawn[0][1].split()}) == 4


def test_the_numbers_of_a_flight_name_whom_they_concern() -> None:
    views = delivered().flight.views
    notes = [(), ("turned",), (), ("16 bits", "turned")]
    delivery = delivered(
        views=tuple(replace(view, notes=each) for view, each in zip(views, notes, strict=True)),
        settings=Settings(made.CONFIG, working_width_px=400),
        seconds={"features": 1.23456},
        calibration=Calibration(np.array([-0.02]), 1.23456, 0.51239, LENS),
    )
    check = FlightCheck(complete=False, photographs=(), problems=("one side",))
    numbers = report.flight_numbers([delivery, delivery], check)
    assert numbers["left_out"] == {"2.jpg": "2.jpg: blurred"}
    assert numbers["notes"] == ["1.jpg: turned", "3.jpg: 16 bits", "3.jpg: turned"]
    assert (numbers["pairs_tried"], numbers["links"], numbers["photographs"]) == (4, 3, 4)
    assert len(numbers["mosaics"]) == 2
    assert numbers["seconds"] == {"features": 1.235}
    errors = {"held_out_before_px": 1.235, "held_out_after_px": 0.512}
    assert numbers["lens"] == {**LENS.numbers, **errors}
    assert report.flight_numbers([delivered()], check)["lens"] is None
    told = numbers["check"]["problems"], numbers["rules"], numbers["working_width_px"]
    assert told == (("one side",), "aerial", 400)


def test_advice_is_about_the_flight_and_then_about_photographs_with_problems(tmp_path: Path) -> None:
    photographs = tuple(
        PhotographCheck(name, 2, 0.5, 1.0, 0.0, gps=True, problems=problems)
        for name, problems in (("a.jpg", ()), ("b.jpg", ("blurred", "no GPS")), ("c.jpg", ("too dark",)))
    )
    check = FlightCheck(complete=False, photographs=photographs, problems=("one side",))
    _, listed = page_of(tmp_path / "r", delivered(), check)
    assert listed == ["2.jpg: blurred", "one side", "b.jpg: blurred, no GPS", "c.jpg: too dark"]
