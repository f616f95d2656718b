import contextlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.common.errors import InputError
from skymosaic.compositing.warp import Canvas
from skymosaic.flight.picture.canvas import check_scale, scale_for
from skymosaic.flight.picture.composition import Composition, Placement, Room
from skymosaic.imagery.depth import ValueRange
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source
from skymosaic.maps.georeference import Georeference


def render(*images: NDArray[np.uint8], coloured: bool) -> NDArray[np.generic]:
    """Photographs of 64x64 px side by side."""
    shifts = (np.array([[1.0, 0, 64 * number], [0, 1, 0], [0, 0, 1]]) for number in range(len(images)))
    sources = (Source(number, str(number), image) for number, image in enumerate(images))
    placements = tuple(Placement(source, (64, 64), shift) for source, shift in zip(sources, shifts, strict=True))
    canvas = Canvas(0, 0, 64 * len(images), 64)
    return Composition(placements, canvas, coloured, "distance", Lens()).render(canvas, 1 << 20)[0]


@pytest.mark.parametrize("sides", [(1000, 30), (30, 1000)])
def test_the_longest_side_decides_where_sides_are_limited(sides: tuple[int, int]) -> None:
    canvas = Canvas(0, 0, *sides)
    assert Room(side_px=1000).share_of(canvas) == 1
    assert 398 < Room(side_px=400).share_of(canvas) * 1000 <= 400
    assert Room(area_px=300).share_of(canvas) < 0.1


def test_a_tile_needs_what_lies_within_the_reach_of_blending() -> None:
    tile = Canvas(0, 0, 100, 100)
    shifts = [(259, 0), (260, 0), (0, 259), (0, 260), (-223, 0), (-224, 0)]
    placements = tuple(
        Placement(
            Source(row, str(row), np.zeros((64, 64), np.uint8)), (64, 64), np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
        )
        for row, (x, y) in enumerate(shifts)
    )
    whole = Composition(placements, tile, False, "distance", Lens())
    assert [placement.source.index for placement in whole.for_tile(tile).placements] == [0, 2, 4]


@pytest.mark.parametrize(
    ("values", "kind"), [(None, np.uint8), (ValueRange(0, 900), np.uint8), (ValueRange(0, 900, deep=True), np.uint16)]
)
def test_a_picture_has_16_bits_where_all_photographs_have(values: ValueRange | None, kind: type) -> None:
    for coloured in (False, True):
        empty = Composition((), Canvas(0, 0, 9, 9), coloured, "distance", Lens(), values).empty(4, 3)
        assert empty.dtype == kind
        assert empty.shape == ((3, 4, 3) if coloured else (3, 4))


@pytest.mark.parametrize(("gsd_m", "scale"), [(0.0991, 1.0), (0.1, 1.0), (0.2, 0.5), (0.098, None)])
def test_a_canvas_is_as_fine_as_the_photographs_at_most(gsd_m: float, scale: float | None) -> None:
    flight: Any = SimpleNamespace(pair=object())
    on_map = Georeference("EPSG:32615", np.array([[0.1, 0, 0], [0, -0.1, 0], [0, 0, 1]]), 0.0)
    with contextlib.nullcontext() if scale else pytest.raises(InputError, match=r"finer than the .* at least 0\.1$"):
        assert scale_for(flight, flight, on_map, gsd_m) == pytest.approx(scale)


def test_a_photograph_has_a_pixel_at_least() -> None:
    check_scale(0.01, [(60, 20), (20, 100)])
    with pytest.raises(InputError, match="smaller than a pixel"):
        check_scale(0.0099, [(60, 20), (20, 100)])


def test_gray_becomes_bgr_beside_colour_and_stays_gray_alone() -> None:
    gray, colour = np.full((64, 64), 50, np.uint8), np.full((64, 64, 3), (10, 20, 30), np.uint8)
    mosaic = render(gray, colour, coloured=True)
    np.testing.assert_array_equal(mosaic[:, :64], np.full((64, 64, 3), 50))
    np.testing.assert_array_equal(mosaic[:, 64:], colour)
    assert render(gray, coloured=False).ndim == 2
