"""Outputs of a mosaic, and the pairs of which it is made."""

import csv
import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio

from sim.scene import make_lawnmower, make_pair
from skymosaic import mosaic, register, register_pairs, table_of_pairs
from skymosaic.common.errors import InputError, RegistrationError
from skymosaic.common.tables import Table
from skymosaic.compositing.blend import Blending
from skymosaic.flight.picture.composition import Room
from skymosaic.flight.picture.formats import PLAIN, OutputForm
from skymosaic.imagery.exif import Metadata, Position
from skymosaic.imagery.photographs import Source
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.mosaicking.outputs import check_outputs, check_room, room_of
from skymosaic.mosaicking.run import MosaicRun
from skymosaic.registration.pair import Pair
from tests.made import leave_free, write_located
from tests.skymosaic.panel.tasks.test_mosaic_tasks import write_flight_with_gps


def check(run: MosaicRun, output: Path, form: OutputForm = PLAIN, **limits: Any) -> None:
    check_outputs(output, form, run.sources, run.options, **limits)


def test_a_full_disk_is_refused_before_the_first_feature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leave_free(monkeypatch, 20_000_000)
    photographs = [np.zeros((60, 80), np.uint8)] * 3
    with open_run(photographs, MosaicOptions()) as run:
        with pytest.raises(InputError, match=r"m\.tif: the disk has 19 MB left, too little for a mosaic; free some"):
            check(run, tmp_path / "m.tif")
        check(run, tmp_path / "m.tif", computed=True)
        check(run, tmp_path / "m.jpg")
        leave_free(monkeypatch, 3_900_000)
        with pytest.raises(InputError, match=r"m\.jpg: the disk has 3 MB left, too little"):
            check(run, tmp_path / "m.jpg")


def test_what_headers_forbid_is_refused_before_the_first_feature(tmp_path: Path) -> None:
    photographs = [tmp_path / f"{number}.png" for number in range(3)]
    for number, path in enumerate(photographs):
        cv2.imwrite(str(path), np.full((80, 100), 1000 * number, np.uint16))
    smaller = pytest.raises(InputError, match="smaller than a pixel; raise `scale`")
    with open_run(photographs, MosaicOptions(scale=0.009)) as run, smaller:
        check(run, tmp_path / "m.tif")
    for scale in (0.011, 1.0):
        with open_run(photographs, MosaicOptions(scale=scale)) as run:
            check(run, tmp_path / "m.tif")
            with pytest.raises(InputError, match=r"m\.tif: JPEG holds 8 bits, the photographs have 16"):
                check(run, tmp_path / "m.tif", OutputForm(compress="jpeg"))
    # One of 8 bits makes a mosaic of 8 bits; a damaged one is judged when it is read.
    for content in (cv2.imencode(".png", np.zeros((80, 100), np.uint8))[1].tobytes(), b"damaged"):
        photographs[0].write_bytes(content)
        with open_run(photographs, MosaicOptions()) as run:
            check(run, tmp_path / "m.tif", OutputForm(compress="jpeg"))


@pytest.mark.parametrize(("folder", "groups"), [("survey", False), ("survey", True), ("survey_2", True)])
def test_tiles_replace_no_photographs(tmp_path: Path, folder: str, groups: bool) -> None:
    photographs = [tmp_path / folder / "7" / f"{number}.png" for number in range(3)]
    photographs[0].parent.mkdir(parents=True)
    for path in photographs:
        cv2.imwrite(str(path), np.zeros((80, 100), np.uint8))
    form = OutputForm(tiles=tmp_path / "survey")
    with open_run(photographs, MosaicOptions(all_groups=groups)) as run:
        with pytest.raises(InputError, match=f"{folder}: its 7 holds .*0.png, one of the inputs"):
            check(run, tmp_path / "m.tif", form, overwrite=True)
        check(run, tmp_path / "m.tif", OutputForm(tiles=tmp_path / "tiles"), overwrite=True)


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_tiles_of_several_groups_need_a_name(tmp_path: Path, folder: str) -> None:
    form = OutputForm(tiles=Path(folder))
    refused = pytest.raises(InputError, match="has no name that could be numbered")
    with open_run([np.zeros((60, 80), np.uint8)] * 3, MosaicOptions(all_groups=True)) as run, refused:
        check(run, tmp_path / "m.tif", form, overwrite=True)


@pytest.mark.parametrize(("area_px", "enough"), [(1_000_000, True), (999_999, False)])
def test_a_mosaic_of_a_megapixel_has_room(tmp_path: Path, area_px: int, enough: bool) -> None:
    with nullcontext() if enough else pytest.raises(InputError, match="full, too little for a mosaic"):
        check_room(tmp_path / "m.tif", Room(area_px, reason="full"))


@pytest.mark.parametrize(
    ("photographs", "bands", "area_px"), [(3, 3, 1e6), (3, 1, 1e6), (3, 5, 4e6 / 6), (2, 3, Room().area_px)]
)
def test_the_room_is_that_of_the_disk_for_each_band_and_alpha(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, photographs: int, bands: int, area_px: float
) -> None:
    leave_free(monkeypatch, 24_000_000)
    counts = (bands, *[9] * (photographs - 1))
    bands_of = ({str(band): Source(band, "band", Path()) for band in range(count)} for count in counts)
    sources = [Source(number, "photograph", Path(), bands=bands) for number, bands in enumerate(bands_of)]
    assert room_of(tmp_path / "m.tif", sources, MosaicOptions()).area_px == area_px
    assert room_of(None, sources, MosaicOptions()).area_px == Room().area_px
    for path in (None, tmp_path / "m.tif"):
        limited = room_of(path, sources, MosaicOptions(canvas_limit_px=2_500_000))
        assert (limited.area_px, limited.reason) == (2_500_000, "the limit is 2.5 megapixels")


@pytest.mark.parametrize("given", ["nothing", "control_points", "positions", "repeat", "gps", "unreadable"])
def test_a_map_needs_something_that_places_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    """Each alone is enough; what cannot be read is judged when it is read."""
    photographs: list[Any] = [np.zeros((80, 100), np.uint8), tmp_path / "1.png", np.zeros((80, 100), np.uint8)]
    cv2.imwrite(str(photographs[1]), np.zeros((80, 100), np.uint8))
    position = Position(46, 7) if given == "gps" else None
    by_path = {photographs[1]: Metadata(position=position)}
    monkeypatch.setattr("skymosaic.imagery.photographs.read_metadata", lambda path: by_path[path])
    access = os.access
    monkeypatch.setattr(
        os, "access", lambda path, mode: given != "unreadable" if path == photographs[1] else access(path, mode)
    )
    changes: dict[str, Any] = {given: object()} if given in vars(MosaicOptions()) else {}
    options = replace(MosaicOptions(), **changes)
    sources = [Source(number, str(number), each) for number, each in enumerate(photographs)]
    refused = pytest.raises(
        RegistrationError, match=r"m\.tif has no place on the map: 0 of 3 photographs have GPS; .*; nothing was written"
    )
    with refused if given == "nothing" else nullcontext():
        check_outputs(tmp_path / "m.tif", OutputForm(require_map=True), sources, options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("flight")
    elsewhere = make_pair(seed=9, size=(320, 240)).images[0]
    for number, image in enumerate([*make_lawnmower(1, 3, (320, 240)).images, elsewhere]):
        cv2.imwrite(str(made / f"{number}.png"), image)
    return made


@pytest.fixture(scope="module")
def pairs(folder: Path) -> list[Pair]:
    return register_pairs(folder, [(0, 1), (0, 3), (2, 1)], effort="fast")


def types(table: Table) -> str:
    """The kind of each column: text, boolean, integer or float."""
    assert len({column.shape for column in table.values()}) == 1
    return "".join(column.dtype.kind for column in table.values())


def test_pairs_are_those_of_register_with_names_and_progress(folder: Path, pairs: list[Pair]) -> None:
    alone = register(folder / "2.png", folder / "1.png", effort="fast")
    np.testing.assert_array_equal(pairs[2].homography, alone.homography)
    assert [Path(pairs[2].left.name).name, Path(pairs[2].right.name).name] == ["2.png", "1.png"]
    assert not pairs[2].left.pixels.size
    assert pairs[2].left.size == pairs[2].right.size == (320, 240)
    assert pairs[2].summary()["left"] == alone.summary()["left"] == str(folder / "2.png")
    seen: list[tuple[str, int, int]] = []
    every_two = register_pairs(f"{folder}/[012].png", detector="orb", progress=lambda *stage: seen.append(stage))
    assert [(Path(each.left.name).stem, Path(each.right.name).stem) for each in every_two] == [
        ("0", "1"), ("0", "2"), ("1", "2"),
    ]  # fmt: skip
    assert seen[-1] == ("pairs", 3, 3)
    with pytest.raises(InputError, match=r"none\.png: no such file"):
        register_pairs([folder / "none.png", folder / "0.png"])


@pytest.mark.parametrize("pair", [(0, 4), ("0.png", "1.png"), (0.0, 1.0), (0, 1, 2), 0])
def test_pairs_that_are_none_are_refused_before_anything_is_read(pair: Any) -> None:
    with pytest.raises(InputError, match="numbers of two photographs for each, 0 to 3"):
        register_pairs(["absent.png"] * 4, [pair])


def test_a_table_of_pairs_has_a_row_each(pairs: list[Pair], tmp_path: Path) -> None:
    table = table_of_pairs(pairs)
    assert types(table) == "UUbUUf" + "i" * 7 + "b" + "f" * 10
    assert table["accepted"].tolist() == [True, False, True]
    assert "inliers" in table["reason"][1]
    for row, pair in enumerate(pairs):
        entries = [table[f"h{i}{j}"][row] for i in (1, 2, 3) for j in (1, 2, 3)]
        if pair.homography is None:
            assert np.isnan(entries).all()
        else:
            np.testing.assert_array_equal(entries, pair.homography.ravel())
    with (tmp_path / "pairs.csv").open("w", newline="") as file:
        csv.writer(file).writerows([table, *zip(*table.values(), strict=True)])
    with (tmp_path / "pairs.csv").open() as file:
        assert [int(row["inliers"]) for row in csv.DictReader(file)] == [len(pair.inliers) for pair in pairs]


def test_a_table_of_matches_has_original_pixels_and_errors(pairs: list[Pair]) -> None:
    table = pairs[0].table()
    assert types(table) == "ffffffU"
    assert len(table["rule"]) == len(pairs[0].inliers)
    assert 0 < table["error_px"].max() < 2.1
    refused = pairs[1].table("matches")
    assert len(refused["left_x"]) == len(pairs[1].matches) > 0
    assert np.isnan(refused["error_px"]).all()


def test_a_table_of_photographs_has_all_that_were_given(tmp_path: Path) -> None:
    write_flight_with_gps(tmp_path)
    (tmp_path / "0_note.png").write_bytes(b"no picture")
    made = mosaic(tmp_path)
    table = made.table()
    assert types(table) == "UbUffffifffbff"
    assert table["photograph"][0].endswith("0_note.png")
    assert table["placed"].tolist() == [False, True, True, True, True]
    assert "not an image" in table["reason"][0]
    assert np.isnan([table["x_px"][0], table["map_x"][0], table["sharpness"][0]]).all()
    height_px, width_px = made.image.shape[:2]
    assert repr(made) == f"Mosaic({width_px}x{height_px} px, 4 photographs, 1 left out)"
    assert ((table["x_px"][1:] > 0) & (table["x_px"][1:] < width_px)).all()
    assert ((table["y_px"][1:] > 0) & (table["y_px"][1:] < height_px)).all()
    place = made.composition.place.georeference
    assert place is not None
    # The photographs lie on the map as they do on the canvas, north up.
    metres, pixels = np.ptp(table["map_x"][1:]), np.ptp(table["x_px"][1:])
    assert metres == pytest.approx(pixels * place.metres_per_pixel, rel=1e-6)
    assert np.argmin(table["map_y"][1:]) == np.argmax(table["y_px"][1:])
    assert table["gps"].tolist() == [False, True, True, True, True]


@pytest.mark.parametrize("blending", ["multiband", "distance"])
def test_a_second_file_says_which_photograph_each_pixel_shows(tmp_path: Path, blending: Blending) -> None:
    """As their own noise tells, where they show the same ground; the first file is no photograph."""
    (tmp_path / "0_note.png").write_bytes(b"no picture")
    rendered, rng = make_lawnmower(seed=9, images=4, size=(400, 300)), np.random.default_rng(3)
    for number, (image, pose) in enumerate(zip(rendered.images, rendered.poses, strict=True)):
        noisy = np.clip(image + rng.normal(0, 12, (300, 400, 1)), 0, 255).astype(np.uint8)
        write_located(tmp_path / f"DJI_{number}.jpg", noisy, (46.0, 7.0), (pose.x_px, -pose.y_px))
    made, output = mosaic(tmp_path, blending=blending), tmp_path / "m.tif"
    made.save(output, sources=True)
    with rasterio.open(tmp_path / "m.sources.tif") as file, rasterio.open(output) as picture:
        shown, tags = file.read(1), file.tags()
        assert (file.transform, file.crs, file.nodata, file.dtypes) == (picture.transform, picture.crs, 0, ("uint16",))
        np.testing.assert_array_equal(shown > 0, picture.read(4) > 0)
        pixels = picture.read(2).astype(np.float32)
    named = {number: tags[f"PHOTOGRAPH_{number}"] for number in range(2, 6)}
    assert named == {number: f"DJI_{number - 2}.jpg" for number in range(2, 6)}
    unlike = np.full((6, *shown.shape), np.inf)
    for number, name in named.items():
        seen = np.asarray(cv2.imread(str(tmp_path / name)))[..., 1].astype(np.float32)
        warped = cv2.warpPerspective(seen, made.transforms[number - 1], shown.shape[::-1], flags=cv2.INTER_CUBIC)
        inside = cv2.warpPerspective(np.ones_like(seen), made.transforms[number - 1], shown.shape[::-1]) == 1
        fine = pixels - warped - cv2.GaussianBlur(pixels - warped, (0, 0), 2)
        unlike[number][inside] = cv2.GaussianBlur(fine**2, (0, 0), 3)[inside]
    shared = np.isfinite(unlike).sum(axis=0) > 1
    assert set(np.unique(shown[shared])) == set(named)
    assert (unlike.argmin(axis=0) == shown)[shared].mean() > (0.97 if blending == "multiband" else 0.9)
    # Neither is a photograph of the next run, and neither is replaced unasked.
    assert len(mosaic(tmp_path).placed) == 4
    with pytest.raises(InputError, match=r"m\.sources\.tif.*exists"):
        made.save(tmp_path / "m.png", sources=True)
