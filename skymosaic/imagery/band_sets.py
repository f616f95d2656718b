"""Multi-band sets: the files of a capture, one per band, which the ends of their names distinguish."""

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from skymosaic.common.errors import InputError
from skymosaic.imagery.decoding import read_header
from skymosaic.imagery.photographs import Source

# GRE, RED, REG and NIR are Parrot's endings, MS_G to MS_NIR DJI's; MicaSense numbers its files.
BANDS = {
    "blue": ("BLU", "BLUE", "MS_B"),
    "green": ("GRE", "GREEN", "MS_G"),
    "red": ("RED", "MS_R"),
    "red edge": ("REG", "RE", "REDEDGE", "MS_RE"),
    "nir": ("NIR", "MS_NIR"),
}
"""Bands by rising wavelength, and how the names of their files end."""
USUAL = ("green", "2")
"""The band that registers a flight unless another one is named: green is sharp over plants and over soil. Cameras that
number their bands count from blue."""
MIN_CAPTURES = 3
"""A flight of sets has at least this many; two files with numbers at their ends are more likely two photographs."""
_NAMES = {ending: band for band, endings in BANDS.items() for ending in endings}
_NAMED = re.compile(rf"(.+?)_({'|'.join(_NAMES)})", re.IGNORECASE)
_NUMBERED = re.compile(r"(.*\d)_(\d{1,2})")
_COLOUR = re.compile(r"(.+)_(RGB|D)", re.IGNORECASE)
"""Pictures that such cameras take with another sensor, beside the bands."""

_Capture = tuple[Path, str]
"""The folder and the common part of the names."""


def group_band_sets(
    sources: Sequence[Source], band: str | None = None, tell: Callable[[str], None] = lambda _line: None
) -> list[Source]:
    """Group a flight's files by capture: each gets the file of one band as its content, and has those of all bands.

    The band that registers the flight is ``band``; None: green, else the second of numbered bands, else the first.
    Sources that are photographs, not sets, are returned as they are. ``tell`` receives a line about pictures without a
    band.

    Raises
    ------
    InputError
        For a band that most captures lack, bands of different sizes, photographs among sets, and an unknown band.
    """
    captures, others = _group_by_capture(sources)
    if not _are_sets(captures):
        if band is not None:
            raise InputError(f"`band` {band}: the photographs are not multi-band sets; leave it out")
        return list(sources)
    bands = _list_bands(captures)
    colour = [source for source in others if _is_colour(source, captures)]
    if len(colour) < len(others):
        stray = next(source for source in others if source not in colour)
        raise InputError(f"{stray.name}: belongs to no multi-band set, as the others do; put it into another folder")
    if colour:
        tell(f"note {colour[0].name}: {len(colour)} colour pictures belong to no band and are not used")
    registering = _choose_band(band, bands)
    grouped = []
    for index, (capture, files) in enumerate(captures.items()):
        by_band = {name: files.get(name) or _absent(capture, name, captures) for name in bands}
        _check_sizes(files, bands)
        grouped.append(dataclasses.replace(by_band[registering], index=index, bands=by_band))
    return grouped


def select_band(sources: Sequence[Source], band: str | None) -> list[Source]:
    """Select the files of one band of a folder, for a mosaic of it; None: all files, which must not be multi-band sets.

    Raises
    ------
    InputError
        For an unknown band, and for sets if no band is named.
    """
    captures, _ = _group_by_capture(sources)
    if band is not None:
        name = _NAMES.get(band.upper(), band.lower())
        if name not in BANDS and not name.isdecimal():
            raise InputError(f"`band` {band}: valid: {', '.join(BANDS)}, or the number in the files' names")
        wanted = name if name in BANDS else str(int(name))
        return [files[wanted] for files in captures.values() if wanted in files]
    if _are_sets(captures):
        bands = _list_bands(captures)
        raise InputError(
            f"{Path(sources[0].name).parent}: multi-band sets ({', '.join(bands)}); name the band to show: "
            f"`band` {_choose_band(None, bands)}"
        )
    return list(sources)


def _are_sets(captures: Mapping[_Capture, Mapping[str, Source]]) -> bool:
    return len(captures) >= MIN_CAPTURES and max(map(len, captures.values())) > 1


def _group_by_capture(sources: Sequence[Source]) -> tuple[dict[_Capture, dict[str, Source]], list[Source]]:
    """The files of each capture by band, and the files without a band in their names."""
    captures: dict[_Capture, dict[str, Source]] = {}
    others = []
    for source in sources:
        parsed = _parse_name(source.content) if isinstance(source.content, Path) else None
        if parsed is None:
            others.append(source)
        else:
            capture, band = parsed
            captures.setdefault(capture, {})[band] = source
    return captures, others


def _parse_name(path: Path) -> tuple[_Capture, str] | None:
    """The capture and the band of a file; None without a band in its name."""
    if named := _NAMED.fullmatch(path.stem):
        return (path.parent, named[1]), _NAMES[named[2].upper()]
    # Cameras write bands as TIFF; other numbered files are photographs.
    numbered = _NUMBERED.fullmatch(path.stem) if path.suffix.lower() in (".tif", ".tiff") else None
    return ((path.parent, numbered[1]), str(int(numbered[2]))) if numbered else None


def _is_colour(source: Source, captures: dict[_Capture, dict[str, Source]]) -> bool:
    if not isinstance(source.content, Path):
        return False
    match = _COLOUR.fullmatch(source.content.stem)
    return match is not None and (source.content.parent, match[1]) in captures


def _list_bands(captures: Mapping[_Capture, Mapping[str, Source]]) -> list[str]:
    """All bands of the captures, by wavelength, then by number."""
    names = {name for files in captures.values() for name in files}
    known = list(BANDS)
    return sorted(names, key=lambda name: (known.index(name), 0) if name in known else (len(known), int(name)))


def _choose_band(band: str | None, bands: Sequence[str]) -> str:
    if band is None:
        return next((name for name in USUAL if name in bands), bands[0])
    wanted = _NAMES.get(band.upper(), band.lower())
    if wanted not in bands:
        raise InputError(f"`band` {band}: the sets have {', '.join(bands)}; name one of these")
    return wanted


def _absent(capture: _Capture, band: str, captures: Mapping[_Capture, Mapping[str, Source]]) -> Source:
    """The file that a capture lacks, by its name: as a damaged one, it leaves out the capture when it is read."""
    having = [(other, files[band].name) for other, files in captures.items() if band in files]
    if len(having) <= len(captures) / 2:
        raise InputError(
            f"{having[0][1]}: {len(captures) - len(having)} of {len(captures)} captures have no band {band}; put the "
            "files of this band into another folder"
        )
    other, name = having[0]
    path = capture[0] / Path(name).name.replace(other[1], capture[1], 1)
    return Source(0, str(path), path)


def _check_sizes(files: Mapping[str, Source], bands: Sequence[str]) -> None:
    """Check that the bands of a capture have one size."""
    bands = [band for band in bands if band in files]
    sizes = {band: _size_px(files[band]) for band in bands}
    other = next((band for band in bands if sizes[band] != sizes[bands[0]]), None)
    if other is not None:
        raise InputError(
            f"{files[other].name}: {sizes[other][0]}x{sizes[other][1]} pixels, but band {bands[0]} has "
            f"{sizes[bands[0]][0]}x{sizes[bands[0]][1]}; all bands need one size: remove the files of this one"
        )


def _size_px(source: Source) -> tuple[int, int]:
    assert isinstance(source.content, Path)
    try:
        return read_header(source.content).size
    except InputError as error:
        raise InputError(f"{error}, or remove all files of this capture") from None
