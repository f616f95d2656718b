from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio

from sim.scene import make_lawnmower
from sim.scene.flight import Flight
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import Settings
from skymosaic.flight.mapping.cameras import Camera, cameras_of, measure_turn
from skymosaic.flight.mapping.place import place_cameras, place_on_map, require_place
from skymosaic.flight.picture.canvas import scale_for
from skymosaic.flight.picture.formats import OutputForm
from skymosaic.geometry.homography import apply
from skymosaic.imagery.exif import Metadata, Position
from skymosaic.imagery.lens import Lens
from skymosaic.maps.control_points import load_control_points
from skymosaic.maps.positions import load_positions
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from tests.skymosaic.flight import made

SIZE = (480, 360)
METRES, CORNER = 0.15, np.array([430_000.0, 5_190_000.0])


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_lawnmower(seed=5, images=4, size=SIZE, forward_overlap=0.6, side_overlap=0.4)


@pytest.mark.parametrize("beside_px", [None, (25.0, -10.0)])
def test_cameras_that_lean_are_found_above_where_they_were(
    flight: Flight, beside_px: tuple[float, float] | None
) -> None:
    half_diagonals, focal_px = flight.camera.focal_px / (np.hypot(*SIZE) / 2), flight.camera.focal_px
    # What a camera shows whose lens lies beside the middle is shifted.
    shift, lens = np.eye(3), Lens()
    if beside_px is not None:
        shift[:2, 2] = beside_px
        middle = shift @ [(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, 1]
        lens = Lens(SIZE, np.column_stack((np.diag([focal_px, focal_px, 0])[:, :2], middle)), np.zeros(5))
    views = made.views(4, SIZE, taken=Metadata(focal_half_diagonals=half_diagonals))
    to_ground = {m: np.asarray(np.linalg.inv(shift @ flight.homographies[m]), np.float64) for m in range(4)}
    leaning = made.flight(views, settings=Settings(made.CONFIG, lens=lens))
    found = np.array([camera.position for camera in cameras_of(leaning, Layout((0, 1, 2, 3), 0, to_ground))])
    np.testing.assert_allclose(found, [(p.x_px, p.y_px, p.altitude_px) for p in flight.poses], rtol=1e-6, atol=1e-3)
    middles = np.array([apply(to_ground[m], (np.array(SIZE) - 1) / 2) for m in to_ground])
    assert np.linalg.norm(middles - found[:, :2], axis=1).max() > 3


def test_control_points_put_a_mosaic_on_the_map_at_the_wanted_resolution(flight: Flight, tmp_path: Path) -> None:
    lines = ["EPSG:32615"]
    (tmp_path / "flight").mkdir()
    for index, image in enumerate(flight.images):
        cv2.imwrite(str(tmp_path / "flight" / f"{index}.png"), image)
        for pixel in ((60, 50), (400, 80), (230, 300)):
            east, north = CORNER + METRES * apply(
                np.asarray(np.linalg.inv(flight.homographies[index]), np.float64), pixel
            ) * [1, -1]
            # One point of each photograph shows how exact the map is; the others put the mosaic there.
            name = f"CHK-{index}" if pixel == (230, 300) else f"point{len(lines)}"
            lines.append(f"{east} {north} 0 {pixel[0]} {pixel[1]} {index}.png {name}")
    lines += [f"{lines[1].rsplit(maxsplit=2)[0]} {name}.png" for name in ("O", "0", "other/1")]
    (tmp_path / "gcp.txt").write_text("\n".join(lines))
    options = MosaicOptions(control_points=load_control_points(tmp_path / "gcp.txt"), gsd_m=0.4)
    form = OutputForm("jpeg", tmp_path / "tiles")
    notes: list[str] = []
    with open_run([tmp_path / "flight"], options, tell=notes.append) as run:
        (note,) = notes
        assert note.endswith("gcp.txt: no photograph is named O.png, other/1.png; these sightings are left out")
        (made,) = run.write(tmp_path / "m.tif", form)
        place = place_on_map(run.flight, run.layouts[0], options.control_points)
        for gsd_m in (1e3, 1e300):
            run.options = replace(options, gsd_m=gsd_m)
            with pytest.raises(InputError, match="smaller than a pixel; raise `scale` or `canvas_limit_px`, or lower"):
                run.composition(run.layouts[0])
        with pytest.raises(InputError, match="finer than the photographs"):
            scale_for(run.flight, run.layouts[0], place.georeference, 0.05)
        with pytest.raises(InputError, match="no place on the map"):
            scale_for(run.flight, run.layouts[0], None, 0.4)
    assert made.composition.place.by == "control points"
    assert made.georeference.residual_m < METRES
    assert len(made.composition.place.fitted_to) == 8
    assert list(made.composition.place.checked_m) == ["CHK-0", "CHK-1", "CHK-2", "CHK-3"]
    assert max(made.composition.place.checked_m.values()) < 2 * METRES
    middle = (np.array(SIZE) - 1) / 2
    for transform, homography in zip(made.composition.transforms, flight.homographies, strict=True):
        truth = CORNER + METRES * apply(np.asarray(np.linalg.inv(homography), np.float64), middle) * [1, -1]
        mapped = apply(np.asarray(made.georeference.to_map @ transform, np.float64), middle)
        assert np.allclose(mapped, truth, rtol=1e-7, atol=METRES)
    with rasterio.open(tmp_path / "m.tif") as file:
        assert (file.transform.a, file.transform.e) == pytest.approx((0.4, -0.4))
    assert (tmp_path / "tiles" / "index.html").exists()


def test_a_file_of_positions_puts_a_flight_without_gps_on_the_map(flight: Flight, tmp_path: Path) -> None:
    lines = ["EPSG:32615"]
    for index, (image, pose) in enumerate(zip(flight.images, flight.poses, strict=True)):
        cv2.imwrite(str(tmp_path / f"{index}.png"), image)
        east, north = CORNER + METRES * np.array([pose.x_px, -pose.y_px])
        lines.append(f"{index}.png {east} {north} 30 0 0 0 0.02 0.02")
    (tmp_path / "geo.txt").write_text("\n".join(lines))
    with open_run([tmp_path], MosaicOptions(positions=load_positions(tmp_path / "geo.txt"))) as run:
        layout = run.layouts[0]
        place = place_on_map(run.flight, layout)
    assert run.flight.views[0].taken.accuracy_m == 0.02
    assert place.georeference is not None
    assert place.georeference.metres_per_pixel == pytest.approx(METRES, rel=0.01)
    assert place.georeference.residual_m < 3 * METRES
    (tmp_path / "geo.txt").write_text("\n".join(lines[:3]))
    with (
        open_run([tmp_path], MosaicOptions(positions=load_positions(tmp_path / "geo.txt"))) as run,
        pytest.raises(RegistrationError, match=r"2 of 4 .* 3 are needed; .* nothing was written"),
    ):
        run.write(tmp_path / "m.tif", OutputForm(require_map=True))


def flown(folders: Sequence[str], *positions: Position) -> tuple[Any, Layout]:
    """Photographs of one name in several folders, side by side on the ground, each 100 px wide."""
    taken = map(Metadata, positions or (None,) * len(folders))
    views = [made.view(f"{each}/1.jpg", (100, 100), taken=how) for each, how in zip(folders, taken, strict=True)]
    return made.flight_along(views, [(100 * view, 0) for view in range(len(views))])


@pytest.mark.parametrize(
    ("gps", "zone", "held"), [("s", 15, True), ("s", 16, False), ("oss", 15, True), ("oos", 15, False)]
)
def test_control_points_of_another_site_are_refused_but_not_for_gps_off_the_map(
    tmp_path: Path, gps: str, zone: int, held: bool
) -> None:
    at = {"s": Position(45.1, -93.0), "o": Position(0.0, -2.0)}
    flight, layout = flown("abc"[: len(gps)], *map(at.__getitem__, gps))
    lines = [f"{500_000 + x} {5_000_000 - y} 0 {x} {y} a/1.jpg" for x, y in ((10, 10), (90, 20), (40, 80))]
    (tmp_path / "gcp.txt").write_text("\n".join([f"EPSG:326{zone}", *lines]))
    says = r"gcp.txt: its points lie \d+ km from the photographs' GPS; check the coordinate system"
    with nullcontext() if held else pytest.raises(InputError, match=says):
        assert place_on_map(flight, layout, load_control_points(tmp_path / "gcp.txt")).georeference is not None


def camera(number: int, x_px: float, y_px: float, position: Position | None, **recorded: Any) -> Camera:
    """A camera whose photograph lies so far from the first one's corner, with what it recorded."""
    to_reference = np.array([[1.0, 0, x_px], [0, 1, y_px], [0, 0, 1]])
    return Camera(f"{number}.jpg", SIZE, to_reference, Metadata(position, **recorded))


@pytest.mark.parametrize(("accuracy_m", "placed"), [(None, True), (0.2, True), (10.0, True), (0.02, False)])
def test_of_few_positions_two_may_be_off_by_what_they_are_exact_to(accuracy_m: float | None, placed: bool) -> None:
    places = [Position(45 + off_m / 111_132, 9 + n * 10 / 78_847) for n, off_m in enumerate((0.0, 0.9, 0.0, 0.9, 0.0))]
    place = place_cameras([camera(n, 100 * n, 0, each, accuracy_m=accuracy_m) for n, each in enumerate(places)])
    assert (place.georeference is not None) == placed
    if placed:
        assert not place.disagreeing
        return
    assert "2 of 5 positions, more than a third, disagree with the others, by 0.9 to 0.9 m; farthest off:" in place.note


def test_of_too_few_positions_it_is_said_that_others_are_none() -> None:
    positions = [Position(45.0, 8.0), Position(45.001, 8.0), None, None]
    cameras = [camera(0, 0, 0, each, gps_fault="" if each else "that is no position") for each in positions]
    assert place_cameras(cameras).note == ("2 of 4 photographs have GPS; 3 are needed; 2 have GPS that is no position")


def test_a_turn_is_measured_whatever_it_is() -> None:
    """A poor compass's directions lie on both sides of each that could be where degrees begin anew."""
    to_map, noise_deg = np.array([[1.0, 0, 500_000], [0, -1, 5_000_000], [0, 0, 1]]), np.array([-30.0, 1, 30])
    for turned_deg in range(-180, 180, 5):
        yaws_deg = ((180 - turned_deg - noise_deg) % 360 - 180).tolist()
        cameras = [camera(0, 0, 0, None, yaw_deg=yaw_deg) for yaw_deg in yaws_deg]
        found_deg = measure_turn(cameras, to_map, to_map[:2, 2], "EPSG:32615")
        assert found_deg is not None
        assert abs((found_deg - turned_deg + 180) % 360 - 180) == pytest.approx(1, abs=0.01)


def test_the_compass_shows_true_north_and_not_that_of_the_map() -> None:
    """At 69 degrees north and 2.5 degrees from the middle of its UTM zone, they are 2.3 degrees apart."""
    cameras = [
        camera(0, 1000 * x, -1000 * y, Position(69 + 100 * y / 111_570, 23.5 + 100 * x / 40_097), yaw_deg=0.0)
        for y in range(3)
        for x in range(3)
    ]
    assert place_cameras(cameras).turned_deg == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize(("off_m", "doubted", "refused"), [(0.1, False, False), (0.4, True, False), (1.0, True, True)])
def test_a_scale_that_few_positions_hardly_give_is_a_warning_or_no_required_map(
    off_m: float, doubted: bool, refused: bool
) -> None:
    places = [Position(45 + north_m / 111_132, 9 + n * 10 / 78_847) for n, north_m in enumerate((0.0, off_m, 0.0))]
    place = place_cameras([camera(n, 100 * n, 0, each) for n, each in enumerate(places)])
    assert place.georeference is not None
    assert [f"± {place.georeference.scale_error:.0%} only" in line for line in place.contradictions] == [True] * doubted
    with pytest.raises(RegistrationError, match=r"a required map needs 15%") if refused else nullcontext():
        require_place(Path("m.tif"), place)


@pytest.mark.parametrize(
    ("wrong", "contradicting", "strips", "ties", "broken"),
    [
        ({7: 40, 8: 40, 9: 40}, ((4, 6), (5, 7)), 1, 50, True),
        ({0: 40, 1: 40, 2: 40}, ((4, 6), (5, 7)), 1, 50, True),
        ({7: 40, 8: 55, 9: 70}, ((4, 6), (5, 7)), 2, 50, True),
        ({7: 40, 8: 40, 9: 40}, ((5, 7),), 1, 50, False),
        ({7: 40, 8: -90, 9: 70}, ((4, 6), (5, 7)), 1, 50, False),
        ({5: 40, 7: 40, 9: 40}, ((4, 6), (5, 7)), 1, 50, False),
        ({4: 40, 5: 40, 6: 40}, ((4, 6), (5, 7)), 1, 50, False),
        ({7: 40, 9: 40}, ((4, 6), (5, 7)), 1, 50, False),
        ({7: 40, 8: 40, 9: 40}, (), 0, 39, True),
        ({7: 40, 8: 40, 9: 40}, (), 0, 40, False),
    ],
)
def test_positions_that_agree_behind_a_joint_in_doubt_tell_that_the_layout_broke(
    wrong: dict[int, float], contradicting: tuple[tuple[int, int], ...], strips: int, ties: int, broken: bool
) -> None:
    """Two pairs hold across each place of a strip but its ends, or, of no strips, one. The second strip is whole."""
    metadata = [
        Metadata(Position(45 + (wrong.get(view, 0) - 30 * (view // 10)) / 111_132, 9 + view % 10 * 20 / 78_847))
        for view in range(20 if strips == 2 else 10)
    ]
    views = [made.view(f"{i}.jpg", SIZE, taken=each) for i, each in enumerate(metadata)]
    pairs = {(view, view + step) for view in range(9) for step in ((1, 2) if strips else (1,)) if view + step < 10}
    if strips:
        pairs = (pairs | {(view, view + 1) for view in range(10, len(views) - 1)}) - {(4, 6), (5, 7)}
    if strips == 2:
        pairs |= {(view, 10 + view) for view in range(6)}
    points = np.zeros((50, 2))
    tied = {each: points[: ties if each == (5, 6) else 50] for each in pairs}
    links = [Link(*each, some, some, 90, 50) for each, some in tied.items()]
    links += [Link(3, 6, points, points, 20, 50)] * bool(strips)
    against = tuple(Link(*each, points, points, 20, 20) for each in contradicting)
    steps = [(100.0 * (view % 10), 150.0 * (view // 10)) for view in range(len(views))]
    place = place_on_map(*made.flight_along(views, steps, links=tuple(links), contradicting=against))
    assert (place.georeference is None) == broken
    says = f"the layout breaks between 5.jpg and 6.jpg, where {len(contradicting)} of {2 * len(contradicting) or 1} "
    assert place.note.startswith(says) == broken
    assert broken == (not place.disagreeing)
