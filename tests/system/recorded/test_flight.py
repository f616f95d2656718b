"""Small flights from photographs to the picture, held against recorded ones."""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from skymosaic.flight.checking.check import check_flight
from skymosaic.geometry.homography import apply
from skymosaic.mosaicking.api import mosaic
from skymosaic.mosaicking.result import Mosaic
from tests.system.recorded.rows import HEIGHT_PX, WIDTH_PX, as_pixels, check_picture, check_recorded, view, with_hills

CORNERS = np.array([(0.0, 0), (WIDTH_PX, 0), (WIDTH_PX, HEIGHT_PX), (0, HEIGHT_PX)])


def fly(kind: str) -> Iterator[Pixels]:
    """Three strips that sway, of which one photograph is blurred and others are brighter or darker."""
    for number in range(12):
        strip, along = divmod(number, 4)
        x, y = 190 + 70 * (3 - along if strip % 2 else along), 180 + 90 * strip
        seen = view(x, y, 0.05 * np.sin(2 * number), 1 + 0.04 * np.cos(number), 2e-5 * (number % 3 - 1))[0]
        if kind == "hills":
            seen = with_hills(seen, 3.0 * np.sin(number))
        if number == 6:
            seen = cv2.GaussianBlur(seen, (0, 0), 1.5)
        yield as_pixels(seen * (1.0, 0.8, 1.15)[number % 3])
    if kind == "hills":
        yield as_pixels(view(700, 550)[0][:, ::-1])


def check_mosaic(name: str, made: Mosaic) -> None:
    """Links, layout, quality and picture."""
    flight, layout = made.flight, made.layout
    holding = [link for link in flight.links if link.holds]
    counts: list[Any] = [
        len(holding),
        *(sum(getattr(each, kind) for each in holding) for kind in ("ties", "inliers", "near")),
    ]
    counts += [sum(len(each.left_checks) for each in holding), sum(len(each.left_relief) for each in holding)]
    check_recorded(f"{name}: counts", [len(flight.links), *counts, len(layout.contradicting), layout.reference], 0.1)
    placed = [apply(transform, CORNERS) for transform in made.transforms.values()]
    check_recorded(f"{name}: places", [*made.image.shape[1::-1], *np.ravel(placed[::4])], 0.02)
    (errors,), photographs = check_flight(flight).errors, check_flight(flight).photographs
    quality = [layout.relief, layout.median_error_px, errors.median_px, errors.ninety_px]
    quality += [each.overlap for each in photographs] + [each.sharpness for each in photographs]
    check_recorded(f"{name}: quality", quality, 0.005)
    check_picture(f"{name}: picture", made.image, made.image.max(axis=2) > 0)


@pytest.mark.parametrize("kind", ["plain", "hills"])
def test_flights_end_as_recorded(kind: str) -> None:
    made = mosaic(list(fly(kind)))
    assert list(made.left_out) == ([12] if kind == "hills" else [])
    check_mosaic(kind, made)


@pytest.mark.parametrize("options", [{"blending": "multiband"}, {}], ids=str)
def test_two_photographs_end_as_recorded(options: dict[str, Any]) -> None:
    first, second, *_ = fly("hills")
    made = mosaic([first, second], **options)
    placed = [apply(transform, CORNERS) for transform in made.transforms.values()]
    check_recorded(f"pair {options}: places", [*made.image.shape[1::-1], *np.ravel(placed)], 0.02)
    check_picture(f"pair {options}: picture", made.image, made.image.max(axis=2) > 0, tolerance=0.1)
