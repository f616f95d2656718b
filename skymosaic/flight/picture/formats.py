"""The kinds of files that a mosaic is written as: what each can hold, how large it may be, and what writes it.

A further kind is a row of `FORMATS` and its writer.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from golden_model.arrays import Intensities, Pixels
from skymosaic.common.errors import InputError
from skymosaic.flight.picture.composition import Composition, Room
from skymosaic.imagery.band_writer import write_png
from skymosaic.imagery.images import check_suffix, save
from skymosaic.maps.geotiff import COMPRESSIONS, Shown, write_cog
from skymosaic.maps.tiles import write_kmz, write_mbtiles

BYTES_PER_SAMPLE = 6
"""Two bytes in the plain raster, its overviews, and as much again in the finished file."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture on its way into a file."""

    composition: Composition
    bands: Iterable[tuple[Intensities, Shown]]
    """Whole rows from the top, rendered as they are asked for, each with the photographs that it shows."""
    raster: Path
    """A plain GeoTIFF of all bands, complete, for kinds that are ``on_map``; the bands have ended then."""
    compress: str
    of_two: bool
    """Whether two photographs make it, whose picture fits in memory."""

    def in_8_bit(self) -> Iterator[Pixels]:
        """The bands in 8 bits, alone."""
        return (self.composition.in_8_bit(pixels) for pixels, _ in self.bands)


def _write_whole(path: Path, picture: Picture) -> None:
    save(path, np.concatenate([*picture.in_8_bit()]))


def _write_png(path: Path, picture: Picture) -> None:
    # OpenCV's writer compresses better, but takes the whole picture.
    if picture.of_two:
        _write_whole(path, picture)
    else:
        composition = picture.composition
        write_png(path, composition.size, 3 if composition.coloured else 1, picture.in_8_bit())


@dataclass(frozen=True)
class Format:
    """A kind of file."""

    suffixes: tuple[str, ...]
    write: Callable[[Path, Picture], None]
    max_side_px: int = Room.side_px
    in_memory: bool = True
    """Whether it is written from a whole picture in memory; otherwise it may become as large as the disk."""
    on_map: bool = False
    """Whether it says where on the map the mosaic lies, and is written from a plain GeoTIFF with all bits and bands."""
    only_map: bool = False
    """Whether it cannot be without that place; the GeoTIFF has 8 bits of three colours then."""
    any_bands: bool = False
    """Whether it holds other bands than gray or colour."""
    compressions: tuple[str, ...] = ()
    """Where it can be compressed in several ways."""


FORMATS = (
    Format((".png",), _write_png, in_memory=False),
    Format((".jpg", ".jpeg"), _write_whole, max_side_px=65_500),
    Format(
        (".tif", ".tiff"),
        lambda path, picture: write_cog(path, picture.raster, picture.compress),
        in_memory=False,
        on_map=True,
        any_bands=True,
        compressions=COMPRESSIONS,
    ),
    Format((".mbtiles",), lambda path, it: write_mbtiles(path, it.raster), in_memory=False, on_map=True, only_map=True),
    Format((".kmz",), lambda path, it: write_kmz(path, it.raster), in_memory=False, on_map=True, only_map=True),
    Format((".webp",), _write_whole, max_side_px=16_383),
    Format((".bmp",), _write_whole),
)
_BY_SUFFIX = {suffix: each for each in FORMATS for suffix in each.suffixes}


def format_of(path: Path) -> Format:
    """The kind of file that a name means; raises `InputError` for another one."""
    check_suffix(path, _BY_SUFFIX)
    return _BY_SUFFIX[path.suffix.lower()]


def room_for(path: Path, planes: int) -> Room:
    """How large the mosaic of a flight may become in a file of this name, with ``planes`` bands, alpha included."""
    kind, free_bytes = format_of(path), shutil.disk_usage(path.parent).free
    # No file of a picture in memory is larger than the pixels.
    area_px = free_bytes / planes if kind.in_memory else free_bytes / (BYTES_PER_SAMPLE * planes)
    if kind.in_memory and area_px >= Room.area_px:
        reason = f"{path.suffix} files have limits and the picture is in memory; a .tif has room for more"
        return Room(side_px=kind.max_side_px, reason=reason)
    return Room(area_px, kind.max_side_px, f"the disk has {free_bytes >> 20} MB left")


def check_size(path: Path, size: tuple[int, int]) -> None:
    """Raise `InputError` for a mosaic that a file of this name cannot hold, once its width and height are known."""
    max_side_px = format_of(path).max_side_px
    if max(size) > max_side_px:
        raise InputError(
            f"{path}: {size[0]}x{size[1]} cannot be stored as {path.suffix}, whose sides have at most "
            f"{max_side_px:,} pixels; use .png or .tif"
        )


def too_deep_for_jpeg(path: Path) -> InputError:
    """The error for a mosaic of 16 bits that is to be compressed as JPEG."""
    return InputError(f"{path}: JPEG holds 8 bits, the photographs have 16; leave out the compression")


@dataclass(frozen=True)
class OutputForm:
    """How a mosaic is written."""

    compress: str = "deflate"
    """Compression of a GeoTIFF: deflate or jpeg."""
    tiles: Path | None = None
    """Folder for map tiles and a page that shows them."""
    require_map: bool = False
    """Write nothing without a place on the map."""
    sources: bool = False
    """Write which photograph each pixel shows into a second file, `sources_of` the first."""

    def check(self, path: Path, bands: int = 0) -> None:
        """Refuse what cannot apply to a file, before anything is computed; ``bands`` is 0 but for multi-band mosaics.

        Raises
        ------
        InputError
            For an unknown kind of file, an unsuitable compression, a file that cannot be a map, or bands that do not
            fit.
        """
        kind = format_of(path)
        if self.compress not in COMPRESSIONS:
            raise InputError(f"`compress` is {self.compress!r}; valid: {', '.join(COMPRESSIONS)}")
        if bands and not kind.any_bands:
            raise InputError(f"{path}: a mosaic of {bands} bands must be a .tif")
        if bands and (self.compress != "deflate" or self.tiles):
            raise InputError("compression and tiles are for photographs, not for multi-band sets; leave them out")
        if self.compress not in ("deflate", *kind.compressions):
            raise InputError(f"{path}: {self.compress} compression is for .tif; leave it out, or end the name in .tif")
        if self.require_map and not kind.on_map and self.tiles is None:
            raise InputError(f"{path}: {path.suffix} files are no maps, and a map is required; end the name in .tif")

    def needs_place(self, path: Path) -> bool:
        """Whether nothing is written into a file of this name without a place on the map."""
        return self.require_map or format_of(path).only_map

    def numbered(self, number: int) -> OutputForm:
        """The form of one of several mosaics, counted from 1."""
        return self if self.tiles is None else replace(self, tiles=numbered(self.tiles, number))


PLAIN = OutputForm()


def sources_of(path: Path) -> Path:
    """The file that says which photograph each pixel of a mosaic shows."""
    return path.with_name(f"{path.stem}.sources.tif")


def numbered(path: Path, number: int) -> Path:
    """The name of one of several outputs, counted from 1."""
    return path if number == 1 else path.with_stem(f"{path.stem}_{number}")
