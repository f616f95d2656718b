from pathlib import Path

import numpy as np
import pytest

from skymosaic.errors import InputError
from skymosaic.maps.control_points import ControlPoints, Sighting, load_control_points

LINES = """
# surveyed on Monday
544256.7 5320919.9 5 3044 2622 IMG_0525.jpg corner
544157.7\t5320899.2 5 4193 1552 IMG_0585.jpg
544256.7 5320919.9 5 100.5 200 sub/IMG_0600.jpg
"""


def loaded(tmp_path: Path, header: str, lines: str = LINES) -> ControlPoints:
    (tmp_path / "gcp_list.txt").write_text(header + lines)
    return load_control_points(tmp_path / "gcp_list.txt")


@pytest.mark.parametrize("header", ["EPSG:32610", "WGS84 UTM 10N", "+proj=utm +zone=10 +datum=WGS84 +units=m +no_defs"])
def test_points_and_their_sightings_are_read(tmp_path: Path, header: str) -> None:
    points = loaded(tmp_path, header)
    np.testing.assert_allclose(points.metres, [(544256.7, 5320919.9), (544157.7, 5320899.2)])
    assert points.names == ("corner", "point 2")
    assert points.sightings[2] == Sighting(0, "sub/IMG_0600.jpg", 100.5, 200)
    assert points.crs == "EPSG:32610" or points.crs.startswith(("+proj", "PROJCS"))


def test_degrees_become_metres(tmp_path: Path) -> None:
    points = loaded(tmp_path, "EPSG:4326", "\n-92.0 46.8 200 10 20 a.jpg\n-91.99 46.8 200 10 20 b.jpg\n")
    assert points.crs == "EPSG:32615"
    assert np.hypot(*(points.metres[1] - points.metres[0])) == pytest.approx(763, abs=2)


@pytest.mark.parametrize(
    ("header", "lines", "says"),
    [
        ("EPSG:32610", "", "no control points"),
        ("somewhere", LINES, "'somewhere' is no coordinate system"),
        ("EPSG:32610", "\n1 2 3 4 5", "line 2 is '1 2 3 4 5'"),
        ("EPSG:32610", "\n1 2 3 4 nan a.jpg", "line 2"),
    ],
)
def test_a_file_of_another_form_is_one_line(tmp_path: Path, header: str, lines: str, says: str) -> None:
    with pytest.raises(InputError) as refused:
        loaded(tmp_path, header, lines)
    assert says in str(refused.value)
    assert "gcp_list.txt" in str(refused.value)
    assert "\n" not in str(refused.value)
