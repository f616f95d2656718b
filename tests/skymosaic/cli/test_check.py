"""The command that checks a flight takes what places a flight."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower
from skymosaic.cli.check import check
from skymosaic.cli.session import session
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.maps.control_points import load_control_points
from skymosaic.maps.georeference import map_to_globe
from skymosaic.maps.positions import load_positions
from skymosaic.mosaicking.options import SurveyOptions


def test_where_to_fly_again_is_written_for_a_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of three strips the middle photograph is missing, and another one shows nothing that the others do."""
    flight = make_lawnmower(seed=9, images=9, size=(320, 240), forward_overlap=0.25, side_overlap=0.25)
    (tmp_path / "flight").mkdir()
    middle, metres = np.mean([(pose.x_px, pose.y_px) for pose in flight.poses], axis=0), 0.1
    lines, points = ["EPSG:32632"], ["EPSG:32632"]
    for number, (image, pose) in enumerate(zip(flight.images, flight.poses, strict=True)):
        if number != 4:
            cv2.imwrite(str(tmp_path / "flight" / f"{number}.png"), image)
            east, north = (np.array([pose.x_px, pose.y_px]) - middle) * metres * [1, -1] + [500_000, 5_100_000]
            lines.append(f"{number}.png {east} {north}")
            points.append(f"{east + 60} {north} 0 159.5 119.5 {number}.png")
    cv2.imwrite(str(tmp_path / "flight" / "noise.png"), np.random.default_rng(0).integers(0, 256, (240, 320), np.uint8))
    lines.append("noise.png 500020 5100000")
    (tmp_path / "geo.txt").write_text("\n".join(lines))
    (tmp_path / "gcp.txt").write_text("\n".join(points))
    output = tmp_path / "again.geojson"
    photographs, options = [str(tmp_path / "flight")], SurveyOptions(cache=tmp_path / "cache")
    placed = replace(options, positions=load_positions(tmp_path / "geo.txt"))
    controlled = replace(placed, control_points=load_control_points(tmp_path / "gcp.txt"))
    with pytest.raises(RegistrationError, match="do not make one mosaic"):
        check(photographs=photographs, output=output, options=placed)
    assert [each["gps"] for each in session.numbers["photographs"]] == [True] * 9
    assert not any("contradict each other" in problem for problem in session.numbers["problems"])
    hole, *links, alone = json.loads(output.read_text())["features"]
    assert alone["properties"]["name"] == "left out noise.png"
    assert "nothing links it to the others" in alone["properties"]["reason"]
    # Photographs that overlap so little are linked by few matches.
    assert all(each["properties"]["name"].startswith("weak link") for each in links)
    assert hole["properties"]["name"] == "hole 1"
    # Half of the photograph, along and across, is in none of its neighbours; the ground there is 16 x 12 m.
    assert hole["properties"]["area_m2"] == pytest.approx(16 * 12, rel=0.15)
    longitude, latitude = np.mean(hole["geometry"]["coordinates"][0][:-1], axis=0)
    assert (longitude, latitude) == pytest.approx(map_to_globe(np.array([[500_000, 5_100_000]]), lines[0])[0], abs=3e-5)
    with pytest.raises(InputError, match=r"again\.geojson: exists"):
        check(photographs=photographs, output=output, options=options)
    with pytest.raises(InputError, match="no part of the flight has a place on the map"):
        check(photographs=photographs, output=output, overwrite=True, options=options)
    with pytest.raises(RegistrationError, match="do not make one mosaic"):
        check(photographs=photographs, options=controlled)
    (problem,) = (each for each in session.numbers["problems"] if "contradict each other" in each)
    both = f"control points ({tmp_path / 'gcp.txt'}) and positions ({tmp_path / 'geo.txt'})"
    assert problem.startswith(both)
    assert "0 degrees apart, 60 m away" in problem
    assert f"warning: {problem}\n" in capsys.readouterr().err
