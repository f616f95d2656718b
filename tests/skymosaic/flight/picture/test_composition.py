import numpy as np
import pytest
from numpy.typing import NDArray

from skymosaic.compositing.warp import Canvas
from skymosaic.flight.picture.composition import Composition, Placement, Room
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.photographs import Source


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


def test_gray_becomes_bgr_beside_colour_and_stays_gray_alone() -> None:
    gray, colour = np.full((64, 64), 50, np.uint8), np.full((64, 64, 3), (10, 20, 30), np.uint8)
    mosaic = render(gray, colour, coloured=True)
    np.testing.assert_array_equal(mosaic[:, :64], np.full((64, 64, 3), 50))
    np.testing.assert_array_equal(mosaic[:, 64:], colour)
    assert render(gray, coloured=False).ndim == 2
