"""Reads photographs and writes pictures, and gives every faulty file one clear message."""

import contextlib
import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Array, Intensities, Pixels
from golden_model.config import MAX_FRAME_PX, MIN_FRAME_PX
from golden_model.temporary import is_lock
from skymosaic.common.brief import brief
from skymosaic.common.errors import InputError, reading
from skymosaic.common.replaced import refuse_inputs
from skymosaic.common.temporary import existing_parent, expect_new, write_atomically
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.decoding import check_size, decode, read_header
from skymosaic.imagery.depth import ValueRange, measure_range, sample_values
from skymosaic.imagery.orientation import UPRIGHT
from skymosaic.imagery.patterns import only_match

Image = str | Path | Pixels
"""A photograph as users give it."""
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp")
FIRST_PAGE = "only the first"
"""How the note begins which says that a file has more pages than are read."""


@brief
@dataclass(frozen=True)
class Photograph:
    """A decoded photograph."""

    name: str
    """The file as given, or ``"image N"`` for an array."""
    pixels: Pixels
    """Gray (H, W) or BGR (H, W, 3), turned upright by the EXIF orientation; 16 bits only of a deep range."""
    notes: tuple[str, ...] = ()
    """Changes made to the file's pixels, for instance a rotation."""
    value_range: ValueRange | None = None
    """The range that 8 bits show, for a file of more than 8 bits."""
    sample: NDArray[np.generic] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """Values of a file of more than 8 bits, from `skymosaic.imagery.depth.sample_values`; else empty."""
    visible: Pixels | None = None
    """0 where the file has no data or is transparent, else 255, (H, W); None: 255 everywhere."""
    orientation: int = UPRIGHT
    """The EXIF orientation by which it was turned upright."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.pixels.shape[1], self.pixels.shape[0]

    def without_pixels(self) -> "Photograph":
        """The same photograph with all its numbers."""
        return replace(self, pixels=without_channels(self.pixels))


def without_channels(image: Pixels) -> Pixels:
    """The image without what it shows, (H, W, 0): it takes no memory, and still has its size."""
    return np.zeros((*image.shape[:2], 0), np.uint8)


def load(
    source: str | Path | Pixels,
    name: str = "image",
    values: ValueRange | None = None,
    *,
    keep_damaged: bool = False,
    min_side_px: int = MIN_FRAME_PX,
) -> Photograph:
    """Read a file, or check an array of pixels.

    Parameters
    ----------
    name : str
        Name of an array, for messages.
    values : ValueRange or None
        The range of a whole flight, by which more than 8 bits are mapped, or kept where it is deep; None: the file's.
    keep_damaged : bool
        Accept a damaged JPEG or TIFF with a note, as far as it can be decoded.
    min_side_px : int
        Smaller pictures are refused.

    Returns
    -------
    Photograph
        More than 8 bits are mapped linearly; of the file's own range, the outer 0.1 % at each end saturate.

    Raises
    ------
    InputError
        Missing, empty, truncated, damaged, not an image, of an unsupported depth, or of an unsupported size.
    """
    check_given(source, name)
    if isinstance(source, str | Path):
        return _read(only_match(Path(source)), values, keep_damaged=keep_damaged, min_side_px=min_side_px)
    check_size(name, source.shape[1], source.shape[0], min_side_px)
    return Photograph(name, source)


def check_given(source: Image, name: str) -> None:
    """Check the type of what is given as a photograph, and the type and shape of an array; `load` checks the rest.

    Raises
    ------
    InputError
        For what can be no photograph.
    """
    if isinstance(source, str | Path):
        return
    if not isinstance(source, np.ndarray):
        raise InputError(f"{name}: {type(source).__name__} is no photograph; give a path, or an array of pixels")
    if source.dtype != np.uint8 or source.ndim not in (2, 3) or (source.ndim == 3 and source.shape[2] != 3):
        raise InputError(
            f"{name}: an array of {source.dtype}, shape {source.shape}; give uint8 of shape (H, W) or (H, W, 3) BGR"
        )


def _read(path: Path, values: ValueRange | None, *, keep_damaged: bool, min_side_px: int) -> Photograph:
    header = read_header(path, min_side_px)
    decoded, visible, damage, colours = decode(path, header, keep_damaged=keep_damaged)
    turned = "turned upright by its EXIF orientation" if header.orientation != UPRIGHT else ""
    hidden = "" if visible is None else f"{np.mean(visible == 0):.1%} has no data or is transparent, and no ground"
    paged = f"{FIRST_PAGE} of {header.pages} pages is read" if header.pages > 1 else ""
    kept = f"kept although {damage.removeprefix(f'{path}: ')}" if damage else ""
    notes = tuple(filter(None, (turned, hidden, paged, colours, kept)))
    read = Photograph(str(path), np.asarray(decoded), notes, visible=visible, orientation=header.orientation)
    if decoded.dtype == np.uint8 or (values is not None and values.deep and decoded.dtype == np.uint16):
        return read
    own = values or measure_range(decoded, str(path))
    mapping = f"{decoded.dtype}: {own.low:g}..{own.high:g} mapped to 0..255"
    pixels, sample = own.to_8_bit(decoded), sample_values(decoded)
    return replace(read, pixels=pixels, notes=(*notes, mapping), value_range=own, sample=sample)


def reduce_to_width(pixels: Pixels, width_px: int) -> tuple[Pixels, Array]:
    """Reduce an image by area averaging to at most ``width_px``; a narrower one stays as it is.

    The height is limited too: to twice ``width_px``, and to the front end's maximum. Returns also the map (3, 3) from
    reduced pixels to original ones.
    """
    height, width = pixels.shape[:2]
    height_px = min(2 * width_px, MAX_FRAME_PX)
    if width <= width_px and height <= height_px:
        return pixels, np.eye(3)
    size = (width_px, max(round(height * width_px / width), 1))
    if size[1] > height_px:
        size = (max(round(width * height_px / height), 1), height_px)
    to_original = resize_matrix(width / size[0], height / size[1])
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False), to_original


def reduce_for_front_end(original: Pixels, width_px: int, name: str) -> tuple[Pixels, Array]:
    """As `reduce_to_width`, and check that the front end takes the result; ``name`` is for the message.

    Raises
    ------
    InputError
        If a side becomes too short for the front end.
    """
    pixels, to_original = reduce_to_width(original, width_px)
    height, width = pixels.shape[:2]
    if min(width, height) < MIN_FRAME_PX:
        raise InputError(
            f"{name}: {original.shape[1]}x{original.shape[0]} is reduced to {width}x{height}; both sides need "
            f"{MIN_FRAME_PX} pixels: raise the working width, or crop the picture"
        )
    return pixels, to_original


def check_suffix(path: Path, suffixes: Collection[str]) -> None:
    """Raise `InputError` for a name that ends in none of ``suffixes``."""
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: unknown kind of file; end the name in one of {', '.join(suffixes)}")


def check_output(
    path: Path, inputs: Sequence[Path] = (), suffixes: Collection[str] = (), *, overwrite: bool = False
) -> None:
    """Check that an output file can be written, before the work starts.

    Without ``suffixes`` its name may end in anything.

    Raises
    ------
    InputError
        For an unknown suffix, a folder that is missing or not writable, one of the ``inputs``, or a file that exists
        and must not be overwritten.
    """
    if suffixes:
        check_suffix(path, suffixes)
    if not path.parent.is_dir():
        raise InputError(f"{path}: its folder does not exist; create it first")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: cannot be written; choose another folder")
    refuse_inputs(path, inputs)
    check_unused(path, overwrite=overwrite)


def check_output_folder(path: Path, inputs: Sequence[Path] = (), own: str = "", *, overwrite: bool = False) -> None:
    """Check that a folder can be made or filled, and keeps the inputs, before the work starts.

    ``own`` is a regular expression of the names in it that will be replaced.

    Raises
    ------
    InputError
        For a file, a place where nothing can be written, a folder with files that must not be overwritten, or one in
        which an input would be replaced.
    """
    if os.path.lexists(path) and not path.is_dir():
        raise InputError(f"{path}: is no folder; name another")
    place = path if path.is_dir() else existing_parent(path)
    if not place.is_dir() or not os.access(place, os.W_OK):
        raise InputError(f"{path}: cannot be made in {place}; choose another folder")
    if own:
        refuse_inputs(path, inputs, own)
    check_unused(path, overwrite=overwrite)


def check_unused(path: Path, *, overwrite: bool) -> None:
    """Check that nothing is overwritten: ``path`` does not exist, is an empty folder, or may be overwritten.

    Unless it may, what appears there later is not overwritten either.

    Raises
    ------
    InputError
        If something would be overwritten, or the folder cannot be read.
    """
    with reading(path, "choose another folder"):
        exists = any(not is_lock(each) for each in path.iterdir()) if path.is_dir() else os.path.lexists(path)
    if exists and not overwrite:
        kind = "is a folder with files in it" if path.is_dir() else "exists"
        raise InputError(f"{path}: {kind}; choose another name, or add `overwrite` to replace what is there")
    expect_new(path, new=not overwrite)


def save(path: Path, pixels: Intensities) -> None:
    """Write a picture under a temporary name, then rename it, so no half-written file can remain.

    Raises
    ------
    InputError
        If it cannot be encoded (for instance a JPEG beyond 65535 pixels) or written.
    """
    with contextlib.suppress(cv2.error):
        done, encoded = cv2.imencode(path.suffix, pixels)
        if done:
            save_bytes(path, encoded.tobytes())
            return
    raise InputError(f"{path}: {pixels.shape[1]}x{pixels.shape[0]} cannot be stored as {path.suffix}; use .png or .tif")


def save_bytes(path: Path, data: bytes) -> None:
    """Write ``data`` under a temporary name beside ``path``, then rename it."""
    with write_atomically(path) as temporary:
        temporary.write_bytes(data)
