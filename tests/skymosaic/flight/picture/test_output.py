import contextlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio

from skymosaic.common.errors import InputError
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.mapping.place import MapPlace
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.formats import OutputForm
from skymosaic.flight.picture.output import deliver
from skymosaic.imagery.depth import ValueRange
from skymosaic.imagery.lens import Lens
from skymosaic.maps.georeference import Georeference


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
    flight: Any = SimpleNamespace(pair=pair, folders=[])
    composition = Composition((), Canvas(0, 0, 80, 60), False, "distance", Lens(), place=MapPlace(note=note))
    picture, shown = np.full((60, 80), 90, np.uint8), np.ones((60, 80), np.bool_)
    shown[:, :20] = False
    bands = [(picture[rows], shown[rows]) for rows in (slice(40), slice(40, 60))]
    layout: Any = None
    # A file stands in the way of the tiles; the mosaic is there all the same.
    (tmp_path / "tiles").write_text("")
    form = OutputForm(tiles=tmp_path / "tiles")
    made = deliver(tmp_path / name, flight, layout, composition, bands, form=form, preview_width_px=40)
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
    flight: Any = SimpleNamespace(pair=None, folders=[])
    bands = [(np.full((60, 90), 10_000, np.uint16), np.ones((60, 90), np.bool_))]
    made = deliver(tmp_path / name, flight, flight, composition, bands)
    assert (made.map_note, made.failures) == ("", ())
    with rasterio.open(tmp_path / name) as file:
        assert file.count == 4
        np.testing.assert_allclose(
            file.read([1, 2, 3, 4])[:, *[side // 2 for side in file.shape]], [128] * 3 + [255], atol=2
        )


@pytest.mark.parametrize("values", [None, ValueRange(0, 1), ValueRange(0, 1, deep=True)])
def test_only_16_bits_are_too_deep_for_jpeg(tmp_path: Path, values: ValueRange | None) -> None:
    flight: Any = SimpleNamespace(pair=None, folders=[])
    composition = Composition((), Canvas(0, 0, 32, 32), True, "distance", Lens(), values)
    bands = [(composition.empty(32, 32), np.ones((32, 32), np.bool_))]
    refused = pytest.raises(InputError, match=r"m\.tif: JPEG holds 8 bits, the photographs have 16; leave out the")
    with refused if values is not None and values.deep else contextlib.nullcontext():
        made = deliver(tmp_path / "m.tif", flight, flight, composition, bands, form=OutputForm("jpeg"))
        assert made.preview.shape == (32, 32, 3)
