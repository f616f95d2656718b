"""Reads folders and patterns by one rule for all commands: which files are photographs, and what else might be."""

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from skymosaic.imagery.images import PICTURE_SUFFIXES
from skymosaic.imagery.own_outputs import exclude_recorded
from skymosaic.imagery.patterns import expand_pattern, walk_folders

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".ts", ".mts", ".m2ts", ".webm", ".wmv", ".mpg", ".mpeg")
"""Suffixes of videos where photographs are accepted too."""
RAW_SUFFIXES = (".dng", ".arw", ".cr2", ".cr3", ".nef", ".orf", ".raf", ".rw2")
OTHER_SUFFIXES = (".heic", ".heif", ".avif", ".jp2", ".jxl", ".gif", ".pgm", ".pnm", ".ppm")
JPEG_SUFFIXES = (".jfif", ".jpe", ".mpo")
"""Other names of JPEG files; MPO is one with further pictures, which cameras write beside a JPEG of the same name."""
REMEDIES = {
    **dict.fromkeys(RAW_SUFFIXES, "develop them as JPEG or TIFF"),
    **dict.fromkeys(OTHER_SUFFIXES, "convert them to JPEG or TIFF"),
    **dict.fromkeys(JPEG_SUFFIXES, "end their names in .jpg"),
    **dict.fromkeys(VIDEO_SUFFIXES, "name one by its file"),
}
"""What to do with files that may be photographs too, by the end of their names."""
LOOKED_INTO = 3
"""How deep folders are looked into for what is not read: more than a camera's, less than a disk."""
NAMED = 5


@dataclass(frozen=True)
class Listing:
    """What a folder holds."""

    pictures: tuple[Path, ...]
    """What is read, by name, 2 before 10; those of folders inside after those of the folder around them."""
    in_folders: dict[str, int]
    """How many pictures the folders inside hold that are not read, by their paths inside the folder."""
    others: dict[str, int]
    """How many files are of a kind that cannot be read, by the ends of their names. Those that a camera writes beside a
    picture of the same name are left out: they show the same."""

    def describe_unread(self, remedy: str = "name them, or add `recursive`") -> str:
        """What is not read and what to do, in one phrase; empty if that is nothing. ``remedy`` is for folders."""
        parts = []
        if self.in_folders:
            named = ", ".join(list(self.in_folders)[:NAMED]) + (", ..." if len(self.in_folders) > NAMED else "")
            parts.append(f"{sum(self.in_folders.values())} pictures in folders inside ({named}): {remedy}")
        parts += [f"{count} {suffix}: {REMEDIES[suffix.lower()]}" for suffix, count in self.others.items()]
        return "; ".join(parts)


def list_pictures(folder: Path, *, recursive: bool = False) -> Listing:
    """List the pictures of a folder; with ``recursive`` also those of all folders inside, else how many these have.

    Hidden files and folders, earlier mosaics, links to folders, and folders with a page for a browser (reports, tiles)
    are passed over.

    Raises
    ------
    InputError
        If the folder cannot be read; with ``recursive``, also if one inside cannot be.
    """
    pictures: list[Path] = []
    in_folders: dict[str, int] = {}
    others: Counter[str] = Counter()
    for place, files in walk_folders(folder, math.inf if recursive else LOOKED_INTO, strict=recursive):
        found = exclude_recorded([file for file in files if file.suffix.lower() in PICTURE_SUFFIXES])
        if place == folder or recursive:
            pictures += found
        elif found:
            in_folders[str(place.relative_to(folder))] = len(found)
        shown = {file.stem for file in found}
        others.update(file.suffix for file in files if file.suffix.lower() in REMEDIES and file.stem not in shown)
    return Listing(tuple(pictures), in_folders, dict(others))


def list_matches(path: Path) -> list[Path]:
    """The files and folders that a name or pattern stands for, without earlier mosaics if there is anything else."""
    matches = expand_pattern(path)
    return exclude_recorded(matches) or matches
