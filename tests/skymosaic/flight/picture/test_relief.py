"""Meshes for the photographs of a flight over relief."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene import make_lawnmower
from skymosaic.common.errors import InputError
from skymosaic.compositing.mesh import Mesh
from skymosaic.flight.flight import Flight
from skymosaic.flight.mapping.place import sightings_of
from skymosaic.flight.picture import relief
from skymosaic.flight.picture.relief import bending_numbers, describe_bending, follow_relief
from skymosaic.geometry.homography import apply
from skymosaic.imagery.lens import Lens
from skymosaic.maps.control_points import ControlPoints, Sighting
from skymosaic.mosaicking.api import mosaic, open_run
from skymosaic.mosaicking.options import MosaicOptions

SIZE_PX = (480, 360)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terraces")
    for number, image in enumerate(make_lawnmower(7, 4, SIZE_PX, terrain="terraces").images):
        cv2.imwrite(str(folder / f"{number}.png"), image)
    return folder


@pytest.fixture(scope="module")
def flight(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    with open_run([folder], MosaicOptions(warp="homography", cache=tmp_path_factory.mktemp("cache"))) as run:
        return run.flight


def test_meshes_halve_the_errors(flight: Flight) -> None:
    bent = follow_relief(flight)
    before, after = flight.layouts[0], bent.layouts[0]
    assert after.bent is not None
    assert after.bent[1] > after.bent[0] + 0.05
    assert after.accuracy.whole.ninety_px < before.accuracy.whole.ninety_px / 2
    assert after.accuracy.whole.matches == before.accuracy.whole.matches
    assert after.median_error_px < before.median_error_px / 2
    assert after.transforms is before.transforms
    assert set(after.meshes) == set(after.members)


def test_photographs_bend_towards_those_before_them(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relief, "TOGETHER", 3)
    before, after = flight.layouts[0], follow_relief(flight).layouts[0]
    assert set(after.meshes) == set(before.members)
    last = {link.right: errors_px for link, errors_px in zip(after.links, after.errors_px, strict=True)}[3]
    assert np.median(last) < 0.5


def test_points_are_located_where_the_mosaic_shows_them(flight: Flight, folder: Path) -> None:
    made = mosaic([folder])
    off_px, flat_px = [], []
    for link in flight.layouts[0].links:
        (left, at_left), (right, at_right) = (link.left, link.left_relief), (link.right, link.right_relief)
        off_px += [*made.locate(left, at_left) - made.locate(right, at_right)]
        flat_px += [*apply(made.transforms[left], at_left) - apply(made.transforms[right], at_right)]
    assert np.median(np.linalg.norm(flat_px, axis=1)) > 3
    assert np.median(np.linalg.norm(off_px, axis=1)) < 1
    with pytest.raises(InputError, match="photograph 9 is not in the mosaic"):
        made.locate(9, np.zeros((1, 2)))


def test_what_a_mask_hides_stays_hidden_in_bent_photographs(folder: Path) -> None:
    hidden = np.s_[60:120, 200:280]
    mask = np.full(SIZE_PX[::-1], 255, np.uint8)
    mask[hidden] = 0
    photographs = [np.asarray(cv2.imread(str(path)), np.uint8) for path in sorted(folder.iterdir())]
    for photograph in photographs:
        photograph[hidden] = 255, 0, 255
    made = mosaic(photographs, lens=Lens(mask=mask))
    assert np.abs(made.layout.meshes[1].nodes_px).max() > 1
    blue, green, red = made.image.astype(int).transpose(2, 0, 1)
    assert np.count_nonzero(np.minimum(blue, red) - green > 100) == 0


def test_the_left_of_two_photographs_bends(folder: Path) -> None:
    two = sorted(folder.iterdir())[2:]
    made, plain = mosaic(two), mosaic(two, warp="homography")
    assert set(made.layout.meshes) == {0}
    assert np.abs(made.image.astype(int) - plain.image).mean() > 1
    assert np.array_equal(mosaic(two, repeat=made).image, made.image)


def test_the_report_has_the_meshes_and_what_they_gained(flight: Flight) -> None:
    bent = follow_relief(flight)
    layout = bent.layouts[0]
    gain = r"photographs are bent over relief: 9\d% of the held-out matches lie within 2 px, 8\d% without"
    assert re.fullmatch(gain, describe_bending(layout))
    numbers = json.loads(json.dumps(bending_numbers(bent, layout)))
    assert numbers["held_out_within_2_px"] == pytest.approx(layout.bent)
    mesh = numbers["meshes"]["2.png"]
    read = Mesh(tuple(mesh["size"]), np.array(mesh["nodes_px"]))
    points = np.array([[100.0, 50], [300, 200]])
    assert read.find(points) == pytest.approx(layout.meshes[2].find(points), abs=0.02)
    assert describe_bending(flight.layouts[0]) == ""
    assert bending_numbers(flight, flight.layouts[0]) is None


def test_a_control_point_is_sought_where_the_mesh_shows_it(flight: Flight) -> None:
    bent = follow_relief(flight)
    control = ControlPoints("gcp", "", np.zeros((1, 2)), ("1",), (Sighting(0, "2.png", 200.0, 150.0),))
    (_, _, plain), (view, _, moved) = (next(sightings_of(control, each, each.layouts[0])) for each in (flight, bent))
    assert plain == pytest.approx([200, 150])
    # Photographs of this size are their own working images.
    assert moved == pytest.approx(bent.layouts[0].meshes[view].find(np.array([[200.0, 150]]))[0], abs=1e-6)
    assert np.abs(moved - plain).max() > 0.1
