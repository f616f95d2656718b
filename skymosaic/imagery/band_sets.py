"""Multi-band sets: the files of a capture, one per band, which the ends of their names distinguish."""

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from skymosaic.common.errors import InputError
from skymosaic.imagery.decoding import Header, read_header
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
_NO_SETS = "`band` {}: the photographs are not multi-band sets; leave it out"

_Capture = tuple[Path, str]
"""The folder and the common part of the names."""


def group_band_sets(
    sources: Sequence[Source], band: str | None = None, tell: Callable[[str], None] = lambda _line: None
) -> list[Source]:
    """Group a flight's files by capture: each gets the file of one band as its content, and has those of all bands.

    The band that registers the flight is ``band``; None: green, else the second of numbered bands, else the first.
    Sources that are photographs, not sets, are returned as they are. A capture that lacks a band has a fault. ``tell``
    receives a line about pictures without a band, and one about numbers that might be those of photographs.

    Raises
    ------
    InputError
        For a band that most captures lack, two files of one band, bands in colour or of different sizes, photographs
        among sets, and an unknown band.
    """
    captures, others, repeated = _group_by_capture(sources)
    if not _are_sets(captures):
        if band is not None:
            raise InputError(_NO_SETS.format(band))
        return list(sources)
    _refuse(repeated)
    bands = _list_bands(captures)
    colour = [source for source in others if _is_colour(source, captures)]
    if len(colour) < len(others):
        stray = next(source for source in others if source not in colour)
        raise InputError(f"{stray.name}: belongs to no multi-band set, as the others do; put it into another folder")
    if colour:
        tell(f"note {colour[0].name}: {len(colour)} colour pictures belong to no band and are not used")
    if band is None and (photographs := _if_photographs(captures)):
        count = sum(map(len, captures.values()))
        read_as = f"{count} such files are read as {len(captures)} captures of bands {', '.join(bands)}"
        tell(f"note {sources[0].name}: {read_as}{photographs}")
    registering = _choose_band(band, bands)
    grouped = []
    for index, (capture, files) in enumerate(captures.items()):
        by_band = {name: files.get(name) or _absent(capture, name, captures) for name in bands}
        _check_alike(files, bands)
        grouped.append(dataclasses.replace(by_band[registering], index=index, bands=by_band))
    return grouped


def select_band(sources: Sequence[Source], band: str | None) -> list[Source]:
    """Select the files of one band of a folder, for a mosaic of it; None: all files, which must not be multi-band sets.

    Raises
    ------
    InputError
        For an unknown band, two files of the band, photographs none of which is a band, and for sets if no band is
        named.
    """
    captures, others, repeated = _group_by_capture(sources)
    if band is not None:
        name = _NAMES.get(band.upper(), band.lower())
        if name not in BANDS and not name.isdecimal():
            raise InputError(f"`band` {band}: valid: {', '.join(BANDS)}, or the number in the files' names")
        wanted = name if name in BANDS else str(int(name))
        _refuse([each for each in repeated if each.band == wanted])
        # Of a capture, the colour picture may come first.
        if not captures and not all(_COLOUR.fullmatch(Path(source.name).stem) for source in others):
            raise InputError(_NO_SETS.format(band))
        return [files[wanted] for files in captures.values() if wanted in files]
    if _are_sets(captures):
        bands = _list_bands(captures)
        raise InputError(
            f"{Path(sources[0].name).parent}: multi-band sets ({', '.join(bands)}); name the band to show: "
            f"`band` {_choose_band(None, bands)}{_if_photographs(captures)}"
        )
    return list(sources)


def _are_sets(captures: Mapping[_Capture, Mapping[str, Source]]) -> bool:
    return len(captures) >= MIN_CAPTURES and max(map(len, captures.values())) > 1


class _Repeated(NamedTuple):
    """Two files of one band of a capture."""

    band: str
    first: Source
    second: Source


def _group_by_capture(
    sources: Sequence[Source],
) -> tuple[dict[_Capture, dict[str, Source]], list[Source], list[_Repeated]]:
    """The files of each capture by band, the files without a band in their names, and those whose band has another."""
    captures: dict[_Capture, dict[str, Source]] = {}
    others, repeated = [], []
    for source in sources:
        parsed = _parse_name(source.content) if isinstance(source.content, Path) else None
        if parsed is None:
            others.append(source)
        else:
            capture, band = parsed
            first = captures.setdefault(capture, {}).setdefault(band, source)
            # The same file may be given twice.
            if first.name != source.name:
                repeated.append(_Repeated(band, first, source))
    return captures, others, repeated


def _refuse(repeated: Sequence[_Repeated]) -> None:
    """Raise InputError if there are any."""
    if repeated:
        band, first, second = repeated[0]
        raise InputError(
            f"{first.name} and {second.name}: both are band {band} of one capture; put one of them into another folder"
        )


def _parse_name(path: Path) -> tuple[_Capture, str] | None:
    """The capture and the band of a file; None without a band in its name."""
    if named := _NAMED.fullmatch(path.stem):
        return (path.parent, named[1]), _NAMES[named[2].upper()]
    # Cameras write bands as TIFF of one channel; other numbered files are photographs.
    numbered = _NUMBERED.fullmatch(path.stem) if path.suffix.lower() in (".tif", ".tiff") else None
    return ((path.parent, numbered[1]), str(int(numbered[2]))) if numbered and _may_be_gray(path) else None


def _may_be_gray(path: Path) -> bool:
    """Whether a file is gray, or cannot be read, which is said when it is."""
    try:
        return _is_gray(path, path.stat().st_mtime_ns)
    except (InputError, OSError, ValueError):
        return True


# Cached, because a live mosaic lists its folder several times a second.
@lru_cache(maxsize=1 << 16)
def _is_gray(path: Path, _changed_ns: int) -> bool:
    return read_header(path).gray


def _if_photographs(captures: Mapping[_Capture, Mapping[str, Source]]) -> str:
    """What to do with files that a number makes bands, if they are photographs; empty where names say more."""
    numbered = (files[name] for files in captures.values() for name in files if name.isdecimal())
    if (first := next(numbered, None)) is None:
        return ""
    return f"; if the files are photographs, rename them, as {'-'.join(Path(first.name).name.rsplit('_', 1))}"


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
    """Stands for the file that a capture lacks: a file of it, with the fault that leaves out the capture."""
    having = [files[band] for files in captures.values() if band in files]
    if len(having) <= len(captures) / 2:
        raise InputError(
            f"{having[0].name}: {len(captures) - len(having)} of {len(captures)} captures have no band {band}; put the "
            "files of this band into another folder"
        )
    own = next(iter(captures[capture].values()))
    fault = f"{own.name}: its capture has no band {band}, which {len(having)} of {len(captures)} have"
    return dataclasses.replace(own, fault=fault + _if_photographs({capture: captures[capture]}))


def _check_alike(files: Mapping[str, Source], bands: Sequence[str]) -> None:
    """Check that the bands of a capture are gray and have one size."""
    headers = {band: _header_of(files[band]) for band in bands if band in files}
    first = next(iter(headers))
    for band, header in headers.items():
        if not header.gray:
            raise InputError(f"{files[band].name}: in colour, but a band is gray; put it into another folder")
        if header.size != headers[first].size:
            sizes = "{}x{} pixels, but band {} has {}x{}".format(*header.size, first, *headers[first].size)
            raise InputError(f"{files[band].name}: {sizes}; all bands need one size: remove the files of this one")


def _header_of(source: Source) -> Header:
    assert isinstance(source.content, Path)
    try:
        return read_header(source.content)
    except InputError as error:
        raise InputError(f"{error}, or remove all files of this capture") from None
