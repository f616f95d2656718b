"""Corrects lens distortion, and masks the parts of photographs that show the drone itself."""

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from golden_model.arrays import Array, Intensities, Pixels, Points
from golden_model.small_files import read_small_file
from skymosaic.common.errors import InputError, reading
from skymosaic.geometry.homography import resize_matrix
from skymosaic.imagery.images import load
from skymosaic.imagery.orientation import AXES, MIRROR, UPRIGHT, turn_matrix

_REQUIRED = ("width_px", "height_px", "focal_x_px", "focal_y_px", "centre_x_px", "centre_y_px")
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
MAX_NUMBER = 1e9
"""Limit of the numbers in a camera file; it excludes infinities, and integers too large for a float."""
SAME_SHAPE = 0.02
"""Shapes (shorter side / longer side) that differ by less are the same, but for rounding."""
_Camera = tuple[tuple[int, int], Array, Array]
"""Size, calibration matrix and distortion."""


@dataclass(frozen=True, eq=False)
class Lens:
    """Removes distortion from photographs and masks the pixels that do not show the ground."""

    size: tuple[int, int] | None = None
    """Width and height of the calibration images, as the camera stores them; photographs of another size are assumed to
    be resized, and to have been turned if they are upright."""
    matrix: Array | None = None
    """Calibration matrix K at that size, pixel centres at integers; None: no distortion."""
    distortion: Array | None = None
    """Coefficients k1, k2, p1, p2, k3 of OpenCV's model."""
    mask: Pixels | None = None
    """0 where photographs do not show the ground, (H, W); resized to each photograph once that is upright."""
    orientation: int = UPRIGHT
    """EXIF orientation by which the photographs have been turned upright, see `turned`."""

    @cached_property
    def key(self) -> str:
        """Hash of everything on which `straighten` and `visible_mask` depend."""
        state = hashlib.sha256(repr((self.size, self.orientation)).encode())
        for part in (self.matrix, self.distortion, self.mask):
            state.update(b"none" if part is None else repr(part.shape).encode() + part.tobytes())
        return state.hexdigest()

    def turned(self, orientation: int) -> "Lens":
        """The lens of photographs that have been turned upright by this EXIF orientation."""
        return _turned(self, orientation)

    def turned_back(self, orientation: int) -> "Lens":
        """The lens of stored photographs, where this one is of those turned upright by this EXIF orientation."""
        if self._camera is None:
            return self
        size, matrix, distortion = _turn_axes(self._camera, np.transpose(AXES[orientation]))
        return replace(self, size=size, matrix=matrix, distortion=distortion)

    def fits(self, size: tuple[int, int]) -> bool:
        """Whether a photograph of ``size`` (width, height) has the shape of the calibration images, upright or not."""
        if self.size is None:
            return True
        shape, own_shape = (min(each) / max(each) for each in (size, self.size))
        return abs(shape / own_shape - 1) < SAME_SHAPE

    def check(self, size: tuple[int, int], name: str) -> None:
        """Raise InputError if the photograph ``name`` of this size does not fit."""
        if self.size is not None and not self.fits(size):
            shapes = "{}x{} px, and the camera file is for {}x{} px".format(*size, *self.size)
            raise InputError(f"{name}: {shapes}, which is another shape; give the file of this camera")
        if self.mask is None:
            return
        height, width = self.mask.shape
        if abs(size[0] * height / (size[1] * width) - 1) >= SAME_SHAPE:
            shapes = f"{size[0]}x{size[1]} px, and the mask has {width}x{height} px"
            raise InputError(f"{name}: {shapes}, which is another shape; paint it over a photograph of this shape")

    def straighten(self, pixels: Intensities, interpolation: int = cv2.INTER_CUBIC) -> Intensities:
        """Remove distortion, as if a pinhole camera with the same matrix had taken the photograph.

        Pixels of another camera, see `fits`, are returned as they are; so are points by `straighten_points`.
        """
        size = (pixels.shape[1], pixels.shape[0])
        if (camera := self.camera_at(size)) is None:
            return pixels
        maps = cv2.initUndistortRectifyMap(*camera, None, camera[0], size, cv2.CV_16SC2)
        return np.asarray(cv2.remap(pixels, *maps, interpolation), dtype=pixels.dtype)

    def straighten_mask(self, visible: Pixels) -> Pixels:
        """Remove distortion from a photograph's mask: 255 where all that a pixel interpolates is ground, else 0."""
        return np.where(self.straighten(visible) == 255, np.uint8(255), np.uint8(0))

    def straighten_points(self, points: Points, size: tuple[int, int]) -> Points:
        """Move points (N, 2), px, to where the straightened photograph of ``size`` (width, height) shows them."""
        if (camera := self.camera_at(size)) is None:
            return points
        straight = cv2.undistortPoints(points.reshape(-1, 1, 2), *camera, P=camera[0])
        return np.asarray(straight, dtype=np.float64).reshape(-1, 2)

    def visible_mask(self, size: tuple[int, int], own: Pixels | None = None) -> Pixels | None:
        """Mask of a straightened photograph of ``size`` (width, height): 255 where it shows ground; None: all of it.

        ``own`` is the photograph's own mask, of any size, which may hide more.
        """
        mask = None if self.mask is None and self.matrix is None else _visible_mask(self, size)
        if own is None:
            return mask
        resized = cv2.resize(own, size, interpolation=cv2.INTER_AREA)
        whole = np.where(resized == 255, np.uint8(255), np.uint8(0))
        return whole if mask is None else np.minimum(whole, mask)

    @property
    def numbers(self) -> dict[str, float]:
        """What a camera file that `load_lens` reads has, but for what is 0; empty without a calibration matrix."""
        if self._camera is None:
            return {}
        size, matrix, distortion = self._camera
        values = (*size, *matrix[[0, 1], [0, 1]].tolist(), *matrix[:2, 2].tolist(), *distortion.tolist())
        return {key: value for key, value in zip(_REQUIRED + _DISTORTION, values, strict=True) if value}

    def __eq__(self, other: object) -> bool:
        """Whether the other lens makes the same corrections."""
        return isinstance(other, Lens) and self.key == other.key

    def __hash__(self) -> int:
        """Hash of the key."""
        return hash(self.key)

    def camera_at(self, size: tuple[int, int]) -> tuple[Array, Array] | None:
        """Calibration matrix and distortion for a photograph of ``size``, reduced or upright, if known."""
        if self._camera is None or not self.fits(size):
            return None
        (width, height), *_ = self._camera
        axes = np.array(AXES[self.orientation])
        sideways = (size[0] > size[1]) != (width > height)
        if width != height and sideways == bool(axes[0, 0]):
            # The calibration is of upright photographs, or EXIF does not tell which way this one was turned.
            axes = np.array(AXES[MIRROR if sideways else UPRIGHT])
        (width, height), matrix, distortion = _turn_axes(self._camera, axes)
        return np.asarray(resize_matrix(size[0] / width, size[1] / height) @ matrix), distortion

    @property
    def _camera(self) -> _Camera | None:
        if self.size is None or self.matrix is None or self.distortion is None:
            return None
        return self.size, self.matrix, self.distortion


def _turn_axes(camera: _Camera, axes: Array) -> _Camera:
    """Size, calibration matrix and distortion of photographs that have been turned."""
    size, matrix, (k1, k2, p1, p2, k3) = camera
    width, height = (np.abs(axes) @ size).tolist()
    turned, back = turn_matrix((width, height), axes), np.eye(3)
    back[:2, :2] = axes.T
    p2, p1 = axes @ (p2, p1)
    return (int(width), int(height)), np.asarray(turned @ matrix @ back), np.array([k1, k2, p1, p2, k3])


# Cached with its key, for which a mask is read.
@lru_cache(maxsize=16)
def _turned(lens: Lens, orientation: int) -> Lens:
    return replace(lens, orientation=orientation)


# Cached, because each tile asks for it once per photograph.
@lru_cache(maxsize=4)
def _visible_mask(lens: Lens, size: tuple[int, int]) -> Pixels:
    """As `Lens.visible_mask`, for a lens with a mask or a distortion."""
    mask = np.full(size[::-1], 255, np.uint8)
    if lens.mask is not None:
        mask = np.asarray(cv2.resize(lens.mask, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    # A pixel that interpolates across the mask's edge or the photograph's border does not count as ground.
    straight = lens.straighten(mask, cv2.INTER_LINEAR)
    return np.where(straight == 255, straight, 0).astype(np.uint8)


def load_lens(camera: Path | None, mask: Path | None) -> Lens:
    """Read a camera file and a mask picture; either may be None.

    The camera file is TOML with ``width_px``, ``height_px``, ``focal_x_px``, ``focal_y_px``, ``centre_x_px``,
    ``centre_y_px`` and any of ``k1``, ``k2``, ``p1``, ``p2``, ``k3`` of OpenCV's distortion, of photographs as they are
    stored. The mask is black where upright photographs show no ground.

    Raises
    ------
    InputError
        For a file that cannot be read, a missing or unknown key, or a value that is not a number.
    """
    ground = None
    if mask is not None:
        pixels = load(mask).pixels
        ground = ((pixels if pixels.ndim == 2 else pixels.max(axis=2)) > 127).astype(np.uint8) * np.uint8(255)
        if not ground.any():
            raise InputError(f"{mask}: the mask is black everywhere; paint white what shows the ground")
    if camera is None:
        return Lens(mask=ground)
    values = _read_numbers(camera)
    if min(values[key] for key in _REQUIRED) <= 0:
        raise InputError(f"{camera}: sizes, focal lengths and the centre must be positive")
    return lens_of(values, ground)


def lens_of(numbers: Mapping[str, float], mask: Pixels | None = None) -> Lens:
    """The lens with some `Lens.numbers`."""
    width, height, fx, fy, cx, cy = (numbers[key] for key in _REQUIRED)
    return Lens(
        size=(round(width), round(height)),
        matrix=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64),
        distortion=np.array([numbers.get(key, 0.0) for key in _DISTORTION], dtype=np.float64),
        mask=mask,
    )


def _read_numbers(path: Path) -> dict[str, float]:
    try:
        with reading(path, "give a TOML file"):
            table = tomllib.loads(read_small_file(path).decode("utf-8-sig"))
    # RecursionError: arrays nested hundreds of levels deep.
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    for key, value in table.items():
        if key not in _REQUIRED + _DISTORTION:
            raise InputError(f"{path}: unknown key {key}; valid: {', '.join(_REQUIRED + _DISTORTION)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < MAX_NUMBER:
            raise InputError(f"{path}: {key} is {value!r}; it must be a number")
    missing = [key for key in _REQUIRED if key not in table]
    if missing:
        raise InputError(f"{path}: {', '.join(missing)} missing; a camera file needs {', '.join(_REQUIRED)}")
    return {key: float(value) for key, value in table.items()}
