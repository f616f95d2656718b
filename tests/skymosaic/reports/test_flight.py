"""What the report of a flight says, of mosaics in which some photographs lack what others have."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from golden_model.config import PRESETS
from skymosaic.flight.checking.check import FlightCheck, PhotographCheck
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.imagery.depth import ValueRange
from skymosaic.imagery.exif import Metadata
from skymosaic.maps.georeference import Georeference
from skymosaic.reports import flight as report
from skymosaic.reports.summary import describe_mosaic

NAMES = [f"/site/{number}.jpg" for number in range(4)]
# Turned by 30 degrees, 5 cm per pixel.
TURNED = 0.05 * np.array([[np.cos(0.5236), np.sin(0.5236), 8e6], [np.sin(0.5236), -np.cos(0.5236), 1e8], [0, 0, 20]])


def tie(left: int, right: int, count: int, checks: int = 0, off_px: float = 0.0) -> Link:
    """A link of a photograph and its copy, with matches kept aside that are off."""
    points = np.random.default_rng(left).uniform(0, 300, (count, 2))
    aside = np.random.default_rng(right).uniform(0, 300, (checks, 2))
    moved = np.add(aside, (off_px, 0))
    return Link(left, right, points, points, count, count + count // 4, left_checks=aside, right_checks=moved)


def delivered(**changes: Any) -> Any:
    """A mosaic of three of four photographs; the reference is not the first."""
    layout = Layout(
        members=(0, 1, 3),
        reference=1,
        transforms={member: np.eye(3) for member in (0, 1, 3)},
        links=(tie(0, 1, 120), tie(1, 3, 40)),
        contradicting=(tie(0, 3, 9),),
        errors_px=(np.full(120, 0.5), np.array([2.0] * 39 + [9.0])),
        model="affine",
        reason="as good as a homography",
    )
    views = [
        SimpleNamespace(
            name=n, size=(800, 600), working_size=(400, 300), to_original=np.diag([2.0, 2, 1]), taken=Metadata()
        )
        for n in NAMES
    ]
    placements = [SimpleNamespace(source=SimpleNamespace(name=NAMES[m])) for m in layout.members]
    flight = SimpleNamespace(
        names=NAMES,
        views=views,
        pair=None,
        onto=None,
        links=(*layout.links, *layout.contradicting, SimpleNamespace(holds=False)),
        describe_blurred=lambda _layout: "",
        left_out={2: "/site/2.jpg: blurred"},
    )
    composition = SimpleNamespace(
        size=(900, 700),
        placements=placements,
        transforms=[np.eye(3), np.diag([3.0, 3, 1]), np.eye(3)],
        reduced="",
        uneven="",
        cut_off={},
        band_names=(),
        aligned_px={},
        values=None,
        place=MapPlace(),
    )
    delivery = SimpleNamespace(
        path=Path("out/m.tif"),
        layout=layout,
        flight=flight,
        composition=composition,
        map_note="",
        seconds=1.26,
        failures=(),
    )
    delivery.covered_px = 400_000
    for name, value in changes.items():
        owner = next(part for part in (composition, delivery, flight) if hasattr(part, name))
        setattr(owner, name, value)
    delivery.georeference = composition.place.georeference
    return delivery


ON_MAP = Georeference("EPSG:32615", TURNED, 0.4, (0.3, np.nan, 60.2, 75.4), (2, 3), 0.0123)
PLACE = MapPlace(
    ON_MAP,
    fitted_to=("0.jpg", "1.jpg", "2.jpg", "3.jpg"),
    height_m=81.4,
    recorded_height_m=120.0,
    turned_deg=-12.3,
    checked_m={"CHK-1": 0.3, "CHK-2": 0.5},
)


def test_a_plain_mosaic_has_the_rows_that_all_have() -> None:
    assert report._mosaic_rows(delivered()) == [
        ("file", "m.tif, 900x700"),
        ("photographs", "3"),
        ("frame", "/site/1.jpg, without its tilt"),
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


def test_what_only_some_mosaics_have_is_a_row_of_its_own() -> None:
    layout = dataclasses.replace(delivered().layout, links=(tie(0, 1, 120, 20, 3.0), tie(1, 3, 40, 20, 1.0)))
    flat = [dataclasses.replace(link, near=len(link.left_points) + 1) for link in layout.links]
    rich = delivered(
        layout=dataclasses.replace(layout, links=tuple(flat)),
        reduced="to a quarter",
        uneven="burnt",
        cut_off={"/site/3.jpg": 0.123, "/site/0.jpg": 0.5},
        band_names=("green", "red", "nir"),
        aligned_px={"green": 0.314, "nir": 1.2},
        values=ValueRange(120.0, 5000.0, deep=True),
        place=dataclasses.replace(PLACE, contradictions=("one", "two")),
        map_note="two cameras of three",
        failures=("tiles: full",),
    )
    rows = dict(report._mosaic_rows(rich))
    assert rows["ground"] == "flat (1% of the matches lie 3 to 12 px off the plane)"
    assert rows["linked pairs"].startswith("median 2.00 px, 90 % below 3.00 px")
    assert (rows["size"], rows["light"]) == ("to a quarter", "burnt")
    why = "ground towards the horizon, far beyond their matches or too coarse"
    assert rows["cut off"] == f"3.jpg 12%, 0.jpg 50%: {why}"
    many = delivered(cut_off={f"{number}.jpg": 0.1 for number in range(9)})
    named = "0.jpg 10%, 1.jpg 10%, 2.jpg 10%, 3.jpg 10%, 4.jpg 10% and 4 more"
    assert dict(report._mosaic_rows(many))["cut off"] == f"{named}: {why}"
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
    exact = dataclasses.replace(delivered().layout, errors_px=())
    assert describe_mosaic(delivered(place=plain, layout=exact))["map"] == (
        "EPSG:32615, 0.05 m per pixel; control points residual 0.40 m"
    )
    assert describe_mosaic(delivered(place=plain, layout=exact, pair=object()))["map"] == "EPSG:32615, 0.05 m per pixel"


def test_the_numbers_of_the_map_leave_out_what_is_unknown() -> None:
    assert report._map_numbers(delivered()) == {"crs": None}
    numbers = report._map_numbers(delivered(place=PLACE))
    assert numbers["offsets_m"] == {"0.jpg": 0.3, "2.jpg": 60.2, "3.jpg": 75.4}
    assert numbers["left_out"] == ["3.jpg", "2.jpg"]
    assert (numbers["scale_error_95"], numbers["median_error_m"]) == (0.0123, 0.15)
    unsure = dataclasses.replace(PLACE, georeference=dataclasses.replace(ON_MAP, scale_error=np.nan))
    assert report._map_numbers(delivered(place=unsure))["scale_error_95"] is None


def test_places_and_links_are_listed_the_worst_first() -> None:
    assert report._residuals_worst_first(delivered()) == []
    assert report._residuals_worst_first(delivered(place=PLACE)) == [
        ("3.jpg", "left out", 75.4), ("2.jpg", "left out", 60.2), ("CHK-2", "check point", 0.5),
        ("0.jpg", "fitted", 0.3), ("CHK-1", "check point", 0.3),
    ]  # fmt: skip
    links = [tuple(link.values()) for link in report._links_worst_first(delivered())]
    assert links == [("1.jpg", "3.jpg", 40, 40, 2.0), ("0.jpg", "1.jpg", 120, 120, 0.5)]
    assert report._photographs_worst_first(delivered()) == []
    layout = dataclasses.replace(delivered().layout, links=(tie(0, 1, 50, 20, 1.0), tie(1, 3, 50, 9, 6.0)))
    assert report._photographs_worst_first(delivered(layout=layout)) == [
        ("3.jpg", 6.0, 6.0, 9), ("0.jpg", 1.0, 1.0, 20), ("1.jpg", 1.0, 6.0, 29)
    ]  # fmt: skip


def test_the_numbers_of_a_mosaic() -> None:
    numbers = report._mosaic_numbers(delivered(place=PLACE, aligned_px={"nir": 1.23456}, cut_off={"3.jpg": 0.123456}))
    assert (numbers["placed"], numbers["reference"], numbers["size"]) == (3, "/site/1.jpg", [900, 700])
    assert (numbers["median_error_px"], numbers["error_90_percent_px"], numbers["relief"]) == (0.5, 2.0, 0.2)
    assert list(numbers["transforms"]) == ["/site/0.jpg", "/site/1.jpg", "/site/3.jpg"]
    assert numbers["transforms"]["/site/1.jpg"][0] == [3, 0, 0]
    assert numbers["contradicting"] == [["/site/0.jpg", "/site/3.jpg"]]
    assert (numbers["band_error_px"], numbers["cut_off"]) == ({"nir": 1.235}, {"3.jpg": 0.1235})
    assert (numbers["value_range"], numbers["independent_errors"]) == (None, None)
    deep = report._mosaic_numbers(delivered(values=ValueRange(1.0, 2.0)))
    assert deep["value_range"] == {"low": 1.0, "high": 2.0, "kept_in_tif": False}


def test_the_numbers_of_a_flight_name_whom_they_concern() -> None:
    delivery = delivered()
    for view, notes in zip(delivery.flight.views, [(), ("turned",), (), ("16 bits", "turned")], strict=True):
        view.notes = notes
    delivery.flight.settings = SimpleNamespace(backend="golden", working_width_px=400, config=PRESETS["aerial"])
    delivery.flight.seconds = {"features": 1.23456}
    delivery.flight.calibration = SimpleNamespace(
        lens=SimpleNamespace(numbers={"k1": -0.02}), before_px=1.23456, after_px=0.51239
    )
    check = FlightCheck(complete=False, photographs=(), problems=("one side",))
    numbers = report.flight_numbers([delivery, delivery], check)
    assert numbers["left_out"] == {"/site/2.jpg": "/site/2.jpg: blurred"}
    assert numbers["notes"] == ["/site/1.jpg: turned", "/site/3.jpg: 16 bits", "/site/3.jpg: turned"]
    assert (numbers["pairs_tried"], numbers["links"], numbers["photographs"]) == (4, 3, 4)
    assert len(numbers["mosaics"]) == 2
    assert numbers["seconds"] == {"features": 1.235}
    assert numbers["lens"] == {"k1": -0.02, "held_out_before_px": 1.235, "held_out_after_px": 0.512}
    delivery.flight.calibration = None
    assert report.flight_numbers([delivery], check)["lens"] is None
    assert (numbers["check"]["problems"], numbers["rules"], numbers["working_width_px"]) == (
        ("one side",),
        "aerial",
        400,
    )


def test_advice_is_about_the_flight_and_then_about_photographs_with_problems() -> None:
    photographs = [
        PhotographCheck(name, 2, 0.5, 1.0, 0.0, gps=True, problems=problems)
        for name, problems in (("a.jpg", ()), ("b.jpg", ("blurred", "no GPS")), ("c.jpg", ("too dark",)))
    ]
    check: Any = SimpleNamespace(problems=["one side"], photographs=photographs)
    assert report._problems(check) == ["one side", "b.jpg: blurred, no GPS", "c.jpg: too dark"]


@pytest.mark.parametrize(
    ("names", "folder"),
    [
        (["/flight/1.jpg", "/flight/rtk/2.jpg"], "/flight/"),
        (["flight/1.jpg", "flight/2.jpg"], "flight/"),
        (["1.jpg", "2.jpg"], ""),
        (["north/1.jpg", "south/2.jpg"], ""),
        (["/flight/1.jpg", "2.jpg"], ""),
    ],
)
def test_names_lose_only_the_folder_that_has_all_of_them(names: list[str], folder: str) -> None:
    assert report._common_folder(names) == folder
