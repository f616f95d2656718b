import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from PIL.ExifTags import IFD

from golden_model.config import preset_config
from sim.scene import make_pair
from skymosaic import temporary
from skymosaic.errors import InputError
from skymosaic.flight.cache import ResultCache, key_of
from skymosaic.flight.linking.view import Settings, View, describe
from skymosaic.imagery.exif import Metadata, Position, read_metadata
from skymosaic.imagery.lens import Lens, load_lens
from skymosaic.imagery.own_outputs import record_output
from skymosaic.imagery.photographs import DecodedPhotographs, Source, list_sources


def test_a_folder_gives_its_pictures_by_number(tmp_path):
    for name in ("IMG_10.png", "IMG_2.png", "notes.txt", ".IMG_3.png"):
        (tmp_path / name).write_bytes(b"x")
    found = list_sources([tmp_path, np.zeros((64, 64), np.uint8)])
    assert [source.name.rsplit("/")[-1] for source in found] == ["IMG_2.png", "IMG_10.png", "image 2"]
    assert [source.index for source in found] == [0, 1, 2]


def test_an_empty_folder_is_one_line(tmp_path):
    with pytest.raises(InputError, match="contains no pictures"):
        list_sources([tmp_path])


def test_digests_depend_on_the_content_alone(tmp_path):
    for name, data in (("a.png", b"one"), ("b.png", b"one"), ("c.png", b"two")):
        (tmp_path / name).write_bytes(data)
    a, b, c = list_sources([tmp_path])
    assert a.digest == b.digest != c.digest


def test_decoded_photographs_stay_below_their_limit(tmp_path):
    held = [Source(index, f"image {index}", np.full((64, 64), index, np.uint8)) for index in range(5)]
    photographs = DecodedPhotographs(3 * 64 * 64)
    first = photographs.pixels(held[0], Lens())
    assert photographs.pixels(held[0], Lens()) is first
    for source in held[1:]:
        assert np.all(photographs.pixels(source, Lens()) == source.index)
    assert photographs.size_bytes <= 3 * 64 * 64


def test_gps_and_focal_length_are_read_from_exif(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif)[0xA405] = 24
    exif.get_ifd(IFD.GPSInfo).update(
        {1: "S", 2: (33.0, 30.0, 36.0), 3: "W", 4: (70.0, 15.0, 0.0), 5: b"\x00", 6: 520.5}
    )
    Image.new("RGB", (64, 64)).save(tmp_path / "gps.jpg", exif=exif)
    record = read_metadata(tmp_path / "gps.jpg")
    assert record.focal_half_diagonals == pytest.approx(24 / 21.633, rel=1e-3)
    found = record.position
    assert found.latitude_deg == pytest.approx(-33.51)
    assert found.longitude_deg == pytest.approx(-70.25)
    Image.new("RGB", (64, 64)).save(tmp_path / "none.jpg")
    assert read_metadata(tmp_path / "none.jpg") == Metadata()


@pytest.mark.parametrize(
    "properties",
    [
        'drone-dji:RelativeAltitude="+50.30" drone-dji:GimbalYawDegree="-12.5" drone-dji:FlightYawDegree="3"',
        "><drone-dji:RelativeAltitude>+50.30</drone-dji:RelativeAltitude><Camera:Yaw>-12.5</Camera:Yaw",
    ],
)
def test_yaw_and_height_are_read_from_xmp(tmp_path, properties):
    xmp = f"<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:Description {properties}></rdf:Description></x:xmpmeta>"
    Image.new("RGB", (64, 64)).save(tmp_path / "dji.jpg", xmp=xmp.encode())
    assert read_metadata(tmp_path / "dji.jpg") == Metadata(yaw_deg=-12.5, height_m=50.3)


def test_the_black_level_of_a_sensor_is_read(tmp_path):
    for name, levels in (("black.tif", (5132, 5132, 5141, 5151)), ("none.tif", (0, 0, 0, 0))):
        tags = TiffImagePlugin.ImageFileDirectory_v2()
        tags[0xC61A] = levels
        tags.tagtype[0xC61A] = 3
        Image.fromarray(np.zeros((8, 8), np.uint16)).save(tmp_path / name, tiffinfo=tags)
    assert read_metadata(tmp_path / "black.tif").black_level == 5139
    assert read_metadata(tmp_path / "none.tif").black_level is None


def test_metres_between_positions():
    east, north = Position(46.0, -91.99).metres_from(Position(45.99, -92.0))
    assert north == pytest.approx(1112, rel=0.005)
    assert east == pytest.approx(1112 * np.cos(np.radians(46)), rel=0.005)


CAMERA = """width_px = 640
height_px = 480
focal_x_px = 500
focal_y_px = 500
centre_x_px = 319.5
centre_y_px = 239.5
k1 = -0.2
"""


def test_a_camera_takes_the_distortion_out(tmp_path):
    (tmp_path / "camera.toml").write_text(CAMERA)
    lens = load_lens(tmp_path / "camera.toml", None)
    # Points of a straight line, distorted as the camera would, end on a line again.
    line = np.column_stack([np.linspace(60, 580, 14), np.full(14, 90.0)])
    rays = np.column_stack([(line - [319.5, 239.5]) / 500, np.ones(14)])
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)
    picture = np.zeros((480, 640), np.uint8)
    for x, y in seen[:, 0]:
        cv2.circle(picture, (round(x * 16), round(y * 16)), 3 << 4, 255, -1, cv2.LINE_AA, 4)
    straight = lens.straighten(picture)
    assert np.ptp(seen[:, 0, 1]) > 4
    for x, y in line:
        patch = straight[round(y) - 6 : round(y) + 7, round(x) - 6 : round(x) + 7].astype(float)
        rows, columns = np.mgrid[-6:7, -6:7]
        centre = np.array([(patch * columns).sum(), (patch * rows).sum()]) / patch.sum() + np.rint([x, y])
        np.testing.assert_allclose(centre, [x, y], atol=0.3)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (CAMERA.replace("k1", "q1"), "unknown key q1"),
        (CAMERA.replace("focal_x_px = 500\n", ""), "focal_x_px missing"),
        (CAMERA.replace("500", "'long'"), "must be a number"),
        (CAMERA.replace("width_px = 640", "width_px = 0"), "must be positive"),
        ("width_px =", "not valid TOML"),
    ],
)
def test_bad_camera_files_are_one_line(tmp_path, text, says):
    (tmp_path / "camera.toml").write_text(text)
    with pytest.raises(InputError, match=says):
        load_lens(tmp_path / "camera.toml", None)


def test_masked_places_have_no_features(tmp_path):
    mask = np.full((480, 640), 255, np.uint8)
    mask[300:] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    lens = load_lens(None, tmp_path / "mask.png")
    image = make_pair(seed=1).images[0]
    source = Source(0, "image", image)
    free = describe(source, Settings(preset_config("aerial")))
    masked = describe(source, Settings(preset_config("aerial"), lens=lens))
    assert len(masked.features) < len(free.features)
    assert masked.points[:, 1].max() < 300
    assert free.points[:, 1].max() > 400
    assert masked.key != free.key


def test_a_view_survives_the_cache(tmp_path):
    cache = ResultCache(tmp_path / "cache")
    source = Source(0, "image", make_pair(seed=1).images[0])
    view = describe(source, Settings(preset_config("aerial")))
    assert cache.load(view.key) is None
    cache.save(view.key, view.pack())
    again = View.unpack(cache.load(view.key), "renamed", view.key)
    np.testing.assert_array_equal(again.features, view.features)
    np.testing.assert_array_equal(again.thumbnail, view.thumbnail)
    assert again.features.dtype == view.features.dtype
    assert (again.size, again.sharpness, again.gps) == (view.size, view.sharpness, view.gps)
    assert again.name == "renamed"


def test_a_damaged_cache_file_counts_as_missing(tmp_path):
    cache = ResultCache(tmp_path)
    cache.save("key", {"values": np.arange(1000)})
    path = tmp_path / "key.entry"
    whole = path.read_bytes()
    for damaged in (b"", whole[:200], whole[:2000] + b"\xff" + whole[2001:], whole + b"more"):
        path.write_bytes(damaged)
        assert cache.load("key") is None
    (tmp_path / "other.entry").write_bytes(whole)
    assert cache.load("other") is None
    cache.save("key", {"values": np.arange(1000)})
    np.testing.assert_array_equal(cache.load("key")["values"], np.arange(1000))


def test_a_cache_that_cannot_be_written_keeps_nothing(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    lines = []
    cache = ResultCache(tmp_path / "file" / "cache", tell=lines.append)
    cache.save("key", {"values": np.arange(3)})
    assert cache.load("key") is None
    with pytest.raises(InputError, match="choose another cache"):
        ResultCache(tmp_path / "file" / "cache", required=True)

    def full(_path, _data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    cache = ResultCache(tmp_path / "cache", required=True, tell=lines.append)
    cache.save("key", {"values": np.arange(3)})
    cache.save("other", {"values": np.arange(3)})
    assert len(lines) == 2
    assert "No space left" in lines[1]


def test_left_overs_of_killed_processes_are_removed(tmp_path):
    machine = temporary_name(tmp_path).rsplit("-", 2)[0]
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for name in (f"{machine}-{ended.pid}-x", f"{machine}-{os.getpid()}-y", f".skymosaic-elsewhere-{ended.pid}-z"):
        (tmp_path / name).touch()
    temporary.remove_left_overs.cache_clear()
    with temporary.temporary_file(tmp_path):
        pass
    assert sorted(path.name.rsplit("-")[-1] for path in tmp_path.iterdir()) == ["y", "z"]


def temporary_name(folder):
    with temporary.temporary_file(folder) as path:
        return path.name


def test_keys_change_with_every_part():
    assert key_of("view", 1, "a") == key_of("view", 1, "a")
    assert len({key_of("view", 1, "a"), key_of("view", 1, "b"), key_of("view", "1", "a")}) == 3


def test_a_folder_does_not_give_an_earlier_mosaic(tmp_path):
    for name in ("IMG_1.png", "IMG_2.png", "mosaic.png"):
        (tmp_path / name).write_bytes(name.encode())
    record_output(tmp_path / "mosaic.png", [tmp_path / "IMG_1.png"])
    assert [source.name.rsplit("/")[-1] for source in list_sources([tmp_path])] == ["IMG_1.png", "IMG_2.png"]
    (tmp_path / "mosaic.png").write_bytes(b"a photograph of that name")
    assert len(list_sources([tmp_path])) == 3


def test_other_folders_of_outputs_stay_as_they_are(tmp_path):
    (tmp_path / "mosaic.png").write_bytes(b"x")
    record_output(tmp_path / "mosaic.png", [tmp_path / "photographs" / "IMG_1.png"])
    assert [path.name for path in tmp_path.iterdir()] == ["mosaic.png"]


def test_an_unreadable_folder_is_one_line(tmp_path, monkeypatch):
    def refuse(_path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        list_sources([tmp_path])


@pytest.mark.parametrize(("size", "width_px"), [((700, 16000), 1280), ((300, 400), 64)])
def test_a_photograph_that_cannot_be_reduced_is_named(size, width_px):
    source = Source(0, "pano", np.zeros(size, np.uint8))
    with pytest.raises(InputError, match=r"pano: .* is reduced to"):
        describe(source, Settings(preset_config("aerial"), working_width_px=width_px))


def test_a_tall_photograph_can_be_described():
    rng = np.random.default_rng(1)
    source = Source(0, "tall", rng.integers(0, 256, (4200, 500), dtype=np.uint8))
    assert describe(source, Settings(preset_config("aerial"))).working_size == (305, 2560)


def test_a_flight_leaves_a_damaged_photograph_out_unless_it_is_kept(tmp_path):
    data = bytearray(cv2.imencode(".jpg", make_pair(seed=1).images[0])[1].tobytes())
    data[len(data) // 2 : len(data) // 2 + 400] = bytes(400)
    (tmp_path / "damaged.jpg").write_bytes(data)
    (source,) = list_sources([tmp_path])
    settings = Settings(preset_config("aerial"))
    with pytest.raises(InputError, match=r"damaged\.jpg: the JPEG is damaged"):
        describe(source, settings)
    kept = dataclasses.replace(source, keep_damaged=True)
    assert settings.key(kept) != settings.key(source)
    assert "kept although" in describe(kept, settings).notes[0]
