"""Control points and records that are wrong while a fit to them alone looks well, beside GPS that is right."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skymosaic.common.errors import InputError
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout
from skymosaic.flight.mapping.cameras import Camera, cameras_of
from skymosaic.flight.mapping.contradictions import compare_places
from skymosaic.flight.mapping.place import list_contradictions, place_cameras, place_on_map
from skymosaic.imagery.exif import Metadata, Position
from skymosaic.imagery.orientation import AXES, turn_pixels
from skymosaic.maps.control_points import load_control_points
from skymosaic.maps.georeference import Georeference, map_to_globe
from tests.skymosaic.flight import made

CORNER, METRES, SIZE = np.array([576_600.0, 5_188_200.0]), 0.1, (400, 300)
STEPS = [(150 * column, 120 * row) for row in range(3) for column in range(4)]
MIDDLE = CORNER + np.array([40, -28])
Change = Callable[[np.ndarray], np.ndarray]


def taken_above(x_px: float, y_px: float, **recorded: Any) -> Metadata:
    """What the camera above a place of the layout records."""
    ((longitude, latitude),) = map_to_globe(CORNER + METRES * np.array([[x_px, -y_px]]), "EPSG:32615")
    return Metadata(position=Position(latitude, longitude), **recorded)


EXACT = [taken_above(*(step + (np.array(SIZE) - 1) / 2)) for step in STEPS]


def unrolled(recorded: Sequence[Metadata] = EXACT, orientation: int = 1, **facts: Any) -> tuple[Flight, Layout]:
    """Twelve photographs in three strips, 0.1 m per pixel, with what their cameras recorded."""
    views = [made.view(f"{n}.jpg", SIZE, taken=each, orientation=orientation) for n, each in enumerate(recorded)]
    return made.flight_along(views, STEPS, **facts)


def write_control(path: Path, place: Change, pixel: Change, shift: int) -> Path:
    """Six points with their sightings, changed as a user's mistake would."""
    lines = ["EPSG:32615"]
    for point in ((200, 150), (520, 170), (760, 260), (230, 480), (560, 500), (800, 440)):
        east, north = place(CORNER + METRES * np.array([point[0], -point[1]]))
        for number, step in enumerate(STEPS):
            seen = np.subtract(point, step)
            if (seen >= 5).all() and (seen < np.array(SIZE) - 5).all():
                x_px, y_px = pixel(seen)
                lines.append(f"{east} {north} 0 {x_px} {y_px} {(number + shift) % len(STEPS)}.jpg")
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("orientation", range(2, 9))
@pytest.mark.parametrize("as_stored", [False, True])
def test_pixels_of_photographs_that_exif_turns_may_be_those_of_the_file(
    tmp_path: Path, orientation: int, *, as_stored: bool
) -> None:
    stored_size = SIZE if orientation < 5 else SIZE[::-1]
    upright = turn_pixels(np.arange(SIZE[0] * SIZE[1]).reshape(stored_size[::-1]), AXES[orientation])

    def click(seen: np.ndarray) -> np.ndarray:
        row, column = divmod(int(upright[int(seen[1]), int(seen[0])]), stored_size[0])
        return np.array([column, row]) if as_stored else seen

    write_control(tmp_path / "gcp.txt", same, click, 0)
    place = place_on_map(*unrolled(orientation=orientation), load_control_points(tmp_path / "gcp.txt"))
    assert place.georeference is not None
    assert place.georeference.residual_m < 1e-6
    assert ("as stored" in place.note) == as_stored


def same(values: np.ndarray) -> np.ndarray:
    return values


def with_positions(place: Change) -> tuple[Flight, Layout]:
    """The same flight with a file of positions, changed likewise."""
    given = []
    for recorded, (x_px, y_px) in zip(EXACT, STEPS, strict=True):
        east_north = place(CORNER + METRES * np.array([x_px, -y_px]) + METRES * np.array([199.5, -149.5]))
        ((longitude, latitude),) = map_to_globe(east_north[None], "EPSG:32615")
        given.append(replace(recorded, position=Position(latitude, longitude), own_position=recorded.position))
    return unrolled(given, positions="geo.txt")


@pytest.mark.parametrize(
    ("place", "found"),
    [
        (same, ""),
        (
            lambda at: at + np.array([15, 0]),
            r"^positions \(geo.txt\) and GPS contradict .* 15 m away; the map is by pos",
        ),
        (lambda at: MIDDLE + 2 * (at - MIDDLE), r"^refused: positions \(geo.txt\) and GPS .*0.2 and 0.1 m per pixel"),
    ],
    ids=["right", "15 m", "x 2"],
)
def test_a_file_of_positions_is_held_against_gps(place: Change, found: str) -> None:
    flight, layout = with_positions(place)
    try:
        at = place_on_map(flight, layout)
        result = "; ".join(at.contradictions)
        assert at.by == "positions"
    except InputError as error:
        result = f"refused: {error}"
    assert list_contradictions(flight) == ([result.removeprefix("refused: ")] if result else [])
    assert not result if not found else re.search(found, result), result


def test_positions_that_disagree_with_the_layout_are_named() -> None:
    mixed = [taken_above(*STEPS[other]) for other in np.random.default_rng(0).permutation(12)]
    (line,) = list_contradictions(unrolled(mixed)[0])
    assert re.match(r"no place on the map: positions and layout differ by .* farthest off: ", line)
    flight, layout = unrolled([Metadata()] * 12)
    assert list_contradictions(flight) == []
    assert place_on_map(flight, layout).note
    off = {2: 60, 7: 90}
    flight, layout = unrolled([taken_above(x + 199.5 + off.get(n, 0), y + 149.5) for n, (x, y) in enumerate(STEPS)])
    assert place_on_map(flight, layout).georeference is not None
    assert list_contradictions(flight) == ["a map is made without the GPS of 7.jpg (9 m off), 2.jpg (6 m off)"]


def on_map(scale: float, turn_deg: float = 0, away_m: float = 0, **exactness: float) -> Georeference:
    """Places turn clockwise about the origin of the layout, where they are moved east."""
    cos, sin = METRES * scale * np.cos(np.radians(turn_deg)), METRES * scale * np.sin(np.radians(turn_deg))
    to_map = np.array([[cos, -sin, CORNER[0] + away_m], [-sin, -cos, CORNER[1]], [0, 0, 1]])
    return Georeference("EPSG:32615", to_map, exactness.pop("residual_m", 0.0), **exactness)  # type: ignore[arg-type]


def test_sources_that_no_map_shows_together_are_refused_by_name() -> None:
    to_map = np.array([[METRES, 0, 500_000], [0, -METRES, 0], [0, 0, 1]])
    one, other = (Georeference(zone, to_map, 0.0) for zone in ("EPSG:32615", "EPSG:32631"))
    with pytest.raises(InputError, match=r"^positions \(a\.txt\) and GPS contradict each other: .* order of the axes"):
        compare_places(one, "positions (a.txt)", other, "GPS", np.array([(0.0, 0), (100, 100)]))


# In 95 % of cases, the second scale is right within 2 %: that is 1.146 degrees, too.
@pytest.mark.parametrize(
    ("other", "says"),
    [
        (on_map(np.exp(0.049), scale_error=0.02), ""),
        (on_map(np.exp(-0.049), scale_error=0.02), ""),
        (
            on_map(np.exp(0.051), scale_error=0.02),
            "0.1 and 0.105 m per pixel, 0 degrees apart, 0 m away; the map is by A",
        ),
        (on_map(1, 4.1, scale_error=0.02), ""),
        (on_map(1, -4.1, scale_error=0.02), ""),
        (on_map(1, 4.2, scale_error=0.02), "0.1 and 0.1 m per pixel, 4 degrees apart, 0 m away; the map is by A"),
        (on_map(1, 0, 12.9, scale_error=0.02, residual_m=3), ""),
        (on_map(1, 0, 13.1, scale_error=0.02, residual_m=3), "0 degrees apart, 13 m away; the map is by A"),
        (on_map(np.exp(0.41), scale_error=0.02), "; the map is by A: check names, pixels and coordinates"),
        (on_map(np.exp(0.43), scale_error=0.02), "; check names, pixels, coordinate system and order of the axes"),
        (on_map(1, 34, scale_error=0.02), "; the map is by A"),
        (on_map(1, -34.3, scale_error=0.02), "34 degrees apart, 0 m away; check names, pixels, coordinate system"),
        (on_map(1, 0, 999, scale_error=0.02), "; the map is by A"),
        (on_map(1, 0, 1001, scale_error=0.02), "1001 m away; check names, pixels, coordinate system"),
        # Of a fit to two positions, each may be 5 m off: over 100 m, a tenth.
        (on_map(np.exp(0.11)), ""),
        (on_map(np.exp(0.14)), "; the map is by A"),
    ],
)
def test_two_places_contradict_each_other_beyond_their_limits(other: Georeference, says: str) -> None:
    across_px = 999 / np.sqrt(2)
    places = np.array([(0, 0), (-across_px / 2, across_px / 2), (across_px / 2, -across_px / 2)])
    try:
        found = compare_places(on_map(1), "A", other, "B", places)
    except InputError as error:
        found = str(error)
        assert "the map is by" not in found
    assert says in found
    assert bool(found) == bool(says)
    assert not found or found.startswith("A and B contradict each other: 0.1 and ")


@pytest.mark.parametrize(
    ("place", "pixel", "shift", "found"),
    [
        (same, same, 0, ""),
        (lambda at: at + np.array([3, 0]), same, 0, ""),
        (same, lambda at: at * 0.8, 0, "0.108 and 0.1 m per pixel"),
        (lambda at: at + np.array([15, 0]), same, 0, "0.1 and 0.1 m per pixel, 0 degrees apart, 15 m away"),
        (same, same, 1, "positions and layout differ"),
        (lambda at: MIDDLE + 0.5 * (at - MIDDLE), same, 0, "refused: .*0.05 and 0.1 m per pixel"),
        (lambda at: MIDDLE + 20 * (at - MIDDLE), same, 0, "refused: .*2 and 0.1 m per pixel"),
        (lambda at: MIDDLE + (at - MIDDLE)[::-1] * [-1, 1], same, 0, "refused: .*90 degrees apart"),
        (lambda at: at + np.array([9000, 0]), same, 0, "refused: .*9000 m away"),
    ],
    ids=["right", "3 m", "reduced copies", "15 m", "names shifted", "half", "x 20", "turned", "9 km"],
)
def test_control_points_are_held_against_gps(
    tmp_path: Path, place: Change, pixel: Change, shift: int, found: str
) -> None:
    control = load_control_points(write_control(tmp_path / "gcp.txt", place, pixel, shift))
    try:
        result = "; ".join(place_on_map(*unrolled(), control).contradictions)
    except InputError as error:
        result = f"refused: {error}"
    assert not result if not found else re.search(found, result), result


def cameras(*, focal: float | None = 1.5, height_m: float | None = None, yaw_deg: float | None = None) -> list[Camera]:
    """Twelve cameras, all at one height, looking down, north up."""
    recorded = {"focal_half_diagonals": focal, "height_m": height_m, "yaw_deg": yaw_deg}
    flight, layout = unrolled([replace(each, **recorded) for each in EXACT])  # type: ignore[arg-type]
    return cameras_of(flight, layout)


@pytest.mark.parametrize(
    ("recorded", "found"),
    [
        # The true height is 1.5 half diagonals of 250 px, of 0.1 m each.
        ({"height_m": 60.0}, ""),
        ({"height_m": 90.0}, "flown at 38 m by positions and focal length, at 90 m by the recorded height"),
        ({"height_m": 5.0}, "flown at 38 m .* at 5 m"),
        ({"height_m": -5.0}, ""),
        ({"focal": None, "height_m": 60.0}, ""),
        ({"yaw_deg": 12.0}, ""),
        ({"yaw_deg": 180.0}, ""),
        ({"yaw_deg": -50.0}, "positions and recorded yaw contradict each other: 5[01] degrees apart; the map follows"),
    ],
)
def test_recorded_heights_and_yaw_are_held_against_gps(recorded: dict[str, Any], found: str) -> None:
    place = place_cameras(cameras(**recorded))
    result = "; ".join(place.contradictions)
    assert not result if not found else re.search(found, result), result


def test_without_a_focal_length_there_is_no_height() -> None:
    """It would be that of another camera: 19 m, where 30 m were recorded."""
    assert place_cameras(cameras(focal=None)).height_m is None
    assert place_cameras(cameras()).height_m == pytest.approx(37.5, rel=1e-3)
    one, *others = cameras()
    unknown = replace(one, taken=replace(one.taken, focal_half_diagonals=None))
    assert place_cameras([unknown, *others]).height_m is None
    # That of a camera file counts, whatever was recorded.
    measured = [replace(each, focal_half_diagonals=2.0) for each in (unknown, *others)]
    assert place_cameras(measured).height_m == pytest.approx(50, rel=1e-3)
