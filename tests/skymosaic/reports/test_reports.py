"""Reports of pairs, and the summary of a site."""

import dataclasses
import html
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree as XmlTree

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from golden_model.version import VERSION
from sim.scene import make_pair
from skymosaic.features.positions import match_points
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.flight.picture.formats import OutputForm
from skymosaic.geometry import estimators
from skymosaic.imagery.exif import Metadata
from skymosaic.maps.features import Place, write_places
from skymosaic.maps.georeference import Georeference
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.registration.pair import Pair
from skymosaic.registration.register import register
from skymosaic.reports import figures, pages
from skymosaic.reports.flight import write_report
from skymosaic.reports.pair import _table_rows, write_pair_report
from skymosaic.reports.summary import describe_accuracy, list_files, summary_rows
from tests.skymosaic.flight.made import PLACE, delivered, tie
from tests.skymosaic.panel.tasks.test_mosaic_tasks import METRES_PER_PIXEL, write_flight_with_gps

NAME = "a\udcff\x1b[31m<b>&\x00.jpg"


def test_names_and_values_are_escaped_once_whatever_they_are(tmp_path: Path) -> None:
    page = pages.render("pair.html", title=NAME, rows=[("name", f"{NAME}\nsecond")], pictures={})
    pages.write_report_files(tmp_path, {"name": NAME}, page)
    shown = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "\\udcff\\x1b[31m&lt;b&gt;&amp;\\x00.jpg" in shown
    assert json.loads((tmp_path / "report.json").read_bytes())["name"] == NAME
    write_places(tmp_path / "p.kml", NAME, [Place(NAME, "Polygon", np.zeros((5, 2)), {"reason": NAME, "area_m2": 2.5})])
    kml = XmlTree.fromstring((tmp_path / "p.kml").read_bytes())
    assert [each.text for each in kml.iter() if each.tag.endswith("name")] == ["a\\udcff\\x1b[31m<b>&\\x00.jpg"] * 2
    facts = {each.get("name"): each[0].text for each in kml.iter() if each.tag.endswith("}Data")}
    assert facts == {"reason": "a\\udcff\\x1b[31m<b>&\\x00.jpg", "area_m2": "2.5"}
    (tmp_path / "rows.html").write_text("{% macro row(name) %}<b>{{ name }}</b>{% endmacro %}{{ row(name) }}")
    assert pages.open_templates(tmp_path).get_template("rows.html").render(name="<i>") == "<b>&lt;i&gt;</b>"


LEFT, RIGHT = make_pair(seed=5, size=(320, 240)).images


def test_fuzzy_ransac_shows_what_its_six_rules_decide() -> None:
    pair = register(LEFT, RIGHT, detector="sift", descriptor="thesis-ilbp-4", estimator="fuzzy-ransac")
    decided, names = figures._find_deciding_rules(pair)
    _, decision = estimators.fuzzy(*match_points(pair.matches), pair.matches["verdict"] == 1)
    assert decision is not None
    np.testing.assert_array_equal(decided["verdict"], decision.inliers)
    assert not np.array_equal(decided["verdict"], pair.matches["verdict"])
    accepted = np.isin(
        decided["rule"], [names.index(f"bidirectional check verified, error {e}") for e in ("less", "equal")]
    )
    np.testing.assert_array_equal(decided["verdict"] == 1, accepted)


@pytest.fixture(scope="module")
def pair() -> Pair:
    """An accepted pair, of which only the right photograph has notes."""
    first, second = make_pair(seed=5, size=(320, 240)).images
    made = register(first, second, effort="fast")
    left = replace(made.left, name="/site/left.jpg", pixels=made.left.pixels[:200])
    right = replace(made.right, name="right.png", notes=("turned", "16 bits"))
    return replace(made, left=left, right=right, seconds={"features": 0.126, "matching": 1.0})


def test_the_rows_of_an_accepted_pair(pair: Pair) -> None:
    homography = np.array([[1.0, 0.25, -12.5], [0, 1, 3], [1e-5, 0, 1]])
    shown = replace(pair, homography=homography, refined_inliers=77, passes=3, known_evidence=pair.evidence)
    rows = dict(_table_rows(shown))
    left, right = map(len, pair.features)
    assert left != right
    assert rows == {
        "left": "left.jpg, 320x200 px",
        "right": "right.png, 320x240 px; turned; 16 bits",
        "verdict": "accepted",
        "confidence": f"good: {pair.confidence and pair.confidence.reason}",
        "corners": f"{left} and {right}",
        "matches": f"{len(pair.matches)}, {len(pair.kept)} kept by the rules, {len(pair.inliers)} on the homography",
        "refit": "to 77 points of dense flow",
        "homography, left to right, px": "1  0.25  -12.5\n0  1  3\n1e-05  0  1",
        "method": "harris + ilbp-128, prosac; passes: 3 (fast)",
        "computed by": "golden",
        "time": "features 0.13 s, matching 1.00 s",
    }


def test_a_refused_pair_says_why_and_has_no_row_of_what_it_lacks(pair: Pair, tmp_path: Path) -> None:
    refused = replace(pair, homography=None, reason="7 matches; `accept_poor` takes it", refined_inliers=0)
    rows = dict(_table_rows(refused))
    assert rows["verdict"] == "refused: 7 matches; --accept-poor takes it"
    assert list(rows) == ["left", "right", "verdict", "corners", "matches", "method", "computed by", "time"]
    write_pair_report(tmp_path, refused, None)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "corners_left.png", "corners_right.png", "index.html", "matches.png", "report.json",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a map of a flight, its tiles, and its report."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "flight").mkdir()
    for minute, name in enumerate(write_flight_with_gps(folder / "flight")):
        with Image.open(folder / "flight" / name) as photograph:
            exif, pixels = photograph.getexif(), photograph.copy()
        exif[Base.Make], exif[Base.Model] = "DJI\0\0", "FC300S\0"
        exif.get_ifd(IFD.Exif)[Base.DateTimeOriginal] = f"2026:05:01 10:2{minute}:30"
        pixels.save(folder / "flight" / name, quality=92, exif=exif)
    with open_run(folder / "flight", MosaicOptions()) as run:
        made = run.write(folder / "map #1 of the site.tif", OutputForm(tiles=folder / "tiles"))
        write_report(folder / "report", run.flight, made)
    return folder


def rows_of(page: str) -> dict[str, str]:
    found = re.findall(r"<th>(.*?)</th><td[^>]*>(.*?)</td>", page, re.DOTALL)
    return {name: html.unescape(value) for name, value in reversed(found)}


def test_the_page_says_what_a_client_asks(site: Path) -> None:
    page = (site / "report" / "index.html").read_text()
    rows = rows_of(page)
    assert re.fullmatch(r"map #1 of the site\.tif, \d+ x \d+ pixels, 4 of 4 photographs", rows["mosaic"])
    assert rows["flown"] == "2026-05-01 10:20:30 to 10:23:30"
    assert rows["camera"] == "DJI FC300S"
    resolution = re.fullmatch(r"([\d.]+) cm per pixel", rows["resolution"])
    assert resolution
    assert float(resolution[1]) == pytest.approx(100 * METRES_PER_PIXEL, rel=0.05)
    assert re.fullmatch(
        r"Half of the points by which photographs are linked meet within [\d.]+ cm; "
        r"on the map, they fit the GPS within [\d.]+ m\.",
        rows["accuracy"],
    )
    assert rows["made by"].startswith(f"skymosaic {VERSION}, 20")
    # Before what only its maker reads.
    assert page.index("<img") < page.index("How it was made")


def test_the_area_is_that_of_the_ground_that_shows_amid_white(site: Path) -> None:
    numbers = json.loads((site / "report" / "report.json").read_text())
    (mosaic,) = numbers["mosaics"]
    picture = cv2.imread(str(site / "map #1 of the site.tif"), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    shown_m2 = np.count_nonzero(picture[..., 3]) * mosaic["metres_a_pixel"] ** 2
    assert mosaic["area_m2"] == pytest.approx(shown_m2, rel=0.005)
    assert (numbers["program"], numbers["version"]) == ("skymosaic", VERSION)
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT[\d:]+\+00:00", numbers["written"])
    assert (mosaic["first_taken"], mosaic["cameras"]) == ("2026-05-01 10:20:30", ["DJI FC300S"])
    picture = cv2.imread(str(site / "report" / "mosaic_1.jpg"))
    alpha = cv2.imread(str(site / "map #1 of the site.tif"), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert alpha is not None
    missing = cv2.resize(alpha[..., 3], (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_AREA)
    empty = cv2.erode((missing == 0).astype(np.uint8), np.ones((9, 9))) == 1
    full = cv2.erode((missing == 255).astype(np.uint8), np.ones((9, 9))) == 1
    assert empty.any()
    assert picture[empty].min() > 245
    assert picture[full].mean() < 200


def test_links_lead_to_what_was_written(site: Path) -> None:
    page = (site / "report" / "index.html").read_text()
    links = {name: unquote(html.unescape(address)) for address, name in re.findall(r'href="(.*?)">(.*?)</a>', page)}
    # Nothing has to be flown again.
    named = ["mosaic", "map to zoom", "footprints for Google Earth", "footprints for GIS", "all numbers"]
    assert list(links) == named
    linked = {(site / "report" / address).resolve() for address in links.values()}
    shown = {"index.html", *re.findall(r'src="(.*?)"', page)}
    assert {path for path in (site / "report").iterdir() if path.name not in shown} <= linked
    for address in links.values():
        assert (site / "report" / address).is_file(), address


def rows_of_delivery(times: list[str | None], metres_per_px: float | None, **changes: Any) -> dict[str, str]:
    """The words about a mosaic of three photographs; None: neither time nor camera is known."""
    metres = 1.0 if metres_per_px is None else metres_per_px
    on_map = Georeference("EPSG:32615", np.diag([metres, -metres, 1.0]), 0.404, (0.4, 0.4))
    taken = [Metadata() if time is None else Metadata(time=time, camera=f"C {time[9]}") for time in (*times, None)]
    pairs = zip(delivered().flight.views, [taken[member] for member in (0, 1, 3, 2)], strict=True)
    views = tuple(replace(view, taken=each) for view, each in pairs)
    place = MapPlace() if metres_per_px is None else MapPlace(on_map)
    rows = dict(summary_rows(delivered(views=views, place=place, **changes)))
    assert next(iter(rows)) == "mosaic"
    assert list(rows)[-1] == "made by"
    return rows


@pytest.mark.parametrize(
    ("times", "flown", "camera"),
    [
        (
            ["2026-05-02 10:20:30", None, "2026-05-01 23:59:00"],
            "2026-05-01 23:59:00 to 2026-05-02 10:20:30",
            "C 1, C 2",
        ),
        (["2026-05-01 10:25:30", "2026-05-01 10:20:30", None], "2026-05-01 10:20:30 to 10:25:30", "C 1"),
        ([None, "2026-05-03 10:20:30", None], "2026-05-03 10:20:30", "C 3"),
        ([None, None, None], None, None),
    ],
)
def test_when_and_by_what_a_mosaic_was_flown(times: list[str | None], flown: str | None, camera: str | None) -> None:
    rows = rows_of_delivery(times, None)
    assert (rows.get("flown"), rows.get("camera")) == (flown, camera)
    assert rows["mosaic"] == "m.tif, 800 x 500 pixels, 3 of 4 photographs"
    assert not {"area", "resolution"} & set(rows)


def test_accuracy_is_said_of_what_is_known() -> None:
    unknown = "Not known: no matches were kept aside to measure it."
    assert rows_of_delivery([None] * 3, None)["accuracy"] == unknown
    layout = dataclasses.replace(delivered().layout, links=(tie(0, 1, 120, 20, 3.0), tie(1, 3, 40, 20, 1.0)))
    half = "Half of the points by which photographs are linked meet within"
    assert rows_of_delivery([None] * 3, None, layout=layout)["accuracy"] == f"{half} 2.0 pixels."
    # 2 px of a working image are 12 px of the canvas.
    assert rows_of_delivery([None] * 3, 0.05, layout=layout)["accuracy"] == (
        f"{half} 60.0 cm; on the map, they fit the GPS within 0.40 m."
    )
    checked = dataclasses.replace(PLACE, checked_m={"CHK-1": 0.3, "CHK-2": 0.5})
    assert describe_accuracy(delivered(place=checked, layout=layout)).endswith(
        "; 2 check points are off by 0.41 m (root mean square)."
    )


def test_files_of_several_mosaics_are_numbered_and_those_that_exist_alone_are_named(tmp_path: Path) -> None:
    on_map = delivered(place=PLACE, path=tmp_path / "m.tif")
    nowhere = delivered(path=tmp_path / "m_2.tif", tiles=tmp_path / "tiles_2")
    (tmp_path / "mask.png").touch()
    assert list_files([on_map, nowhere], tmp_path / "report", tmp_path) == [
        ("mosaic 1", "../m.tif"),
        ("footprints 1 for Google Earth", "footprints_1.kml"),
        ("footprints 1 for GIS", "footprints_1.geojson"),
        ("mosaic 2", "../m_2.tif"),
        ("map to zoom 2", "../tiles_2/index.html"),
        ("mask of what moves with the camera", "mask.png"),
        ("all numbers", "report.json"),
    ]
