"""Random streams by purpose, and noise as a function of position: any window of a plane, without storing the plane."""

import enum

import cv2
import numpy as np

from golden_model.arrays import Float32

OCTAVES = 9
"""Band k has a lattice of 2**k px: from pixel grain to patches of 256 px."""


class Stream(enum.IntEnum):
    """Purposes of random numbers; each has its own generator."""

    WAVES = 1
    NODES = 2
    SECTIONS = 3
    ROADS_ACROSS = 4
    ROADS_DOWN = 5
    SUN = 6
    PAIR = 7
    LAWNMOWER = 8
    SENSOR = 9
    PURSUIT = 10


def make_rng(seed: int, purpose: Stream, *indices: int) -> np.random.Generator:
    """The generator for a purpose and, by its indices (which may be negative), for one section or picture."""
    return np.random.default_rng([seed, purpose, *(index & 0xFFFFFFFF for index in indices)])


def make_noise(seed: int, x_px: int, y_px: int, width_px: int, height_px: int) -> Float32:
    """Band-limited noise of a window, one band per octave: (OCTAVES, height_px, width_px).

    The plane follows from ``seed``, which is not negative; the window's top left pixel in it is ``x_px``, ``y_px``. The
    mean is 0, the standard deviation 0.6 to 1. Overlapping windows agree where they overlap.
    """
    keys = np.random.SeedSequence(seed).generate_state(OCTAVES)
    bands = np.empty((OCTAVES, height_px, width_px), np.float32)
    for octave, key in enumerate(keys):
        spacing = 1 << octave
        column, columns = _find_lattice(x_px, width_px, spacing)
        row, rows = _find_lattice(y_px, height_px, spacing)
        fine = _lattice(key, column, row, columns, rows)
        if octave > 0:
            fine = cv2.resize(fine, None, fx=spacing, fy=spacing, interpolation=cv2.INTER_CUBIC)
        left, top = x_px - column * spacing, y_px - row * spacing
        bands[octave] = fine[top : top + height_px, left : left + width_px]
    return bands


def _find_lattice(start_px: int, size_px: int, spacing_px: int) -> tuple[int, int]:
    """The first of the lattice points between which pixels are interpolated, and their number."""
    first, last = ((2 * px + 1 - spacing_px) // (2 * spacing_px) for px in (start_px, start_px + size_px - 1))
    return first - 1, last - first + 4


def _lattice(key: np.uint32, column: int, row: int, columns: int, rows: int) -> Float32:
    """White noise of unit variance at integer lattice points: a 32-bit integer hash of column, row and key."""
    x = np.arange(column, column + columns).astype(np.uint32) * np.uint32(0x9E3779B1)
    y = (np.arange(row, row + rows).astype(np.uint32) ^ key) * np.uint32(0x85EBCA77)
    mixed = x[np.newaxis, :] ^ (y ^ (y >> np.uint32(13)))[:, np.newaxis]
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39)):
        mixed ^= mixed >> np.uint32(shift)
        mixed *= np.uint32(factor)
    mixed ^= mixed >> np.uint32(15)
    return (mixed.astype(np.float32) * np.float32(2**-31) - np.float32(1)) * np.float32(3**0.5)
