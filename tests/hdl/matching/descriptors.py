"""Descriptors of several kinds, and the nearest neighbours that their distances give."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdl.matching.nearest_neighbours import NearestNeighbours


def some_equal(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    return rng.integers(0, 256, (4, bits // 8), dtype=np.uint8)[rng.integers(0, 4, count)]


def close_together(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    """One descriptor with a few bits changed: the distances are small, and many are equal."""
    flips = rng.random((count, bits)) < 2 / bits
    return rng.integers(0, 256, bits // 8, dtype=np.uint8) ^ np.packbits(flips, axis=1)


def opposite(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    """Descriptors of all zeros or all ones: the largest distance can also be the smallest."""
    return np.repeat(rng.choice([0, 255], (count, 1)), bits // 8, axis=1).astype(np.uint8)


def random_bits(rng: np.random.Generator, count: Any, bits: Any) -> Any:
    return rng.integers(0, 256, (count, bits // 8), dtype=np.uint8)


def descriptor_ints(descriptors: NDArray[np.uint8]) -> list[Any]:
    return [int.from_bytes(descriptor.tobytes(), "little") for descriptor in descriptors]


def nearest(distance: NDArray[np.integer], empty: int) -> list[tuple[int, int, int]]:
    """``(best, second, index)`` of each row, ``empty`` for a missing second."""
    result = []
    for row in distance.astype(int):
        index = int(row.argmin())
        others = np.delete(row, index)
        result.append((int(row[index]), int(others.min()) if len(others) else empty, index))
    return result


def search_cycles(search: NearestNeighbours, left: int, right: int) -> int:
    """Clocks of a search through so many features."""
    if not left or not right:
        return 0
    return -(-left // search.lanes) * max(right, search.shortest_pass_cycles) + search.drain_cycles
