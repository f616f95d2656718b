from pathlib import Path

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from PIL.ExifTags import IFD, Base

from skymosaic.imagery.exif import Metadata, Position, _on_globe, explain_missing_gps, read_metadata


def test_gps_and_focal_length_are_read_from_exif(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif)[0xA405] = 24
    exif.get_ifd(IFD.GPSInfo).update(
        {1: "S", 2: (33.0, 30.0, 36.0), 3: "W", 4: (70.0, 15.0, 0.0), 5: b"\x00", 6: 520.5}
    )
    Image.new("RGB", (64, 64)).save(tmp_path / "gps.jpg", exif=exif)
    record = read_metadata(tmp_path / "gps.jpg")
    assert record.focal_half_diagonals == pytest.approx(24 / 21.633, rel=1e-3)
    position = record.position
    assert position.latitude_deg == pytest.approx(-33.51, abs=1e-8)
    assert position.longitude_deg == pytest.approx(-70.25)
    Image.new("RGB", (64, 64)).save(tmp_path / "none.jpg")
    assert read_metadata(tmp_path / "none.jpg") == Metadata()


@pytest.mark.parametrize("place", [(90, 180), (-90, -180), (0, 8.5), (46.5, 0)])
def test_a_place_on_the_globe_is_one(place: tuple[float, float]) -> None:
    assert _on_globe(*place) == Position(*place)


@pytest.mark.parametrize("place", [(0, 0), (90.5, 8), (-90.5, 8), (46, 180.5), (46, -180.5), (np.nan, 8), (46, np.nan)])
def test_what_cameras_without_reception_write_is_no_place(place: tuple[float, float]) -> None:
    assert _on_globe(*place) is None


@pytest.mark.parametrize(
    ("references", "expected"),
    [(("s", "w"), Position(-33.5, -70.25)), (("South\0", "E "), Position(-33.5, 70.25)), (("", "W"), None)],
)
def test_the_hemisphere_is_read_in_any_case_and_not_guessed(
    tmp_path: Path, references: tuple[str, str], expected: Position | None
) -> None:
    exif = Image.Exif()
    exif.get_ifd(IFD.GPSInfo).update({1: references[0], 2: (33.0, 30.0, 0.0), 3: references[1], 4: (70.0, 15.0, 0.0)})
    Image.new("RGB", (64, 64)).save(tmp_path / "gps.jpg", exif=exif)
    assert read_metadata(tmp_path / "gps.jpg").position == expected
    exif.get_ifd(IFD.GPSInfo).pop(3)
    Image.new("RGB", (64, 64)).save(tmp_path / "gps.jpg", exif=exif)
    without = read_metadata(tmp_path / "gps.jpg")
    assert without == Metadata(gps_fault="without a hemisphere (N or S, E or W)")
    assert explain_missing_gps([without, Metadata(), without]) == (
        "0 of 3 photographs have GPS that can be used, but 2 have GPS without a hemisphere (N or S, E or W)"
    )
    assert explain_missing_gps([Metadata()]) == "0 of 1 photographs have GPS"


@pytest.mark.parametrize("missing", [2, 4])
def test_half_a_position_is_none(tmp_path: Path, missing: int) -> None:
    exif = Image.Exif()
    exif.get_ifd(IFD.GPSInfo).update({1: "S", 2: (33.0, 30.0, 0.0), 3: "W", 4: (70.0, 15.0, 0.0)})
    exif.get_ifd(IFD.GPSInfo).pop(missing)
    half = f'drone-dji:Gps{"Latitude" if missing == 4 else "Longitude"}="+7.5"'
    xmp = f"<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:Description {half}/></x:xmpmeta>"
    Image.new("RGB", (64, 64)).save(tmp_path / "half.jpg", xmp=xmp.encode(), exif=exif)
    assert read_metadata(tmp_path / "half.jpg") == Metadata()


@pytest.mark.parametrize(
    "properties",
    [
        'drone-dji:RelativeAltitude="+50.30" drone-dji:GimbalYawDegree="-12.5" drone-dji:FlightYawDegree="3"',
        "><drone-dji:RelativeAltitude>+50.30</drone-dji:RelativeAltitude><Camera:Yaw>-12.5</Camera:Yaw",
    ],
)
def test_yaw_and_height_are_read_from_xmp(tmp_path: Path, properties: str) -> None:
    xmp = f"<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:Description {properties}></rdf:Description></x:xmpmeta>"
    Image.new("RGB", (64, 64)).save(tmp_path / "dji.jpg", xmp=xmp.encode())
    assert read_metadata(tmp_path / "dji.jpg") == Metadata(yaw_deg=-12.5, height_m=50.3)


@pytest.mark.parametrize("longitude", ["GpsLongitude", "GpsLongtitude"])
def test_a_position_that_only_xmp_has_is_read(tmp_path: Path, longitude: str) -> None:
    properties = f'drone-dji:GpsLatitude="-44.812345678" drone-dji:{longitude}="+7.5"'
    xmp = f"<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:Description {properties}/></x:xmpmeta>"
    exif = Image.Exif()
    exif.get_ifd(IFD.GPSInfo)[0] = b"\x02\x03\0\0"
    Image.new("RGB", (64, 64)).save(tmp_path / "dji.jpg", xmp=xmp.encode(), exif=exif)
    assert read_metadata(tmp_path / "dji.jpg") == Metadata(Position(-44.812345678, 7.5))


def test_the_accuracy_of_rtk_is_the_worse_of_its_axes(tmp_path: Path) -> None:
    for stds, expected in (("0.012", 0.02), ("0", None)):
        properties = f'drone-dji:RtkStdLon="0.020" drone-dji:RtkStdLat="{stds}"'
        xmp = f"<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:Description {properties}/></x:xmpmeta>"
        Image.new("RGB", (64, 64)).save(tmp_path / "rtk.jpg", xmp=xmp.encode())
        assert read_metadata(tmp_path / "rtk.jpg").accuracy_m == expected


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
    exif = Image.Exif()
    exif[Base.Make], exif[Base.Model], exif.get_ifd(IFD.Exif)[Base.DateTimeOriginal] = written
    Image.new("RGB", (64, 64)).save(tmp_path / "a.jpg", exif=exif)
    taken = read_metadata(tmp_path / "a.jpg")
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
    exif = Image.Exif()
    usual = {Base.FocalPlaneXResolution: 10 / 0.0024, Base.FocalPlaneResolutionUnit: 3, Base.FocalLength: 8.8}
    for tag, value in (usual | {Base.ExifImageWidth: 4000, Base.ExifImageHeight: 3000} | changes).items():
        if value is not None:
            exif.get_ifd(IFD.Exif)[tag] = value
    Image.new("RGB", (64, 64)).save(tmp_path / "a.jpg", exif=exif)
    found = read_metadata(tmp_path / "a.jpg").focal_half_diagonals
    assert found == (None if focal_half_diagonals is None else pytest.approx(focal_half_diagonals, rel=1e-5))
