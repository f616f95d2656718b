"""Ring descriptors equal per-bit loops written from the definitions."""

import hashlib
import json
import math
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from golden_model.feature import ilbp
from golden_model.feature.ilbp import ILBP_128, ILBP_256, PATTERNS, DescriptorPattern, thesis_ilbp

DIGESTS = {
    "ilbp-128": "2cdf8d3938225b48",
    "ilbp-256": "50930f74086a281b",
    "ilbp-128-upright": "c7825100578ba8a8",
    "ilbp-256-upright": "9c31e73c7d26b1dd",
    "thesis-ilbp-1": "e4671dcb30d79bd9",
    "thesis-ilbp-2": "9d192a6f084c2560",
    "thesis-ilbp-3": "d71f2d5da4222853",
    "thesis-ilbp-4": "df47c3f67810f36e",
}
"""Of each pattern's tables: with other numbers, a board that was built before would describe other features."""


@pytest.mark.parametrize("name", PATTERNS)
def test_the_tables_are_those_of_every_board_so_far(name: str) -> None:
    pattern = PATTERNS[name]
    assert pattern.name == name
    tables = [pattern.comparisons, pattern.offsets, pattern.smoothed, pattern.oriented, pattern.window_bytes]
    assert hashlib.sha256(json.dumps(tables).encode()).hexdigest()[:16] == DIGESTS[name]


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    """A smooth random image, in which ties, all orientations and both bit values occur."""
    rng = np.random.default_rng(1)
    return cv2.GaussianBlur(rng.integers(0, 256, (121, 121), dtype=np.uint8), (0, 0), 1.5)


@pytest.fixture(scope="module")
def positions() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.random.default_rng(2).integers(17, 121 - 17, (2, 400))
    return x, y


def naive_descriptor(
    plane: Pixels, x: np.int64, y: np.int64, pattern: DescriptorPattern, sector: np.uint8
) -> list[int]:
    """The bits of one descriptor, each computed with its own sine and cosine."""

    def pixel(ring: Any, angle: Any) -> Any:
        turn = 2 * math.pi * (angle % pattern.angles) / pattern.angles
        radius = pattern.radii_px[ring]
        return int(plane[y + round(radius * math.sin(turn)), x + round(radius * math.cos(turn))])

    angles = [pattern.angles // 8 * i + int(sector) for i in range(8)]
    return [int(pixel(a, t) >= pixel(b, t + shift)) for a, b, shift in pattern.comparisons for t in angles]


@pytest.mark.parametrize("name", ["ilbp-128", "ilbp-256", "ilbp-128-upright"])
def test_descriptor_equals_per_bit_definition(
    image: Pixels, positions: tuple[NDArray[np.int64], NDArray[np.int64]], name: str
) -> None:
    pattern = PATTERNS[name]
    smoothed = cv2.blur(image, (5, 5))
    x, y = positions
    sector, descriptor = ilbp.describe(image, smoothed, x, y, pattern)
    assert descriptor.shape == (400, pattern.descriptor_bytes)
    assert set(sector.tolist()) == (set(range(16)) if pattern.oriented else {0})
    bits = np.unpackbits(descriptor, axis=1, bitorder="little")
    for n in range(60):
        assert bits[n].tolist() == naive_descriptor(smoothed, x[n], y[n], pattern, sector[n])


@pytest.mark.parametrize("rings", [1, 2, 3, 4])
def test_thesis_pattern_is_the_local_binary_pattern(
    image: Pixels, positions: tuple[NDArray[np.int64], NDArray[np.int64]], rings: int
) -> None:
    """Equation III-4 on the unsmoothed image: one byte for each ring, neighbour - centre >= 0."""
    x, y = positions
    poison = np.zeros_like(image)
    sector, descriptor = ilbp.describe(image, poison, x, y, thesis_ilbp(rings))
    neighbours = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    for n in range(100):
        centre = int(image[y[n], x[n]])
        for r in range(1, rings + 1):
            bits = [int(image[y[n] + r * dy, x[n] + r * dx]) - centre >= 0 for dx, dy in neighbours]
            assert descriptor[n, r - 1] == sum(bit << i for i, bit in enumerate(bits))
    assert not sector.any()


def test_turning_the_rings_by_a_sector_keeps_the_descriptor() -> None:
    """If the ring pixels move by one angle, the sector grows by one and the descriptor stays the same."""
    rng = np.random.default_rng(5)
    # A bright side along angle 0 with noise, so that the orientation is far from a sector border.
    ring_values = 128 + 90 * np.cos(2 * np.pi * np.arange(16) / 16) + rng.integers(-30, 31, (7, 16))
    described = []
    for turn in range(16):
        plane = np.zeros((41, 41), dtype=np.uint8)
        for ring, offsets in enumerate(ILBP_256.offsets):
            for a, (dx, dy) in enumerate(offsets):
                plane[20 + dy, 20 + dx] = ring_values[ring, (a - turn) % 16 if ring else 0]
        described.append(ilbp.describe(plane, plane, np.array([20]), np.array([20]), ILBP_256))
    sectors = np.array([sector[0] for sector, _ in described])
    assert (sectors == (sectors[0] + np.arange(16)) % 16).all()
    assert all((descriptor == described[0][1]).all() for _, descriptor in described)


def test_without_features_the_arrays_are_empty() -> None:
    nothing = np.zeros(0, dtype=np.int64)
    flat = np.zeros((64, 64), dtype=np.uint8)
    sector, descriptor = ilbp.describe(flat, flat, nothing, nothing, ILBP_128)
    assert sector.shape == (0,)
    assert descriptor.shape == (0, 16)


@pytest.mark.parametrize(("x", "y"), [(14, 30), (30, 14), (49, 30), (30, 49)])
def test_feature_too_near_the_border_is_named(x: int, y: int) -> None:
    flat = np.zeros((64, 64), dtype=np.uint8)
    with pytest.raises(ValueError, match=rf"feature 1 at \({x}, {y}\) reaches outside the 64x64 image"):
        ilbp.describe(flat, flat, np.array([30, x]), np.array([30, y]), ILBP_128)
    ilbp.describe(flat, flat, np.array([15, 48]), np.array([15, 48]), ILBP_128)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"angles": 12}, "8 or 16 angles, not 12"),
        ({"angles": 8, "oriented": True}, "oriented pattern needs rings of 16"),
        *(
            ({"comparisons": (each,)}, rf"comparison \({', '.join(map(str, each))}\) is outside the rings")
            for each in ((2, 0, 0), (0, 2, 0), (0, 0, 16), (-1, 0, 0), (0, -1, 0), (0, 0, -1))
        ),
    ],
)
def test_impossible_pattern_is_refused(arguments: dict[str, Any], message: str) -> None:
    fields: dict[str, Any] = {
        "name": "p",
        "radii_px": (0, 1),
        "angles": 16,
        "comparisons": (),
        "smoothed": False,
        "oriented": False,
    }
    with pytest.raises(ValueError, match=message):
        ilbp.DescriptorPattern(**(fields | arguments))
