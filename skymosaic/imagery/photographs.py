"""Lists the photographs of a flight, and decodes their pixels when they are needed."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from golden_model.arrays import Intensities, Pixels
from golden_model.small_files import open_regular
from skymosaic.common.errors import InputError, reading
from skymosaic.imagery.decoding import check_file
from skymosaic.imagery.depth import ValueRange
from skymosaic.imagery.exif import Metadata, read_metadata
from skymosaic.imagery.folders import list_matches, list_pictures
from skymosaic.imagery.images import PICTURE_SUFFIXES, Image, Photograph, check_given, load
from skymosaic.imagery.lens import Lens
from skymosaic.imagery.own_outputs import exclude_recorded
from skymosaic.imagery.patterns import is_folder

Images = Image | Iterable[Image]
"""Photographs as users give them: files, folders, patterns and arrays, one or several."""


Shown = tuple[Intensities, Pixels | None]
"""Pixels of a photograph, and 255 where they show something, 0 elsewhere; None: 255 everywhere."""


@dataclass(frozen=True, eq=False)
class Source:
    """A photograph of a flight: a file, or an array of pixels."""

    index: int
    """Index among the given photographs."""
    name: str
    """The file as given, or ``"image N"``."""
    content: Path | Pixels
    """A file, or pixels: gray (H, W) or BGR (H, W, 3)."""
    keep_damaged: bool = False
    """Use a damaged file as far as it can be decoded."""
    bands: Mapping[str, Source] = field(default_factory=dict)
    """All bands of a multi-band set, in the order of the output; empty for a photograph."""
    fault: str = ""
    """Why it cannot be used, where that is known before it is read; else empty."""
    folder: Path | None = None
    """The folder that was given and has it, perhaps in a folder inside; None where it was named itself."""
    taken: Metadata | None = None
    """How it was taken, where its file does not say that."""

    @property
    def files(self) -> tuple[Path, ...]:
        """All its files; none for an array."""
        contents = [source.content for source in self.bands.values()] or [self.content]
        return tuple(content for content in contents if isinstance(content, Path))

    @property
    def folders(self) -> tuple[Path, ...]:
        """Where the next run finds it: the folder that was given, or those of its files."""
        return tuple(path.parent for path in self.files) if self.folder is None else (self.folder,)

    def with_damaged(self, *, keep: bool) -> Source:
        """The same source, which uses damaged files as far as they can be decoded, or refuses them."""
        bands = {band: source.with_damaged(keep=keep) for band, source in self.bands.items()}
        return dataclasses.replace(self, keep_damaged=keep, bands=bands)

    def read_metadata(self) -> Metadata:
        """How it was taken, as far as that is known."""
        if self.taken is not None:
            return self.taken
        return read_metadata(self.content) if isinstance(self.content, Path) else Metadata()

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the file or array, whatever the file's name.

        Raises
        ------
        InputError
            For a file that cannot be read, or a source with a fault.
        """
        if self.fault:
            raise InputError(self.fault)
        if isinstance(self.content, Path):
            return self._first_read[0]
        return hashlib.sha256(repr(self.content.shape).encode() + self.content.tobytes()).hexdigest()

    @cached_property
    def _first_read(self) -> tuple[str, tuple[int, ...]]:
        """The digest of a file, and by what one sees without reading it that it may have changed since."""
        assert isinstance(self.content, Path)
        check_file(self.content, "an image")
        with reading(self.name, "check the file"), open(self.content, "rb", opener=open_regular) as file:
            state = _state_of(os.fstat(file.fileno()))
            return hashlib.file_digest(file, "sha256").hexdigest(), state

    @property
    def change(self) -> str:
        """Why a file is no longer the photograph that it was when its digest was computed; empty if it is."""
        for source in self.bands.values() or [self]:
            if not isinstance(source.content, Path):
                continue
            digest, state = source._first_read
            try:
                if _state_of(source.content.stat()) != state and dataclasses.replace(source).digest != digest:
                    return f"{source.name}: was replaced after it had been read"
            except (InputError, OSError):
                return f"{source.name}: was removed after it had been read"
        return ""

    def read_photograph(self, lens: Lens, values: ValueRange | None = None) -> Photograph:
        """Decode the photograph, turn it upright and remove the lens's distortion.

        Raises
        ------
        InputError
            As in `skymosaic.imagery.images.load`.
        """
        decoded = load(self.content, self.name, values, keep_damaged=self.keep_damaged)
        lens = lens.turned(decoded.orientation)
        pixels: Any = lens.straighten(decoded.pixels)
        visible = None if decoded.visible is None else lens.straighten_mask(decoded.visible)
        return dataclasses.replace(decoded, name=self.name, pixels=pixels, visible=visible)


def _state_of(status: os.stat_result) -> tuple[int, ...]:
    return status.st_ino, status.st_size, status.st_mtime_ns


def list_images(images: Images) -> list[Image]:
    """What was given, one by one; a pattern such as ``flight/*.jpg`` stands for what it matches but earlier mosaics.

    Raises
    ------
    InputError
        For what is neither a path nor an array of a photograph's pixels.
    """
    # An array of four dimensions is a stack of photographs, with fewer it is one.
    if isinstance(images, str | Path) or (isinstance(images, np.ndarray) and images.ndim < 4):
        images = [images]
    listed: list[Image] = []
    for image in images if isinstance(images, Iterable) else [images]:
        check_given(image, f"image {len(listed)}")
        listed += list_matches(Path(image)) if isinstance(image, str | Path) else [image]
    return listed


def list_sources(
    images: Images, tell: Callable[[str], None] = lambda _line: None, *, recursive: bool = False
) -> list[Source]:
    """List files, arrays and the pictures of folders, see `skymosaic.imagery.folders.list_pictures`.

    ``tell`` receives a line for each folder with more than is read, and for each earlier mosaic that was named.

    Raises
    ------
    InputError
        As in `list_images`, and for a folder without pictures. Files are checked later, so that one bad file does not
        stop a flight.
    """
    found: list[tuple[Path | Pixels, Path | None]] = []
    for image in list_images(images):
        if not isinstance(image, str | Path):
            found.append((image, None))
        elif is_folder(path := Path(image)):
            found += [(picture, path) for picture in _read_folder(path, tell, recursive=recursive)]
        else:
            found.append((path, None))
            if not exclude_recorded([path]):
                tell(f"note {path}: an earlier mosaic, used because it is named; leave it out to have photographs only")
    return [
        Source(index, str(content) if isinstance(content, Path) else f"image {index}", content, folder=folder)
        for index, (content, folder) in enumerate(found)
    ]


def _read_folder(folder: Path, tell: Callable[[str], None], *, recursive: bool) -> Sequence[Path]:
    """The pictures of a folder, of which there must be one; what else it has is told, or is part of the error."""
    listing = list_pictures(folder, recursive=recursive)
    unread = listing.describe_unread()
    if not listing.pictures:
        remedy = unread or "choose another folder"
        raise InputError(f"{folder}: contains no pictures ({', '.join(PICTURE_SUFFIXES)}); {remedy}")
    if unread:
        tell(f"note {folder}: not read: {unread}")
    return listing.pictures


def short_names(names: Sequence[str]) -> list[str]:
    """Names of files without their folders, or with as many of them as tell all files apart."""
    parts = [Path(name).parts for name in names]
    for depth in range(1, max(map(len, parts), default=0) + 1):
        short = ["/".join(each[-depth:]) for each in parts]
        if len(set(short)) == len(short):
            return short
    return list(names)


def index_names(photographs: Sequence[str]) -> Callable[[str], list[int]]:
    """Make a function that finds the photographs whose paths end in a name.

    The name may have folders; upper and lower case are the same.
    """
    paths = [Path(photograph.lower()) for photograph in photographs]
    by_file: defaultdict[str, list[int]] = defaultdict(list)
    for index, path in enumerate(paths):
        by_file[path.name].append(index)

    def find(name: str) -> list[int]:
        wanted = Path(name.lower().replace("\\", "/"))
        length = len(wanted.parts)
        return [index for index in by_file.get(wanted.name, ()) if paths[index].parts[-length:] == wanted.parts]

    return find


_Key = tuple[str, str, bool, ValueRange | None]


def _key(source: Source, lens: Lens, values: ValueRange | None) -> _Key:
    return source.digest, lens.key, source.keep_damaged, values


class DecodedPhotographs:
    """Cache of the decoded photographs used last, up to ``limit_bytes``; a larger one is never kept; thread-safe."""

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._pixels: OrderedDict[_Key, Shown] = OrderedDict()
        self._lock = Lock()

    @property
    def size_bytes(self) -> int:
        """Bytes in the cache now."""
        return sum(part.nbytes for shown in self._pixels.values() for part in shown if part is not None)

    def pixels(self, source: Source, lens: Lens, values: ValueRange | None = None) -> Shown:
        """The straightened pixels of ``source``, and which show something; as `Source.read_photograph`."""
        key = _key(source, lens, values)
        with self._lock:
            if key in self._pixels:
                self._pixels.move_to_end(key)
                return self._pixels[key]
        # Outside the lock, so that threads decode different photographs at the same time.
        read = source.read_photograph(lens, values)
        shown = read.pixels, read.visible
        # Afterwards, so that no change is missed.
        if source.change:
            raise InputError(f"{source.change}; make the mosaic again")
        self.keep(source, lens, shown, values)
        return shown

    def keep(self, source: Source, lens: Lens, shown: Shown, values: ValueRange | None = None) -> None:
        """Keep straightened pixels of ``source`` that are decoded already, and drop the oldest beyond the limit."""
        with self._lock:
            self._pixels[_key(source, lens, values)] = shown
            while self.size_bytes > self._limit_bytes:
                self._pixels.popitem(last=False)


@lru_cache(maxsize=1)
def decoded_photographs(limit_bytes: int) -> DecodedPhotographs:
    """The photographs that this process keeps decoded, for the tiles that it renders."""
    return DecodedPhotographs(limit_bytes)


def forget_decoded() -> None:
    """Release the memory of all decoded photographs of this process."""
    decoded_photographs.cache_clear()
