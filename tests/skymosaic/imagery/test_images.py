import contextlib
import errno
import os
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage
from PIL import ImageCms

from golden_model.config import MIN_FRAME_PX
from skymosaic.common.errors import AppearedError, InputError
from skymosaic.imagery import images
from skymosaic.imagery.depth import ValueRange


def photograph(height: int = 96, width: int = 128) -> np.ndarray:
    rng = np.random.default_rng(7)
    return cv2.GaussianBlur(rng.integers(0, 256, (height, width, 3), dtype=np.uint8), (0, 0), 2)


@pytest.mark.parametrize("kind", ["alpha.png", "alpha.tif", "palette.png"])
def test_what_is_transparent_is_no_ground(tmp_path: Path, kind: str) -> None:
    half = np.dstack((np.full((80, 80, 3), 90, np.uint8), np.tile([[0], [255]], (40, 80)).astype(np.uint8)))
    picture = PillowImage.fromarray(half)
    path = tmp_path / kind
    (picture.quantize(8) if kind == "palette.png" else picture).save(path)
    photograph = images.load(path)
    assert photograph.notes == ("50.0% has no data or is transparent, and no ground",)
    assert photograph.visible is not None
    np.testing.assert_array_equal(photograph.visible, half[..., 3])
    picture.convert("RGB").save(path)
    assert images.load(path).notes == ()


def test_reduced_keeps_pixel_centres() -> None:
    wide = np.zeros((600, 2000), np.uint8)
    small, to_original = images.reduce_to_width(wide, 1000)
    assert small.shape == (300, 1000)
    assert np.allclose(to_original @ [0, 0, 1], [0.5, 0.5, 1])
    assert np.allclose(to_original @ [999, 299, 1], [1998.5, 598.5, 1])


def test_nothing_half_written_is_left_where_writing_fails(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be stored"):
        images.save(tmp_path / "wide.jpg", np.zeros((1, 70_000), np.uint8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "writable", "fault"),
    [
        ("m.xyz", True, "m.xyz: unknown kind of file; end the name in one of .png, .jpg, .jpeg, .tif, "),
        ("missing/m.png", True, "missing/m.png: its folder does not exist; create it first"),
        ("folder.png", True, "folder.png: cannot be written; choose another folder"),
        ("m.png", False, "m.png: cannot be written; choose another folder"),
        ("m.PNG", True, ""),
    ],
)
def test_an_unwritable_output_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, *, writable: bool, fault: str
) -> None:
    (tmp_path / "folder.png").mkdir()
    monkeypatch.setattr(os, "access", lambda *_: writable)
    with pytest.raises(InputError, match=fault) if fault else contextlib.nullcontext():
        images.check_output(tmp_path / name, suffixes=images.PICTURE_SUFFIXES)


@pytest.mark.parametrize(
    ("name", "writable", "fault"),
    [
        ("file", True, "file: is no folder; name another"),
        ("file/a/b", True, "file/a/b: cannot be made in .*/file; choose another folder"),
        ("a/b", False, "a/b: cannot be made in .*; choose another folder"),
        ("there", False, "there: cannot be made in .*/there; choose another folder"),
        ("there", True, ""),
        ("a/b", True, ""),
    ],
)
def test_an_unwritable_folder_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, *, writable: bool, fault: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "there").mkdir()
    monkeypatch.setattr(os, "access", lambda *_: writable)
    with pytest.raises(InputError, match=fault) if fault else contextlib.nullcontext():
        images.check_output_folder(tmp_path / name)


def test_an_output_replaces_neither_inputs_nor_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one of the inputs"):
        images.check_output(tmp_path / "a.png", [tmp_path / "a.png"])
    (tmp_path / "m.png").touch()
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"m\.png: exists; choose another name"):
        images.check_unused(tmp_path / "m.png", overwrite=False)
    with pytest.raises(InputError, match=r": is a folder with files in it; choose another name"):
        images.check_unused(tmp_path, overwrite=False)
    images.check_unused(tmp_path, overwrite=True)
    images.check_unused(tmp_path / "empty", overwrite=False)


@pytest.mark.parametrize("linking", [True, False])
def test_a_file_that_appears_during_the_run_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, linking: bool
) -> None:
    def refuse_to_link(*_: Path) -> None:
        raise OSError(errno.EPERM, "no hard links")

    if not linking:
        monkeypatch.setattr(os, "link", refuse_to_link)
    monkeypatch.chdir(tmp_path)
    path, other = tmp_path / "m.png", b"another run's"
    images.check_output(Path("m.png"))
    path.write_bytes(other)
    with pytest.raises(AppearedError, match=r"m\.png: has appeared since this run began, and stays; choose another"):
        images.save_bytes(path, b"ours")
    assert (path.read_bytes(), [*tmp_path.iterdir()]) == (other, [path])
    images.check_output(path, overwrite=True)
    images.save_bytes(path, b"ours")
    assert path.read_bytes() == b"ours"
    path.unlink()
    # What is ours may change.
    images.check_output(path)
    for data in (b"first", b"second"):
        images.save_bytes(path, data)
        assert (path.read_bytes(), [*tmp_path.iterdir()]) == (data, [path])


def test_a_tall_image_is_reduced_by_its_height_and_one_too_narrow_is_named() -> None:
    small, to_original = images.reduce_to_width(np.zeros((4200, 500), np.uint8), 1280)
    assert small.shape == (2560, 305)
    assert np.allclose(to_original[1] @ [0, 2559.5, 1], 4199.5)
    for shape, reduced in (((3, 20_000), (1, 1000)), ((20_000, 3), (2000, 1)), ((2000, 1000), (2000, 1000))):
        assert images.reduce_to_width(np.zeros(shape, np.uint8), 1000)[0].shape == reduced
    with pytest.raises(InputError, match=r"pano\.jpg: 16000x700 is reduced to 1280x56"):
        images.reduce_for_front_end(np.zeros((700, 16000), np.uint8), 1280, "pano.jpg")
    for shape in ((MIN_FRAME_PX, 2 * MIN_FRAME_PX), (2 * MIN_FRAME_PX, MIN_FRAME_PX)):
        assert images.reduce_for_front_end(np.zeros(shape, np.uint8), 1280, "small.jpg")[0].shape == shape


def test_written_files_have_the_permissions_of_the_user(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    images.save(tmp_path / "picture.png", np.zeros((4, 4), np.uint8))
    assert (tmp_path / "picture.png").stat().st_mode == (tmp_path / "plain").stat().st_mode


SRGB = np.array([[0.43607, 0.38515, 0.14307], [0.22249, 0.71687, 0.06061], [0.01392, 0.09708, 0.71410]])
P3 = np.array([[0.51512, 0.29198, 0.15710], [0.24120, 0.69225, 0.06657], [-0.00105, 0.04189, 0.78407]])
"""XYZ of the primaries, in the columns, for the white of profiles, D50."""


def display_p3() -> bytes:
    """The profile of Display P3: that of sRGB with other primaries."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    data = bytearray(srgb.replace("sRGB built-in".encode("utf-16-be"), "Display P3 A1".encode("utf-16-be")))
    for tag, primary in zip((b"rXYZ", b"gXYZ", b"bXYZ"), P3.T, strict=True):
        start = int.from_bytes(data[(at := data.index(tag) + 4) : at + 4], "big") + 8
        data[start : start + 12] = b"".join(round(65536 * each).to_bytes(4, "big", signed=True) for each in primary)
    return bytes(data)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".webp"])
def test_colours_become_those_of_srgb(tmp_path: Path, suffix: str) -> None:
    levels = np.random.default_rng(0).integers(60, 190, (300, 64, 3), dtype=np.uint8)
    path = tmp_path / f"a{suffix}"
    PillowImage.fromarray(levels).save(path, icc_profile=display_p3(), lossless=True)
    light = ((levels / 255 + 0.055) / 1.055) ** 2.4 @ (np.linalg.inv(SRGB) @ P3).T
    expected = 255 * (1.055 * np.clip(light, 0.0032, 1) ** (1 / 2.4) - 0.055)
    read, inside = images.load(path), (light.min(axis=2) > 0.0032) & (light.max(axis=2) < 1)
    assert np.abs(read.pixels[inside][:, ::-1] - expected[inside]).max() < 2
    assert read.notes == ("colour profile Display P3 A1: converted to sRGB",)
    assert np.array_equal(images.load(path, "a", ValueRange(0, 255)).pixels, read.pixels)


@pytest.mark.parametrize(
    ("profile", "depth", "notes"),
    [
        (ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(), 8, ()),
        (b"colours" * 40, 8, ("colour profile that is damaged: the colours are taken for sRGB",)),
        (display_p3(), 16, ("colour profile Display P3 A1: only 8 bits are converted to sRGB; they stay as they are",)),
    ],
    # Not the profiles themselves, which have the second in which they were made.
    ids=["sRGB", "damaged", "of 16 bits"],
)
def test_colours_without_a_profile_that_can_be_used_stay(
    tmp_path: Path, profile: bytes, depth: int, notes: tuple[str, ...]
) -> None:
    pixels = photograph()
    if depth == 8:
        PillowImage.fromarray(pixels).save(tmp_path / "a.png", icc_profile=profile)
    else:
        cv2.imwrite(str(tmp_path / "a.png"), pixels.astype(np.uint16) * 257)
        data = (tmp_path / "a.png").read_bytes()
        chunk = b"iCCPp\0\0" + zlib.compress(profile)
        chunk = (len(chunk) - 4).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
        (tmp_path / "a.png").write_bytes(data[:33] + chunk + data[33:])
    read = images.load(tmp_path / "a.png")
    assert tuple(note for note in read.notes if "profile" in note) == notes
    assert depth > 8 or np.array_equal(read.pixels, pixels[..., ::-1])
