from pathlib import Path

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.imagery.exif import Position
from skymosaic.maps.georeference import map_to_globe
from skymosaic.maps.positions import Fix, Positions, load_positions

LINES = """
# second battery
a/DJI_1.JPG -91.994 46.842 198.6
b/DJI_1.JPG -91.993 46.842 198.6 10 0 0 0.03 0.05
DJI_2.JPG -91.992 46.842
"""


def loaded(tmp_path: Path, header: str, lines: str = LINES) -> Positions:
    (tmp_path / "geo.txt").write_text(header + lines)
    return load_positions(tmp_path / "geo.txt")


def test_positions_and_their_accuracy_belong_to_photographs(tmp_path: Path) -> None:
    positions = loaded(tmp_path, "EPSG:4326")
    assert positions.fixes[1] == Fix("b/DJI_1.JPG", Position(46.842, -91.993), 0.03)
    found = positions.find(["flight/b/DJI_1.jpg", "flight/a/dji_1.jpg", "flight/c/DJI_3.JPG", "flight/c/DJI_2.JPG"])
    assert [fix and fix.position.longitude_deg for fix in found] == [-91.993, -91.994, None, -91.992]


def test_names_may_have_spaces(tmp_path: Path) -> None:
    lines = '\nFlight South (1).JPG -91.994 46.842 100\n"no suffix, 2" -91.993 46.842\nDJI_3.tif.old -91 46\n'
    names = [fix.photograph for fix in loaded(tmp_path, "EPSG:4326", lines).fixes]
    assert names == ["Flight South (1).JPG", "no suffix, 2", "DJI_3.tif.old"]


@pytest.mark.parametrize(
    ("written", "accuracy_m"),
    [("0", None), ("0.0", None), ("0.02", 0.02), ("1e-3", 0.001), ("", None), ("0.02 fixed", 0.02)],
)
def test_an_accuracy_of_zero_is_unknown(tmp_path: Path, written: str, accuracy_m: float | None) -> None:
    (fix,) = loaded(tmp_path, "EPSG:4326", f"\n1.jpg -92 46.8 0 0 0 0 {written}\n").fixes
    assert fix == Fix("1.jpg", Position(46.8, -92.0), accuracy_m)


def test_maps_in_feet_are_read(tmp_path: Path) -> None:
    (fix,) = loaded(tmp_path, "EPSG:2264", "\n1.jpg 2000000 700000 10\n").fixes
    assert (fix.position.latitude_deg, fix.position.longitude_deg) == pytest.approx((35.674, -79.0), abs=0.02)


def test_degrees_of_another_datum_are_converted(tmp_path: Path) -> None:
    (fix,) = loaded(tmp_path, "EPSG:4267", "\n1.jpg -92 46.8\n").fixes
    ((longitude_deg, latitude_deg),) = map_to_globe(np.array([(-92.0, 46.8)]), "EPSG:4267").tolist()
    assert fix.position == Position(latitude_deg, longitude_deg)
    assert longitude_deg == pytest.approx(-92.0002, abs=1e-4)


@pytest.mark.parametrize(
    ("header", "lines", "says"),
    [
        ("EPSG:4326", "", "no positions"),
        ("EPSG:4326", "\n1.jpg 46.8 -92", "a latitude beyond 90"),
        ("EPSG:4326", "\n1.jpg 268 46.8", "a longitude beyond 180"),
        ("EPSG:32615", "\n1.jpg 5e7 1e8", "check the coordinate system"),
        ("EPSG:4326", "\n1.jpg 46.8", "line 2 is '1.jpg 46.8'"),
        ("EPSG:32615", LINES, "its coordinates are degrees, but EPSG:32615 is in metres; begin with EPSG:4326"),
        ("EPSG:4326", "\n1.jpg 46.8 east", "line 2"),
        ("EPSG:4326", "\n1.jpg -92 46.8 0 0 0 0 -0.02", "line 2"),
        ("EPSG:4326", "\n1.jpg -92 46.8\n2.jpg -92 46.8 nan", "line 3"),
        ("EPSG:4978", LINES, "has no map coordinates"),
    ],
)
def test_a_file_of_another_form_is_one_line(tmp_path: Path, header: str, lines: str, says: str) -> None:
    with pytest.raises(InputError) as refused:
        loaded(tmp_path, header, lines)
    assert says in str(refused.value)
    assert "geo.txt" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("photographs", "says"),
    [
        (["DJI_2.JPG", "x/a/DJI_1.JPG"], "b/DJI_1.JPG is no photograph"),
        (["b/DJI_1.JPG", "x/a/DJI_1.JPG", "y/a/DJI_1.JPG"], "a/DJI_1.JPG is 2 photographs; add their folders"),
    ],
)
def test_names_that_are_not_one_photographs_are_refused(tmp_path: Path, photographs: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        loaded(tmp_path, "EPSG:4326").find(photographs)


def test_a_photograph_has_one_position(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"1\.JPG has two positions"):
        loaded(tmp_path, "EPSG:4326", "\n1.jpg -92 46\n1.JPG -92.1 46\n").find(["1.jpg"])
