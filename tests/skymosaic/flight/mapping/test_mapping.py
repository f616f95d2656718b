"""A flight is anchored by positions along its path, and laid onto a map that is there."""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
import rasterio.enums
import rasterio.features
import rasterio.vrt

from golden_model.arrays import Array
from sim.scene import make_lawnmower
from skymosaic import Mosaic, mosaic
from skymosaic.common.errors import InputError
from skymosaic.flight.flight import Flight
from skymosaic.flight.layout.layout import Layout, lay_out
from skymosaic.flight.linking.links import Link
from skymosaic.flight.linking.view import View
from skymosaic.flight.mapping.anchoring import Observation, anchor
from skymosaic.flight.mapping.place import MapPlace, place_on_map
from skymosaic.flight.picture.composition import Composition
from skymosaic.flight.picture.preparation import compose
from skymosaic.geometry.homography import apply
from skymosaic.maps.base_map import load_base_map
from skymosaic.maps.boundary import load_boundary
from skymosaic.maps.georeference import reproject
from skymosaic.mosaicking.api import open_run
from skymosaic.mosaicking.options import MosaicOptions
from skymosaic.running.workers import Workers
from tests.made import write_located
from tests.skymosaic.flight import made

SIZE, STRIP, STEP_PX = (1000, 800), 24, 300.0
MIDDLE = (np.array(SIZE) - 1) / 2


def bent_strip() -> tuple[list[View], Layout]:
    """A strip whose links turn a little, each in the same direction, as an unknown lens makes them."""
    rng = np.random.default_rng(0)
    views = made.views(STRIP, SIZE)
    links = []
    for left in range(STRIP - 1):
        for right in (left + 1, left + 2):
            if right < STRIP:
                points = rng.uniform((STEP_PX * (right - left), 0), SIZE, (60, 2))
                turned = 2e-4 * (right - left)
                turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
                moved = (points - (STEP_PX * (right - left), 0) - MIDDLE) @ turn.T + MIDDLE
                links.append(Link(left, right, points, moved + rng.normal(0, 0.3, points.shape), 60, 60))
    return views, lay_out(views, range(STRIP), links)


def middles(layout: Layout) -> Array:
    return np.array([apply(layout.transforms[view], MIDDLE) for view in range(STRIP)])


def true_places(layout: Layout) -> Array:
    return MIDDLE + STEP_PX * (np.arange(STRIP) - layout.reference)[:, None] * [1, 0]


def test_positions_straighten_a_strip_that_ties_bend() -> None:
    views, layout = bent_strip()
    bend_px = np.abs(middles(layout) - true_places(layout)).max()
    assert bend_px > 5
    noise = np.random.default_rng(1).normal(0, 1.0, (STRIP, 2))
    places = true_places(layout) + noise
    # One receiver lost its satellites.
    places[5] += 400
    observations = [Observation(view, MIDDLE, place, 1.0) for view, place in enumerate(places)]
    anchored = anchor(layout, views, observations)
    assert np.abs(middles(anchored) - true_places(layout)).max() < 0.4 * bend_px
    assert np.median(np.concatenate(anchored.errors_px)) < 0.6
    coarse = anchor(layout, views, [dataclasses.replace(each, sigma_px=1000.0) for each in observations])
    np.testing.assert_allclose(middles(coarse), middles(layout), atol=0.5)


METRES, PLACE, SIZE = 0.15, (46.0, 15.0), (640, 480)
FLIGHT = make_lawnmower(3, 12, SIZE)
HALVES = {"first": (range(7), (1.2, -0.8)), "second": (range(6, 11), (-1.0, 1.5))}
"""Numbers of the photographs, and by how many metres all their GPS is off."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Mosaic]:
    """A folder with the photographs of the second half, and the map of the first half as a file and as it was made."""
    base = tmp_path_factory.mktemp("onto")
    rng = np.random.default_rng(0)
    for half, (numbers, off_m) in HALVES.items():
        (base / half).mkdir()
        for number in numbers:
            pose = FLIGHT.poses[number]
            moved_m = np.array([pose.x_px, -pose.y_px]) * METRES + off_m + rng.normal(0, 0.3, 2)
            write_located(base / half / f"{number:02}.jpg", FLIGHT.images[number], PLACE, (moved_m[0], moved_m[1]))
    first = mosaic(str(base / "first"), cache=base / "cache")
    first.save(base / "map.tif")
    return base, first


def lay(base: Path, onto: Path | None = None) -> tuple[Flight, Composition]:
    """The second half laid out, onto another map, and on its canvas."""
    base_map = None if onto is None else load_base_map(onto)
    with open_run([base / "second"], MosaicOptions(cache=base / "cache", onto=base_map)) as run:
        return run.flight, run.composition(run.layouts[0])


def places(made: Composition, half: str, crs: str) -> np.ndarray:
    """Where a mosaic has points of the ground that both halves show, in metres."""
    ground = np.stack(np.meshgrid(*(np.arange(0, 2000, 40.0),) * 2), axis=-1).reshape(-1, 2) - 1000
    found = np.full((len(HALVES[half][0]), len(ground), 2), np.nan)
    for index, number in enumerate(HALVES[half][0]):
        seen = apply(FLIGHT.homographies[number], ground)
        inside = ((seen >= 0) & (seen <= np.array(SIZE) - 1)).all(axis=1)
        on_map: Any = made.place.georeference
        at = apply(on_map.to_map @ made.transforms[index], seen[inside])
        found[index, inside] = reproject(at, on_map.crs, crs)
    known = np.isfinite(found).any(axis=(0, 2))
    found[0, known] = np.nanmedian(found[:, known], axis=0)
    return found[0]


def rewrite(source: Path, target: Path, change: Callable[[np.ndarray], np.ndarray], **profile: Any) -> Path:
    with rasterio.open(source) as file:
        pixels, grid = change(file.read()), {"crs": file.crs, "transform": file.transform}
    shape = {"count": len(pixels), "height": pixels.shape[1], "width": pixels.shape[2], "dtype": pixels.dtype}
    with rasterio.open(target, "w", driver="GTiff", **{**grid, **shape, **profile}) as file:
        file.write(pixels)
    return target


def turned(source: Path, target: Path) -> Path:
    with rasterio.open(source) as file:
        a, _, c, _, e, f = file.transform[:6]
        transform = rasterio.Affine(0, -a, c + a * file.width, e, 0, f)
    return rewrite(source, target, lambda pixels: np.rot90(pixels, axes=(1, 2)), transform=transform)


def halved(source: Path, target: Path) -> Path:
    with rasterio.open(source) as file:
        a, _, c, _, e, f = file.transform[:6]

    def halve(pixels: np.ndarray) -> np.ndarray:
        even = pixels[:, : pixels.shape[1] // 2 * 2, : pixels.shape[2] // 2 * 2]
        return np.stack([cv2.resize(each, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for each in even])

    return rewrite(source, target, halve, transform=rasterio.Affine(2 * a, 0, c, 0, 2 * e, f))


def gray_of_16_bits(source: Path, target: Path) -> Path:
    def mix(pixels: np.ndarray) -> np.ndarray:
        return np.where(pixels[3:] > 0, 500 + 100 * pixels[:3].mean(axis=0, keepdims=True), 0).astype(np.uint16)

    return rewrite(source, target, mix, nodata=0)


def in_system(crs: str) -> Callable[[Path, Path], Path]:
    def warp(source: Path, target: Path) -> Path:
        cubic = rasterio.enums.Resampling.cubic
        with rasterio.open(source) as file, rasterio.vrt.WarpedVRT(file, crs=crs, resampling=cubic) as warped:
            return rewrite(source, target, lambda _: warped.read(), crs=crs, transform=warped.transform)

    return warp


def elsewhere(source: Path, target: Path) -> Path:
    """Ground of another place."""
    return rewrite(source, target, lambda pixels: np.concatenate([pixels[:3, ::-1], pixels[3:, ::-1]]))


def in_turn(*changes: Callable[[Path, Path], Path]) -> Callable[[Path, Path], Path]:
    def change(source: Path, target: Path) -> Path:
        for number, each in enumerate(changes):
            source = each(source, target.with_stem(f"{number}"))
        return source

    return change


MAPS: dict[str, tuple[Callable[[Path, Path], Path], str, bool]] = {
    "as it was written": (lambda source, _: source, "EPSG:32633", True),
    "turned, in gray": (in_turn(turned, gray_of_16_bits), "EPSG:32633", True),
    "of half the resolution, in another zone": (in_turn(halved, in_system("EPSG:32632")), "EPSG:32632", True),
    "in degrees": (in_system("EPSG:4326"), "EPSG:32633", False),
}


@pytest.mark.parametrize("kind", MAPS)
def test_a_flight_is_laid_onto_a_map_of_any_form(flown: tuple[Path, Mosaic], tmp_path: Path, kind: str) -> None:
    base, first = flown
    make, crs, on_grid = MAPS[kind]
    onto = make(base / "map.tif", tmp_path / "map.tif")
    laid, made = lay(base, onto)
    place, on_first = made.place, first.composition.place.georeference
    assert (place.by, place.contradictions) == ("other map", ())
    assert laid.onto is not None
    assert int(laid.onto.description[0]) >= 3
    assert place.georeference is not None
    assert on_first is not None
    assert place.georeference.crs == crs
    off_m = places(made, "second", "EPSG:32633") - places(first.composition, "first", "EPSG:32633")
    off_px = np.linalg.norm(off_m[np.isfinite(off_m).all(axis=1)], axis=1) / on_first.metres_per_pixel
    assert len(off_px) > 100
    assert np.median(off_px) < 0.5
    assert np.percentile(off_px, 90) < 1
    if on_grid:
        between = np.linalg.inv(load_base_map(onto).to_map) @ place.georeference.to_map
        np.testing.assert_allclose(between[:2, :2], np.eye(2), atol=1e-6)
        np.testing.assert_allclose(between[:2, 2], np.rint(between[:2, 2]), atol=1e-4)
        # With a resolution of its own, corners of pixels are at multiples of it.
        coarse = compose(laid, laid.layouts[0], place=place_on_map(laid, laid.layouts[0]), gsd_m=0.4).place.georeference
        assert coarse is not None
        corner = coarse.to_map @ [-0.5, -0.5, 1]
        np.testing.assert_allclose(np.diag(coarse.to_map)[:2], [0.4, -0.4], rtol=1e-9)
        np.testing.assert_allclose(corner[:2] / 0.4, np.rint(corner[:2] / 0.4), atol=1e-4)


def test_a_map_that_nothing_registers_with_moves_nothing(flown: tuple[Path, Mosaic], tmp_path: Path) -> None:
    base, _ = flown
    (_, alone), (_, made) = lay(base), lay(base, elsewhere(base / "map.tif", tmp_path / "other.tif"))
    np.testing.assert_array_equal(made.transforms, alone.transforms)
    assert made.place.georeference is not None
    assert alone.place.georeference is not None
    np.testing.assert_array_equal(made.place.georeference.to_map, alone.place.georeference.to_map)
    assert made.place.by == "GPS"
    says = "0 of 5 photographs register with other.tif, and 3 are needed; the mosaic is not laid onto it"
    assert made.place.contradictions[-1] == says


SHARES = [
    [[(0.1, 0.2), (0.7, 0.1), (0.55, 0.9)], [(0.4, 0.3), (0.5, 0.3), (0.5, 0.5)]],
    [[(0.8, 0.6), (1.2, 0.6), (0.9, 0.9)]],
]
"""Polygons with their rings, as shares of a map's width and height."""


def test_a_boundary_leaves_of_a_map_what_gdals_cutline_leaves(flown: tuple[Path, Mosaic], tmp_path: Path) -> None:
    """Pixel by pixel, of an area with a hole and two parts, one of which ends beyond the map."""
    base, first = flown
    with rasterio.open(base / "map.tif") as whole:
        step, start = np.array(whole.res) * whole.shape[::-1] * [1, -1], np.array([whole.bounds.left, whole.bounds.top])
        parts = [[(start + step * [*ring, ring[0]]).tolist() for ring in rings] for rings in SHARES]
        area = {"type": "MultiPolygon", "coordinates": parts}
        wanted = whole.read() * rasterio.features.geometry_mask([area], whole.shape, whole.transform, invert=True)
    named = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32633"}}
    (tmp_path / "area.geojson").write_text(json.dumps({"type": "Feature", "geometry": area, "crs": named}))
    boundary, place = load_boundary(tmp_path / "area.geojson"), place_on_map(first.flight, first.layout)
    cut = compose(first.flight, first.layout, place=place, boundary=boundary)
    with Workers() as workers:
        bands = list(cut.bands(workers))
    made = np.dstack([cut.joined(bands)[..., ::-1], 255 * (np.concatenate([shown for _, shown in bands]) > 0)])
    assert cut.place.georeference is not None
    corner = cut.place.georeference.to_map[:2, 2] - whole.transform @ (0.5, 0.5)
    x, y = np.rint(corner / whole.res * [1, -1]).astype(int)
    np.testing.assert_allclose(corner / whole.res * [1, -1], (x, y), atol=1e-6)
    np.testing.assert_array_equal(made, np.moveaxis(wanted, 0, -1)[y : y + len(made), x : x + made.shape[1]])
    assert np.count_nonzero(made) == np.count_nonzero(wanted)
    away = replace(boundary, polygons=tuple(tuple(ring + 1000 for ring in rings) for rings in boundary.polygons))
    with pytest.raises(InputError, match=r"area\.geojson: no photograph shows any of it"):
        compose(first.flight, first.layout, place=place, boundary=away)
    sides_m = np.array(whole.res) * [(0.1, 0), (0.1, 20), (0.3, 20), (0.3, 0), (0.1, 0)]
    thin = whole.transform @ (whole.width // 2, whole.height // 2) + sides_m
    with pytest.raises(InputError, match="the boundary is thinner than a pixel of the mosaic; draw an area"):
        compose(first.flight, first.layout, place=place, boundary=replace(boundary, polygons=((thin,),)))
    with pytest.raises(InputError, match=r"area\.geojson: the mosaic has no place on the map: by hand"):
        compose(first.flight, first.layout, place=MapPlace(note="by hand"), boundary=boundary)


def test_what_is_no_map_of_the_ground_is_refused_in_a_line(flown: tuple[Path, Mosaic], tmp_path: Path) -> None:
    base, _ = flown
    (tmp_path / "text.tif").write_text("no raster")
    with pytest.raises(InputError, match=r"text\.tif: cannot be read as a map \(.*\); give a GeoTIFF"):
        load_base_map(tmp_path / "text.tif")
    cut = (base / "map.tif").read_bytes()
    (tmp_path / "cut.tif").write_bytes(cut[: len(cut) // 2])
    with pytest.raises(InputError, match=r"cut\.tif: cannot be read as a map \(.*\); give a GeoTIFF"):
        lay(base, tmp_path / "cut.tif")
    plain = rewrite(base / "map.tif", tmp_path / "plain.tif", lambda pixels: pixels, crs=None)
    with pytest.raises(InputError, match=r"plain\.tif: has no coordinate system, so it is no map"):
        load_base_map(plain)
    far = rasterio.Affine(0.15, 0, 600_000, 0, -0.15, 5_090_000)
    away = rewrite(base / "map.tif", tmp_path / "away.tif", lambda pixels: pixels, transform=far)
    with pytest.raises(InputError, match=r"away\.tif: shows too little of the photographs' ground; give a map of it"):
        lay(base, away)
    for options, says in (({"scale": 0.5}, "`onto` and `scale`"), ({"repeat": object()}, "`onto` and `repeat`")):
        with pytest.raises(InputError, match=says):
            MosaicOptions(onto=load_base_map(base / "map.tif"), **options).check_for(3)
