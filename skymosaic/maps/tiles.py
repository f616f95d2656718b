"""Maps for the eye: tiles (XYZ, Web Mercator) with a page that shows them without a network, MBTiles and KMZ."""

import contextlib
import html
import json
import math
import re
import sqlite3
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio.enums
import rasterio.errors
import rasterio.vrt
import rasterio.warp
import rasterio.windows

from golden_model.arrays import Pixels
from golden_model.text import one_line
from skymosaic.common.errors import InputError
from skymosaic.common.temporary import PAGE, staged_folder, write_atomically
from skymosaic.imagery.depth import ValueRange, show_in_8_bit
from skymosaic.maps.georeference import configured_rasterio

TILE_PX = 256
WEBP_QUALITY = 85
KMZ_SIDE_PX = 8192
"""What graphics cards show of one picture."""
_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><name>{name}</name>{content}</Document></kml>"""
_REGION = "<Region><LatLonAltBox>{box}</LatLonAltBox></Region>"
_LINK = f"<NetworkLink>{_REGION}<Link><href>map.kml</href></Link></NetworkLink>"
_OVERLAY = f"{_REGION}<GroundOverlay><Icon><href>map.png</href></Icon><LatLonBox>{{box}}</LatLonBox></GroundOverlay>"
MAX_ZOOM = 24
"""Zoom at which a pixel of Web Mercator is 9 mm; tiles are not finer."""
_HALF_WORLD_M = math.pi * 6_378_137.0
"""Half the side of Web Mercator's square world."""
_MERCATOR = "EPSG:3857"
OWN_NAMES = "|".join([re.escape(PAGE), *map(str, range(MAX_ZOOM + 1))])
"""What a folder of tiles consists of: zooms and the page."""


@dataclass(frozen=True)
class Pyramid:
    """The tiles of a mosaic."""

    georeferenced: bool
    """Whether columns and rows count from Web Mercator's north-west corner, or from the mosaic's."""
    zoom: int
    """The deepest zoom."""
    first: tuple[int, int]
    last: tuple[int, int]
    """Column and row of the first and of the last tile at the deepest zoom."""

    @property
    def top(self) -> int:
        """The deepest zoom at which one tile shows everything."""
        # Each zoom halves the indices; once their differing bits are gone, first and last tile are one.
        apart = max(a ^ b for a, b in zip(self.first, self.last, strict=True))
        return self.zoom - apart.bit_length()


def write_tiles(folder: Path, raster: Path, title: str, values: ValueRange | None) -> Pyramid:
    """Write ``z/x/y.webp`` and ``index.html`` of a raster from `skymosaic.maps.geotiff.tee_to_raster` into a folder.

    It is created if it is missing; tiles of an earlier mosaic in it are removed. ``values`` says how 8 bits show 16.

    Raises
    ------
    InputError
        If a file cannot be written, the raster cannot be read, or it lies beyond Web Mercator.
    """
    written: dict[str, list[int]] = {}
    try:
        with staged_folder(folder, OWN_NAMES) as staged:

            def put(zoom: int, column: int, row: int, tile: bytes) -> None:
                written.setdefault(f"{zoom}/{column}", []).append(row)
                path = staged / str(zoom) / str(column) / f"{row}.webp"
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(tile)

            with configured_rasterio(), rasterio.open(raster) as file:
                pyramid = _cut(file, folder, values, put)
            (staged / PAGE).write_bytes(_render_page(title, pyramid, written))
    except (rasterio.errors.RasterioError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{folder}: tiles cannot be made ({reason}); choose another folder") from None
    return pyramid


def write_mbtiles(path: Path, raster: Path) -> None:
    """Write the same tiles of a raster that has 8 bits and a place into one file of the format MBTiles 1.3.

    Raises
    ------
    InputError
        If the file cannot be written, or the mosaic lies beyond Web Mercator.
    """
    try:
        with write_atomically(path) as made, contextlib.closing(sqlite3.connect(made)) as database, database:
            database.execute("CREATE TABLE metadata (name TEXT PRIMARY KEY, value TEXT)")
            keys = "zoom_level", "tile_column", "tile_row"
            database.execute(f"CREATE TABLE tiles ({', '.join(keys)}, tile_data BLOB, PRIMARY KEY ({', '.join(keys)}))")

            def put(zoom: int, column: int, row: int, tile: bytes) -> None:
                # MBTiles count rows from the south.
                database.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (zoom, column, (1 << zoom) - 1 - row, tile))

            with configured_rasterio(), rasterio.open(raster) as file:
                pyramid = _cut(file, path, None, put)
                bounds = rasterio.warp.transform_bounds(file.crs, "EPSG:4326", *file.bounds)
            about = {
                "name": path.stem, "type": "overlay", "version": 1, "description": path.stem, "format": "webp",
                "bounds": ",".join(map(str, bounds)), "minzoom": pyramid.top, "maxzoom": pyramid.zoom,
            }  # fmt: skip
            database.executemany("INSERT INTO metadata VALUES (?, ?)", about.items())
    except (rasterio.errors.RasterioError, sqlite3.Error) as error:
        raise InputError(f"{path}: cannot be written ({error}); choose another folder") from None


def write_kmz(path: Path, raster: Path) -> None:
    """Write the same raster as one picture for Google Earth, reduced to at most 8192 pixels a side.

    Raises
    ------
    InputError
        As `write_mbtiles`.
    """
    try:
        with configured_rasterio(), rasterio.open(raster) as file:
            _mercator_bounds(file, path)
            with rasterio.vrt.WarpedVRT(file, crs="EPSG:4326", resampling=rasterio.enums.Resampling.cubic) as globe:
                shape = [math.ceil(side / max(1, max(globe.shape) / KMZ_SIDE_PX)) for side in globe.shape]
                average = rasterio.enums.Resampling.average
                pixels = globe.read([3, 2, 1, 4], out_shape=(4, *shape), resampling=average)
                edges = zip(("west", "south", "east", "north"), globe.bounds, strict=True)
        box = "".join(f"<{edge}>{degrees:.10f}</{edge}>" for edge, degrees in edges)
        with write_atomically(path) as made, zipfile.ZipFile(made, "w") as archive:
            # GDAL reads a picture behind a link alone.
            for part, content in (("doc.kml", _LINK), ("map.kml", _OVERLAY)):
                name = html.escape(one_line(path.stem))
                archive.writestr(part, _KML.format(name=name, content=content.format(box=box)))
            archive.writestr("map.png", cv2.imencode(".png", np.moveaxis(pixels, 0, -1))[1].tobytes())
    except rasterio.errors.RasterioError as error:
        raise InputError(f"{path}: cannot be written ({error}); choose another folder") from None


def _cut(file: Any, path: Path, values: ValueRange | None, put: Callable[[int, int, int, bytes], None]) -> Pyramid:
    """Cut an open raster into tiles, each of which ``put`` receives with its zoom, column and row."""
    pyramid = _plan_pyramid(file, path)
    with _warp(file, pyramid) if pyramid.georeferenced else contextlib.nullcontext(file) as source:
        column, row = (index >> (pyramid.zoom - pyramid.top) for index in pyramid.first)
        _Writer(put, source, pyramid, values).write(pyramid.top, column, row)
    return pyramid


def _render_page(title: str, pyramid: Pyramid, rows: dict[str, list[int]]) -> bytes:
    page = (Path(__file__).parent / "viewer.html").read_text(encoding="utf-8")
    facts = {
        "title": title, "georeferenced": pyramid.georeferenced, "tile": TILE_PX, "top": pyramid.top,
        "zoom": pyramid.zoom, "first": pyramid.first, "last": pyramid.last, "rows": rows,
    }  # fmt: skip
    # Unescaped, "</" would end the page's script.
    return page.replace("{facts}", json.dumps(facts).replace("</", "<\\/")).encode()


def _resolution_m(zoom: int) -> float:
    """Metres per pixel in Web Mercator."""
    return 2 * _HALF_WORLD_M / TILE_PX / (1 << zoom)


def _plan_pyramid(file: Any, folder: Path) -> Pyramid:
    """The tiles of a raster, at the zoom nearest to its resolution; ``folder`` is for the message."""
    if file.crs is None:
        columns, rows = (-(-side // TILE_PX) for side in (file.width, file.height))
        return Pyramid(False, (max(columns, rows) - 1).bit_length(), (0, 0), (columns - 1, rows - 1))
    left, bottom, right, top = _mercator_bounds(file, folder)
    # A turned raster fills its bounds only in part.
    box = file.bounds
    stretch = (right - left) * (top - bottom) / ((box.right - box.left) * (box.top - box.bottom))
    finest_m = math.sqrt(stretch * abs(file.transform.determinant))
    # The nearest zoom on a logarithmic scale.
    zoom = min(max(math.ceil(math.log2(_resolution_m(0) / finest_m) - 0.5), 0), MAX_ZOOM)
    side_m = TILE_PX * _resolution_m(zoom)
    west, east = math.floor((left + _HALF_WORLD_M) / side_m), math.ceil((right + _HALF_WORLD_M) / side_m)
    north, south = math.floor((_HALF_WORLD_M - top) / side_m), math.ceil((_HALF_WORLD_M - bottom) / side_m)
    return Pyramid(True, zoom, (west, north), (east - 1, south - 1))


def _mercator_bounds(file: Any, path: Path) -> tuple[float, float, float, float]:
    """Left, bottom, right and top of a raster in Web Mercator, m; raises `InputError` where it has none."""
    left, bottom, right, top = rasterio.warp.transform_bounds(file.crs, _MERCATOR, *file.bounds)
    # The bounds of what crosses 180 degrees go round the world.
    if right - left > _HALF_WORLD_M or max(top, -bottom) > _HALF_WORLD_M:
        raise InputError(
            f"{path}: the mosaic reaches beyond Web Mercator (across 180 degrees of longitude, or past 85 of "
            "latitude), so it has no tiles; a .tif needs none"
        )
    return left, bottom, right, top


def _warp(file: Any, pyramid: Pyramid) -> Any:
    """Open a raster in Web Mercator, on the pixels of the deepest tiles."""
    (west, north), (east, south) = pyramid.first, pyramid.last
    scale_m = _resolution_m(pyramid.zoom)
    left_m, top_m = west * TILE_PX * scale_m - _HALF_WORLD_M, _HALF_WORLD_M - north * TILE_PX * scale_m
    return rasterio.vrt.WarpedVRT(
        file,
        crs=_MERCATOR,
        transform=rasterio.Affine(scale_m, 0, left_m, 0, -scale_m, top_m),
        width=(east - west + 1) * TILE_PX,
        height=(south - north + 1) * TILE_PX,
        resampling=rasterio.enums.Resampling.cubic,
    )


@dataclass(frozen=True, eq=False)
class _Writer:
    """Writes tiles from the deepest zoom upwards, so that each part of the mosaic is read once."""

    put: Callable[[int, int, int, bytes], None]
    source: Any
    pyramid: Pyramid
    values: ValueRange | None

    def write(self, zoom: int, column: int, row: int) -> Pixels | None:
        """Write a tile and all tiles below it; returns the tile."""
        shift = self.pyramid.zoom - zoom
        ranges = zip((column, row), self.pyramid.first, self.pyramid.last, strict=True)
        if any(not first >> shift <= at <= last >> shift for at, first, last in ranges):
            return None
        tile = self._read(column, row) if shift == 0 else self._join_four(zoom + 1, 2 * column, 2 * row)
        if tile is not None:
            encoded = cv2.imencode(".webp", tile, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])[1]
            self.put(zoom, column, row, encoded.tobytes())
        return tile

    def _read(self, column: int, row: int) -> Pixels | None:
        """Read a tile (256, 256, 4), BGRA, of the deepest zoom; None where it is empty."""
        alpha = self.source.count
        channels = [3, 2, 1, alpha] if alpha >= 4 else [1, 1, 1, alpha]
        x, y = (TILE_PX * (at - first) for at, first in zip((column, row), self.pyramid.first, strict=True))
        # Without a georeference, the last tiles extend beyond the mosaic.
        width, height = min(TILE_PX, self.source.width - x), min(TILE_PX, self.source.height - y)
        planes = self.source.read(channels, window=rasterio.windows.Window(x, y, width, height))
        if not planes[-1].any():
            return None
        tile = np.zeros((TILE_PX, TILE_PX, 4), np.uint8)
        tile[:height, :width, :3] = show_in_8_bit(np.moveaxis(planes[:3], 0, -1), self.values)
        # Cubic resampling blurs the edge of the alpha band.
        tile[:height, :width, 3] = np.where(planes[-1] > np.iinfo(planes.dtype).max // 2, 255, 0)
        return tile

    def _join_four(self, zoom: int, column: int, row: int) -> Pixels | None:
        """Make a tile from the four below it, averaged over their visible pixels."""
        sheet = np.zeros((2 * TILE_PX, 2 * TILE_PX, 4), np.uint8)
        for down in (0, 1):
            for across in (0, 1):
                part = self.write(zoom, column + across, row + down)
                if part is not None:
                    sheet[down * TILE_PX :, across * TILE_PX :][:TILE_PX, :TILE_PX] = part
        visible = (sheet[..., 3:] > 0).astype(np.float32)
        if not visible.any():
            return None
        total = cv2.resize(sheet[..., :3] * visible, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA)
        share = cv2.resize(visible, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA)[..., None]
        alpha = np.where(share >= 0.5, 255, 0)
        return np.concatenate((np.rint(total / np.maximum(share, 1e-6)), alpha), axis=-1).astype(np.uint8)
