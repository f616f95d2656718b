"""Multi-band sets: files of one capture, one for each band, told apart by the ends of their names."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from skymosaic.errors import InputError
from skymosaic.imagery.decoding import read_header
from skymosaic.imagery.photographs import Source

BANDS = {
    "blue": ("BLU", "BLUE", "MS_B"),
    "green": ("GRE", "GREEN", "MS_G"),
    "red": ("RED", "MS_R"),
    "red edge": ("REG", "RE", "REDEDGE", "MS_RE"),
    "nir": ("NIR", "MS_NIR"),
}
"""Bands by rising wavelength, and how the names of their files end."""
USUAL = ("green", "2")
"""The band that registers a flight unless another one is named: sharp over plants and over soil. Cameras that number
their bands count from blue."""
MIN_CAPTURES = 3
"""Of a flight of sets. Two files whose names end in numbers are more likely two photographs."""
_NAMES = {ending: band for band, endings in BANDS.items() for ending in endings}
_NAMED = re.compile(rf"(.+?)_({'|'.join(_NAMES)})", re.IGNORECASE)
_NUMBERED = re.compile(r"(.*\d)_(\d{1,2})")
_COLOUR = re.compile(r"(.+)_(RGB|D)", re.IGNORECASE)
"""Pictures that such cameras take beside the bands, by another sensor."""

_Capture = tuple[Path, str]
"""The folder and the common part of the names."""


def group_band_sets(
    sources: Sequence[Source], band: str | None = None, tell: Callable[[str], None] = lambda _line: None
) -> list[Source]:
    """The captures of a flight: each has the file of one band as its content, and those of all bands beside it.

    Parameters
    ----------
    sources : sequence of Source
    band : str or None
        The one that registers the flight; None: green, or the second one of numbered bands, or the first.
    tell : callable
        Receives a line about pictures that are no bands.

    Returns
    -------
    list of Source
        The given ones if they are photographs and no sets.

    Raises
    ------
    InputError
        For a capture without one of the bands, bands of different sizes, photographs among sets, and a band that
        does not exist.
    """
    captures, others = _grouped(sources)
    if not _are_sets(captures):
        if band is not None:
            raise InputError(f"band {band}: the photographs are not multi-band sets; leave out --band")
        return list(sources)
    bands = _in_order({name for files in captures.values() for name in files})
    colour = [source for source in others if _is_colour(source, captures)]
    if len(colour) < len(others):
        stray = next(source for source in others if source not in colour)
        raise InputError(f"{stray.name}: belongs to no multi-band set, as the others do; put it into another folder")
    if colour:
        tell(f"note {colour[0].name}: {len(colour)} colour pictures belong to no band and are not used")
    first = _registering(band, bands)
    return [
        dataclasses.replace(_checked(capture, files, bands)[first], index=index, bands={b: files[b] for b in bands})
        for index, (capture, files) in enumerate(captures.items())
    ]


def select_band(sources: Sequence[Source], band: str | None) -> list[Source]:
    """The files of one band, for what shows one band only.

    Parameters
    ----------
    sources : sequence of Source
        Of one folder.
    band : str or None
        None: all files, which must not be multi-band sets.

    Raises
    ------
    InputError
        For a name that no band has, and for sets without one.
    """
    captures, _ = _grouped(sources)
    if band is not None:
        name = _NAMES.get(band.upper(), band.lower())
        if name not in BANDS and not name.isdecimal():
            raise InputError(f"band {band}: valid: {', '.join(BANDS)}, or the number in the files' names")
        wanted = name if name in BANDS else str(int(name))
        return [files[wanted] for files in captures.values() if wanted in files]
    if _are_sets(captures):
        bands = _in_order({name for files in captures.values() for name in files})
        raise InputError(
            f"{Path(sources[0].name).parent}: multi-band sets ({', '.join(bands)}), of which one band can be shown; "
            f"name it: --band {_registering(None, bands)}"
        )
    return list(sources)


def _are_sets(captures: Mapping[_Capture, Mapping[str, Source]]) -> bool:
    return len(captures) >= MIN_CAPTURES and max(map(len, captures.values())) > 1


def _grouped(sources: Sequence[Source]) -> tuple[dict[_Capture, dict[str, Source]], list[Source]]:
    """The files of each capture by band, and what has no band in its name."""
    captures: dict[_Capture, dict[str, Source]] = {}
    others = []
    for source in sources:
        found = _capture_and_band(source)
        if found is None:
            others.append(source)
        else:
            captures.setdefault(found[0], {})[found[1]] = source
    return captures, others


def _capture_and_band(source: Source) -> tuple[_Capture, str] | None:
    path = source.content
    if not isinstance(path, Path):
        return None
    if named := _NAMED.fullmatch(path.stem):
        return (path.parent, named[1]), _NAMES[named[2].upper()]
    numbered = _NUMBERED.fullmatch(path.stem) if path.suffix.lower() in (".tif", ".tiff") else None
    return ((path.parent, numbered[1]), str(int(numbered[2]))) if numbered else None


def _is_colour(source: Source, captures: dict[_Capture, dict[str, Source]]) -> bool:
    path = source.content
    found = _COLOUR.fullmatch(path.stem) if isinstance(path, Path) else None
    return found is not None and isinstance(path, Path) and (path.parent, found[1]) in captures


def _in_order(names: set[str]) -> list[str]:
    """By wavelength, then by number."""
    known = list(BANDS)
    return sorted(names, key=lambda name: (known.index(name), 0) if name in known else (len(known), int(name)))


def _registering(band: str | None, bands: Sequence[str]) -> str:
    if band is None:
        return next((name for name in USUAL if name in bands), bands[0])
    wanted = _NAMES.get(band.upper(), band.lower())
    if wanted not in bands:
        raise InputError(f"band {band}: the sets have {', '.join(bands)}; name one of these")
    return wanted


def _checked(capture: _Capture, files: dict[str, Source], bands: Sequence[str]) -> dict[str, Source]:
    """The files of a capture, of which none is missing and all have one size."""
    missing = [band for band in bands if band not in files]
    if missing:
        raise InputError(
            f"{capture[0] / capture[1]}: band {', '.join(missing)} is missing; copy it again from the camera, or "
            "remove the other files of this capture"
        )
    sizes = {band: _size_px(files[band]) for band in bands}
    other = next((band for band in bands if sizes[band] != sizes[bands[0]]), None)
    if other is not None:
        raise InputError(
            f"{files[other].name}: {sizes[other][0]}x{sizes[other][1]} pixels, but band {bands[0]} has "
            f"{sizes[bands[0]][0]}x{sizes[bands[0]][1]}; all bands need one size: remove the files of this one"
        )
    return files


def _size_px(source: Source) -> tuple[int, int]:
    assert isinstance(source.content, Path)
    return read_header(source.content).size
