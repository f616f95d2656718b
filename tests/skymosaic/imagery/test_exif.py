from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from PIL.ExifTags import IFD, Base

from skymosaic.imagery import exif as read
from skymosaic.imagery.exif import Metadata, Position, describe_days, explain_missing_gps, on_globe, read_metadata

SOUTH_WEST = {1: "S", 2: (33.0, 30.0, 0.0), 3: "W", 4: (70.0, 15.0, 0.0)}


def metadata(folder: Path, *, gps: Any = (), camera: Any = (), model: Any = (), xmp: str | None = None) -> Metadata:
    """What is read of a picture with these tags, and with XMP of these properties of DJI."""
    exif = Image.Exif()
    exif.update(model)
    for directory, tags in ((IFD.GPSInfo, gps), (IFD.Exif, camera)):
        if tags:
            exif.get_ifd(directory).update(tags)
    about = f"<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:Description {xmp}></rdf:Description></x:xmpmeta>"
    added: dict[str, Any] = {} if xmp is None else {"xmp": about.encode()}
    Image.new("RGB", (64, 64)).save(folder / "a.jpg", exif=exif, **added)
    return read_metadata(folder / "a.jpg")


def test_gps_and_focal_length_are_read_from_exif(tmp_path: Path) -> None:
    gps = SOUTH_WEST | {2: (33.0, 30.0, 36.0), 5: b"\x00", 6: 520.5}
    record = metadata(tmp_path, gps=gps, camera={Base.FocalLengthIn35mmFilm: 24})
    assert record.focal_half_diagonals == pytest.approx(24 / 21.633, rel=1e-3)
    assert record.position.latitude_deg == pytest.approx(-33.51, abs=1e-8)
    assert record.position.longitude_deg == pytest.approx(-70.25)
    assert metadata(tmp_path) == Metadata()
    assert [read._position(SOUTH_WEST | {1: s, 2: (-33, 30, 0)})[0] for s in "SN"] == [Position(-33.5, -70.25), None]


@pytest.mark.parametrize(
    ("places", "known"),
    [
        ([(90, 180), (-90, -180), (0, 8.5), (46.5, 0)], True),
        ([(0, 0), (90.5, 8), (-90.5, 8), (46, 180.5), (46, -180.5), (np.nan, 8), (46, np.nan)], False),
    ],
)
def test_what_cameras_without_reception_write_is_no_place(places: list[tuple[float, float]], known: bool) -> None:
    assert [on_globe(*place) for place in places] == [Position(*place) if known else None for place in places]


@pytest.mark.parametrize(
    ("references", "expected"),
    [(("s", "w"), Position(-33.5, -70.25)), (("South\0", "E "), Position(-33.5, 70.25)), (("", "W"), None)],
)
def test_the_hemisphere_is_read_in_any_case_and_not_guessed(
    tmp_path: Path, references: tuple[str, str], expected: Position | None
) -> None:
    gps = SOUTH_WEST | {1: references[0], 3: references[1]}
    assert metadata(tmp_path, gps=gps).position == expected
    gps.pop(3)
    without = metadata(tmp_path, gps=gps)
    assert without == Metadata(gps_fault="without a hemisphere (N or S, E or W)")
    assert explain_missing_gps([without, Metadata(), without]) == (
        "0 of 3 photographs have GPS that can be used, but 2 have GPS without a hemisphere (N or S, E or W)"
    )
    assert explain_missing_gps([Metadata()]) == "0 of 1 photographs have GPS"


@pytest.mark.parametrize("missing", [2, 4])
def test_half_a_position_is_none(tmp_path: Path, missing: int) -> None:
    half = f'drone-dji:Gps{"Latitude" if missing == 4 else "Longitude"}="+7.5"'
    gps = {tag: value for tag, value in SOUTH_WEST.items() if tag != missing}
    assert metadata(tmp_path, gps=gps, xmp=half) == Metadata(gps_fault="without latitude and longitude")


NOWHERE = (TiffImagePlugin.IFDRational(0, 0),) * 3


@pytest.mark.parametrize(
    ("gps", "fault"),
    [
        ({0: b"\x02\x03\0\0", 18: "WGS-84"}, ""),
        ({6: 100.0, 7: (10.0, 20.0, 30.0)}, "without latitude and longitude"),
        (SOUTH_WEST | {2: NOWHERE, 4: NOWHERE}, "that is no position (latitude nan, longitude nan)"),
        (SOUTH_WEST | {18: "MARS"}, "in the datum 'MARS', which is not known; give `positions` in a system that is"),
    ],
)
def test_what_is_wrong_with_gps_is_said(tmp_path: Path, gps: Any, fault: str) -> None:
    assert metadata(tmp_path, gps=gps) == Metadata(gps_fault=fault)


@pytest.mark.parametrize(
    ("datum", "away_m"), [("WGS-84\0", (0, 0)), ("JGD2000", (0, 0)), ("TOKYO", (-293, 355)), ("tokyo ", (-293, 355))]
)
def test_the_datum_that_the_camera_names_counts(tmp_path: Path, datum: str, away_m: tuple[float, float]) -> None:
    gps = {1: "N", 2: (35.0, 40.0, 0.0), 3: "E", 4: (139.0, 45.0, 0.0), 18: datum}
    found = metadata(tmp_path, gps=gps).position
    assert found is not None
    assert found.metres_from(Position(35 + 40 / 60, 139.75)) == pytest.approx(away_m, abs=10)


@pytest.mark.parametrize(
    ("times", "days"),
    [
        (["2026-01-10 23:50:00", "", "2026-01-11 00:10:00"], ""),
        (["2026-06-12 07:00:00", "2026-06-12 19:00:00"], ""),
        (["2026-06-12 17:00:00", "2026-01-10 12:00:00", "2026-06-12 09:30:00"], "1 of 2026-01-10, 2 of 2026-06-12"),
    ],
)
def test_photographs_of_several_days_are_counted(times: list[str], days: str) -> None:
    described = describe_days([Metadata(time=time) for time in times])
    assert described.startswith(f"taken on 2 days ({days}): " if days else "")
    assert bool(described) == bool(days)


@pytest.mark.parametrize(
    ("xmp", "read"),
    [
        (
            'drone-dji:RelativeAltitude="+50.30" drone-dji:GimbalYawDegree="-12.5" drone-dji:FlightYawDegree="3"',
            Metadata(yaw_deg=-12.5, height_m=50.3),
        ),
        (
            "><drone-dji:RelativeAltitude>+50.30</drone-dji:RelativeAltitude><Camera:Yaw>-12.5</Camera:Yaw",
            Metadata(yaw_deg=-12.5, height_m=50.3),
        ),
        *(
            (f'drone-dji:GpsLatitude="-44.812345678" drone-dji:{name}="+7.5"', Metadata(Position(-44.812345678, 7.5)))
            for name in ("GpsLongitude", "GpsLongtitude")
        ),
        # The worse of its axes.
        ('drone-dji:RtkStdLon="0.020" drone-dji:RtkStdLat="0.012"', Metadata(accuracy_m=0.02)),
        ('drone-dji:RtkStdLon="0.020" drone-dji:RtkStdLat="0"', Metadata()),
    ],
)
def test_yaw_height_position_and_accuracy_are_read_from_xmp(tmp_path: Path, xmp: str, read: Metadata) -> None:
    assert metadata(tmp_path, gps={0: b"\x02\x03\0\0"}, xmp=xmp) == read


def test_the_black_level_of_a_sensor_is_read(tmp_path: Path) -> None:
    for name, levels in (("black.tif", (5132, 5132, 5141, 5151)), ("none.tif", (0, 5132, 5141, 5151))):
        tags = TiffImagePlugin.ImageFileDirectory_v2()
        tags[0xC61A] = levels
        tags.tagtype[0xC61A] = 3
        Image.fromarray(np.zeros((8, 8), np.uint16)).save(tmp_path / name, tiffinfo=tags)
    assert read_metadata(tmp_path / "black.tif").black_level == 5139
    assert read_metadata(tmp_path / "none.tif").black_level is None


def test_metres_between_positions() -> None:
    east, north = Position(46.0, -91.99).metres_from(Position(45.99, -92.0))
    assert north == pytest.approx(1112, rel=0.005)
    assert east == pytest.approx(1112 * np.cos(np.radians(46)), rel=0.005)
    # The shorter way, across the date line.
    assert Position(0, -179.99).metres_from(Position(0, 179.99)) == pytest.approx((2224, 0), rel=0.001)


@pytest.mark.parametrize(
    ("written", "read"),
    [
        (("DJI\0\0\0", "FC300S\0", "2016:06:23 16:31:59"), ("DJI FC300S", "2016-06-23 16:31:59")),
        (("SONY", "SONY ILCE-6000 ", "0000:00:00 00:00:00"), ("SONY ILCE-6000", "")),
        (("", "FC300S", "2026:02:30 10:20:30"), ("FC300S", "")),
        (("", "", "2026:05:01 10:20:30+02:00"), ("", "2026-05-01 10:20:30")),
        (("", "", "yesterday"), ("", "")),
    ],
)
def test_camera_and_time_are_read(tmp_path: Path, written: tuple[str, str, str], read: tuple[str, str]) -> None:
    make, model, time = written
    taken = metadata(tmp_path, model={Base.Make: make, Base.Model: model}, camera={Base.DateTimeOriginal: time})
    assert (taken.camera, taken.time) == read


FILM = np.hypot(36, 24) / 2


@pytest.mark.parametrize(
    ("changes", "focal_half_diagonals"),
    [
        # 8.8 mm over 4000 x 3000 pixels of 2.4 µm, in each unit.
        ({}, 8.8 / 0.0024 / 2500),
        ({Base.FocalPlaneXResolution: 25.4 / 0.0024, Base.FocalPlaneResolutionUnit: 2}, 8.8 / 0.0024 / 2500),
        ({Base.FocalPlaneXResolution: 25.4 / 0.0024, Base.FocalPlaneResolutionUnit: None}, 8.8 / 0.0024 / 2500),
        ({Base.FocalPlaneXResolution: 1 / 0.0024, Base.FocalPlaneResolutionUnit: 4}, 8.8 / 0.0024 / 2500),
        # Within a tenth, the length on film is rounded; farther off, the photograph was reduced.
        ({Base.FocalLengthIn35mmFilm: 30}, 8.8 / 0.0024 / 2500),
        ({Base.FocalLengthIn35mmFilm: 28}, 28 / FILM),
        ({Base.FocalLengthIn35mmFilm: 36}, 36 / FILM),
        ({Base.FocalLengthIn35mmFilm: 24, Base.FocalPlaneResolutionUnit: 1}, 24 / FILM),
        ({Base.FocalPlaneResolutionUnit: 1}, None),
        ({Base.ExifImageWidth: 0, Base.ExifImageHeight: 0}, None),
        ({Base.FocalLength: 0}, None),
        ({Base.FocalLength: 1.7}, None),
        ({Base.FocalLength: 130.0}, None),
    ],
)
def test_focal_lengths_come_from_pixels_or_from_film(
    tmp_path: Path, changes: dict[Base, float | None], focal_half_diagonals: float | None
) -> None:
    usual = {Base.FocalPlaneXResolution: 10 / 0.0024, Base.FocalPlaneResolutionUnit: 3, Base.FocalLength: 8.8}
    tags = usual | {Base.ExifImageWidth: 4000, Base.ExifImageHeight: 3000} | changes
    found = metadata(tmp_path, camera={tag: value for tag, value in tags.items() if value is not None})
    assert found.focal_half_diagonals == (
        None if focal_half_diagonals is None else pytest.approx(focal_half_diagonals, rel=1e-5)
    )
