import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage
from PIL.ExifTags import Base

from skymosaic.common.errors import InputError
from skymosaic.imagery.depth import ValueRange
from skymosaic.imagery.lens import Lens, lens_of, load_lens
from skymosaic.imagery.orientation import AXES, turn_pixels
from skymosaic.imagery.photographs import Source
from skymosaic.mosaicking.api import mosaic
from skymosaic.mosaicking.options import MosaicOptions

CAMERA = """width_px = 640
height_px = 480
focal_x_px = 500
focal_y_px = 495
centre_x_px = 319.5
centre_y_px = 236
k1 = -0.2
"""


def test_a_camera_takes_the_distortion_out(tmp_path: Path) -> None:
    # Windows' editors begin a file with a mark.
    (tmp_path / "camera.toml").write_text(CAMERA, encoding="utf-8-sig")
    lens = load_lens(tmp_path / "camera.toml", None)
    # Points of a straight line, distorted as the camera would, end on a line again.
    line = np.column_stack([np.linspace(60, 580, 14), np.full(14, 90.0)])
    rays = np.column_stack([(line - [319.5, 236]) / [500, 495], np.ones(14)])
    distorted, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)
    picture = np.zeros((480, 640), np.uint8)
    for x, y in distorted[:, 0]:
        cv2.circle(picture, (round(x * 16), round(y * 16)), 3 << 4, 255, -1, cv2.LINE_AA, 4)
    straight = lens.straighten(picture)
    assert np.ptp(distorted[:, 0, 1]) > 4
    for x, y in line:
        patch = straight[round(y) - 6 : round(y) + 7, round(x) - 6 : round(x) + 7].astype(float)
        rows, columns = np.mgrid[-6:7, -6:7]
        centre = np.array([(patch * columns).sum(), (patch * rows).sum()]) / patch.sum() + np.rint([x, y])
        np.testing.assert_allclose(centre, [x, y], atol=0.3)


def test_ground_is_where_the_lens_and_the_mask_of_the_photograph_both_show_it(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text(CAMERA)
    own = np.full((24, 32), 255, np.uint8)
    own[:6] = 0
    own[12, 16] = 254
    by_lens = np.asarray(load_lens(tmp_path / "camera.toml", None).visible_mask((640, 480)))
    both = load_lens(tmp_path / "camera.toml", None).visible_mask((640, 480), own)
    alone = Lens().visible_mask((640, 480), own)
    for mask, ground in ((alone, 255), (both, by_lens)):
        expected = np.broadcast_to(ground, (480, 640)).copy()
        expected[:120] = expected[240:260, 320:340] = 0
        np.testing.assert_array_equal(mask, expected)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (CAMERA.replace("k1", "q1"), "unknown key q1"),
        (CAMERA.replace("focal_x_px = 500\n", ""), "focal_x_px missing"),
        (CAMERA.replace("500", "'long'"), "focal_x_px is 'long'; it must be a number"),
        (CAMERA.replace("-0.2", "true"), "k1 is True; it must be a number"),
        (CAMERA.replace("-0.2", "-inf"), "k1 is -inf; it must be a number"),
        (CAMERA.replace("-0.2", "1e9"), r"k1 is 1000000000\.0; it must be a number"),
        (CAMERA.replace("width_px = 640", "width_px = 0"), "must be positive"),
        ("width_px =", "not valid TOML"),
    ],
)
def test_bad_camera_files_are_one_line(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "camera.toml").write_text(text)
    with pytest.raises(InputError, match=says):
        load_lens(tmp_path / "camera.toml", None)


@pytest.mark.parametrize("orientation", range(2, 9))
@pytest.mark.parametrize("deep", [False, True])
def test_a_photograph_turned_by_exif_has_the_lens_turned(tmp_path: Path, orientation: int, deep: bool) -> None:
    lens = lens_of(tomllib.loads(CAMERA) | {"centre_x_px": 360, "p1": 0.01, "p2": -0.02})
    noise = np.random.default_rng(1).integers(0, 256, (480, 640), dtype=np.uint8)
    stored = cv2.GaussianBlur(noise, (0, 0), 3).astype(np.uint16 if deep else np.uint8)
    exif = PillowImage.Exif()
    exif[Base.Orientation] = orientation
    PillowImage.fromarray(stored).save(tmp_path / "a.tif", exif=exif)
    expected = turn_pixels(lens.straighten(stored), AXES[orientation])
    values = ValueRange(0, 255, deep=deep)
    shown = Source(0, "a", tmp_path / "a.tif").read_photograph(lens, values).pixels
    np.testing.assert_allclose(shown.astype(int), expected, atol=1)
    if not deep:
        photograph = Source(0, "a", tmp_path / "a.tif").read_photograph(lens)
        np.testing.assert_allclose(photograph.pixels.astype(int), expected, atol=1)
        assert photograph.orientation == orientation
    turned, size = lens.turned(orientation), (expected.shape[1], expected.shape[0])
    visible: Any = lens.visible_mask((640, 480))
    assert np.mean(turned.visible_mask(size) != turn_pixels(visible, AXES[orientation])) < 1e-3
    # A camera file may be of upright photographs, which is seen where their sides have changed places.
    camera: Any = turned.camera_at(size)
    upright = Lens(size, *camera)
    assert upright.turned_back(orientation).numbers == pytest.approx(lens.numbers)
    if size != (640, 480):
        again: Any = upright.turned(orientation).camera_at(size)
        np.testing.assert_array_equal(again[0], camera[0])


def test_photographs_of_another_shape_are_of_another_camera(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text(CAMERA)
    lens = load_lens(tmp_path / "camera.toml", None)
    assert lens.numbers == tomllib.loads(CAMERA)
    for size in ((640, 480), (480, 640), (64, 48)):
        lens.check(size, "a.png")
    Lens().check((360, 640), "a.png")
    picture = np.random.default_rng(1).integers(0, 256, (360, 640), dtype=np.uint8)
    np.testing.assert_array_equal(lens.straighten(picture), picture)
    cv2.imwrite(str(tmp_path / "wide.png"), picture)
    with pytest.raises(InputError, match=r"wide.png: 640x360 px, and the camera file is for 640x480 px"):
        mosaic([tmp_path / "wide.png"] * 2, MosaicOptions(lens=lens))


@pytest.mark.parametrize("size", [(225, 400), (400, 400), (400, 235)])
def test_a_mask_of_another_shape_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    lens = Lens(mask=np.full((225, 400), 255, np.uint8))
    # A mask from a report has the size of a thumbnail.
    for same in ((400, 225), (4000, 2250), (320, 179)):
        lens.check(same, "a.png")
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros(size[::-1], np.uint8))
    with pytest.raises(InputError, match=rf"a\.png: {size[0]}x{size[1]} px, and the mask has 400x225 px, which is"):
        mosaic([tmp_path / "a.png"] * 2, lens=lens)


def test_a_mask_shows_ground_where_any_channel_is_bright(tmp_path: Path) -> None:
    gray = np.repeat(np.array([[127, 128]], np.uint8), 64, axis=1).repeat(64, axis=0)
    for name, pixels in (("gray.png", gray), ("blue.png", np.dstack([gray, gray * 0, gray * 0]))):
        cv2.imwrite(str(tmp_path / name), pixels)
        np.testing.assert_array_equal(load_lens(None, tmp_path / name).mask, np.where(gray == 128, 255, 0))
    cv2.imwrite(str(tmp_path / "dark.png"), gray - 1)
    with pytest.raises(InputError, match=r"dark\.png: the mask is black everywhere; paint white"):
        load_lens(None, tmp_path / "dark.png")
