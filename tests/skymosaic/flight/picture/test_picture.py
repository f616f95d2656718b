"""From a layout to a file: preparation, composition and what each format holds."""

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio

from sim.scene import Flight
from skymosaic.common.errors import InputError
from skymosaic.compositing.tone import NEUTRAL
from skymosaic.compositing.warp import CANVAS_LIMIT_PX, Canvas
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.flight.picture.canvas import scale_for
from skymosaic.flight.picture.composition import Composition, Placement
from skymosaic.flight.picture.formats import OutputForm, check_size, room_for
from skymosaic.flight.picture.output import deliver
from skymosaic.flight.picture.preparation import PALETTE, equalise, thumbnail_layers
from skymosaic.imagery.depth import ValueRange
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.maps.georeference import Georeference
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from tests.made import leave_free
from tests.skymosaic.flight.made import flight


def test_thumbnails_need_no_larger_canvas_than_the_mosaic(flight: Flight, surveyed: Path) -> None:
    with open_run(list(flight.images), MosaicOptions(scale=0.1, cache=surveyed)) as run:
        composition = run.composition(run.layouts[0])
        layers, reduction = thumbnail_layers(composition, run.flight.views)
    assert reduction == 1
    for layer in layers:
        assert layer.footprint.intersection(composition.canvas.grown(1)) == layer.footprint
    assert composition.uneven == ""
    assert any(placement.tone is not NEUTRAL for placement in composition.placements)
    hot = [
        replace(layer, image=np.asarray(cv2.applyColorMap(layer.image[..., 1], cv2.COLORMAP_INFERNO), np.uint8))
        for layer in layers
    ]
    left_alone = equalise(composition.with_each(tone=[NEUTRAL] * len(hot)), run.flight.views, hot)
    assert left_alone.uneven == PALETTE
    assert all(placement.tone is NEUTRAL for placement in left_alone.placements)


def test_a_photograph_that_others_make_up_for_shows_nothing(flight: Flight, surveyed: Path) -> None:
    middle = flight.images[4][60:-60, 80:-80]
    with open_run([*flight.images, middle], MosaicOptions(cache=surveyed)) as run:
        assert run.layouts[0].members == tuple(range(10))
        composition = run.composition(run.layouts[0])
    shown = [placement.shows_in(composition.canvas) for placement in composition.placements]
    assert shown == [True] * 9 + [False]


def test_a_tile_needs_what_lies_within_the_reach_of_blending() -> None:
    tile = Canvas(0, 0, 100, 100)
    shifts = [(227, 0), (228, 0), (0, 227), (0, 228), (-191, 0), (-192, 0)]
    placements = tuple(
        Placement(
            Source(row, str(row), np.zeros((64, 64), np.uint8)), (64, 64), np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
        )
        for row, (x, y) in enumerate(shifts)
    )
    whole = Composition(placements, tile, False, "distance", Lens())
    assert [placement.source.index for placement in whole.for_tile(tile).placements] == [0, 2, 4]


@pytest.mark.parametrize(("gsd_m", "scale"), [(0.0991, 1.0), (0.1, 1.0), (0.2, 0.5), (0.098, None)])
def test_a_canvas_is_as_fine_as_the_photographs_at_most(gsd_m: float, scale: float | None) -> None:
    pair: Any = object()
    layout: Any = None
    on_map = Georeference("EPSG:32615", np.array([[0.1, 0, 0], [0, -0.1, 0], [0, 0, 1]]), 0.0)
    with contextlib.nullcontext() if scale else pytest.raises(InputError, match=r"finer than the .* at least 0\.1$"):
        assert scale_for(flight([], pair=pair), layout, on_map, gsd_m) == pytest.approx(scale)


@pytest.mark.parametrize(
    ("name", "note", "says"),
    [
        ("m.png", "", ".png files have no georeference; .tif, .mbtiles and .kmz files do"),
        ("m.png", "no GPS", "no GPS"),
        ("m.bmp", "", ".bmp files have no georeference; .tif, .mbtiles and .kmz files do"),
        ("m.tif", "", ""),
        ("m.TIFF", "no GPS", "no GPS"),
    ],
)
@pytest.mark.parametrize("pair", [None, object()])
def test_what_is_delivered_is_written_and_previewed(
    tmp_path: Path, name: str, note: str, says: str, pair: object
) -> None:
    composition = Composition((), Canvas(0, 0, 80, 60), False, "distance", Lens(), place=MapPlace(note=note))
    picture, shown = np.full((60, 80), 90, np.uint8), np.ones((60, 80), np.uint16)
    shown[:, :20] = 0
    bands = [(picture[rows], shown[rows]) for rows in (slice(40), slice(40, 60))]
    layout: Any = None
    # A file stands in the way of the tiles; the mosaic is there all the same.
    (tmp_path / "tiles").write_text("")
    form = OutputForm(tiles=tmp_path / "tiles")
    made = deliver(tmp_path / name, flight([], pair=pair), layout, composition, bands, form=form, preview_width_px=40)
    assert made.map_note == says
    assert made.preview.shape == made.coverage.shape == (30, 40)
    assert made.covered_px == 60 * 60
    assert made.tiles is None
    assert len(made.failures) == 1
    np.testing.assert_array_equal(
        np.asarray(cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED))[..., 0:60].max(), 90
    )
    assert {each.name for each in tmp_path.iterdir()} == {name, "tiles"}


@pytest.mark.parametrize("name", ["m.kmz", "m.mbtiles"])
def test_maps_for_the_eye_show_gray_of_16_bits_in_8(tmp_path: Path, name: str) -> None:
    on_map = Georeference("EPSG:32633", np.array([[1, 0, 480_000], [0, -1, 5_200_000], [0, 0, 1]]), 0.5)
    values = ValueRange(0, 20_000, deep=True)
    composition = Composition(
        (), Canvas(0, 0, 90, 60), False, "distance", Lens(), values, place=MapPlace(georeference=on_map)
    )
    layout: Any = None
    bands = [(np.full((60, 90), 10_000, np.uint16), np.ones((60, 90), np.uint16))]
    made = deliver(tmp_path / name, flight([]), layout, composition, bands)
    assert (made.map_note, made.failures) == ("", ())
    with rasterio.open(tmp_path / name) as file:
        assert file.count == 4
        np.testing.assert_allclose(
            file.read([1, 2, 3, 4])[:, *[side // 2 for side in file.shape]], [128] * 3 + [255], atol=2
        )


def test_a_mosaic_grows_as_the_file_and_the_disk_allow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leave_free(monkeypatch, 24_000_000_000)
    survey = Canvas(0, 0, 28_000, 20_000)
    for suffix, share in ((".tif", 1.0), (".png", 1.0), (".jpg", np.sqrt(250 / 560)), (".webp", 16_383 / 28_000)):
        assert room_for(tmp_path / f"m{suffix}", 4).share_of(survey) == pytest.approx(share, rel=2e-3)
    assert room_for(tmp_path / "m.bmp", 4).area_px == CANVAS_LIMIT_PX
    assert room_for(tmp_path / "m.jpg", 4).share_of(Canvas(0, 0, 131_000, 10)) == pytest.approx(0.5, rel=2e-3)
    leave_free(monkeypatch, 3_360_000_000)
    room = room_for(tmp_path / "m.tif", 4)
    assert room.share_of(survey) == pytest.approx(0.5, rel=2e-3)
    assert room.reason == "the disk has 3204 MB left"
    # Of files whose pixels are in memory, too.
    leave_free(monkeypatch, 40_000_000)
    for suffix in (".jpg", ".webp", ".bmp"):
        room = room_for(tmp_path / f"m{suffix}", 4)
        assert (room.area_px, room.reason) == (10_000_000, "the disk has 38 MB left")
    assert room_for(tmp_path / "m.webp", 4).side_px == 16_383


TILES = Path("tiles")


@pytest.mark.parametrize(
    ("name", "form", "bands", "says"),
    [
        ("m.xyz", OutputForm(), 0, "m.xyz: unknown kind of file; end the name in one of .png, .jpg, .jpeg, .tif, "),
        ("m.tif", OutputForm("zip"), 0, "`compress` is 'zip'; valid: deflate, jpeg"),
        ("m.jpg", OutputForm(), 5, "m.jpg: a mosaic of 5 bands must be a .tif"),
        ("m.TIFF", OutputForm(), 5, ""),
        ("m.tif", OutputForm("jpeg"), 5, "compression and tiles are for photographs, not for multi-band sets"),
        ("m.tif", OutputForm(tiles=TILES), 5, "compression and tiles are for photographs, not for multi-band sets"),
        ("m.png", OutputForm("jpeg"), 0, "m.png: jpeg compression is for .tif; leave it out, or end the name in .tif"),
        ("m.tif", OutputForm("jpeg", TILES), 0, ""),
        ("m.png", OutputForm(require_map=True), 0, "m.png: .png files are no maps, and a map is required"),
        ("m.png", OutputForm(tiles=TILES, require_map=True), 0, ""),
        ("m.tif", OutputForm(require_map=True), 0, ""),
        ("m.kmz", OutputForm(require_map=True), 0, ""),
        ("m.kmz", OutputForm(), 5, "m.kmz: a mosaic of 5 bands must be a .tif"),
        ("m.mbtiles", OutputForm("jpeg"), 0, "m.mbtiles: jpeg compression is for .tif; leave it out"),
        ("m.png", OutputForm(), 0, ""),
    ],
)
def test_what_cannot_apply_to_a_file_is_refused(name: str, form: OutputForm, bands: int, says: str) -> None:
    with pytest.raises(InputError) if says else contextlib.nullcontext() as refused:
        form.check(Path(name), bands)
    assert refused is None or str(refused.value).startswith(says)


@pytest.mark.parametrize(
    ("name", "size", "says"),
    [
        ("m.webp", (16_383, 16_383), ""),
        ("m.WEBP", (16_384, 10), "m.WEBP: 16384x10 cannot be stored as .WEBP, whose sides have at most 16,383 pixels"),
        ("m.jpg", (10, 65_500), ""),
        ("m.jpeg", (10, 65_501), "m.jpeg: 10x65501 cannot be stored as .jpeg, whose sides have at most 65,500 pixels"),
        ("m.png", (100_000, 10), ""),
        ("m.tif", (100_000, 10), ""),
    ],
)
def test_a_size_that_a_file_cannot_hold_is_refused(name: str, size: tuple[int, int], says: str) -> None:
    with pytest.raises(InputError) if says else contextlib.nullcontext() as refused:
        check_size(Path(name), size)
    assert refused is None or str(refused.value) == f"{says}; use .png or .tif"
