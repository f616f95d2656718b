# amaranth: UnusedElaboratable=no
"""Orientation sector and descriptor equal the golden model, for candidates as close as they may be."""

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.feature.ilbp import PATTERNS, describe, gather
from hdl.blocks.chain import Descriptor
from hdl.blocks.vectors import Block, of_stream
from hdl.feature.ilbp import RingDescriptor
from tests.hdl.rows import row_test

CENTRE_PX = 20
PATCH_PX = 2 * CENTRE_PX + 1


def patches(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Slopes in every direction, noise, ties and the extremes, one (H, W) patch for each candidate."""
    y, x = np.mgrid[-CENTRE_PX : CENTRE_PX + 1, -CENTRE_PX : CENTRE_PX + 1]
    turns = np.arange(32)[:, np.newaxis, np.newaxis] * 2 * np.pi / 32
    slopes = 128 + 3 * (x * np.cos(turns) + y * np.sin(turns)) + rng.normal(0, 8, (32, PATCH_PX, PATCH_PX))
    noise = rng.integers(0, 256, (12, PATCH_PX, PATCH_PX))
    coarse = rng.integers(0, 2, (12, PATCH_PX, PATCH_PX)) * 255
    flat = np.stack([np.full((PATCH_PX, PATCH_PX), value) for value in (0, 255)])
    halves = np.stack([side * 255 for side in (x > 0, x < 0, y > 0, y < 0, x > y, x < -y)])
    return np.concatenate([slopes, noise, flat, coarse, halves]).clip(0, 255).astype(np.uint8)


def descriptor(name: str, spacing_cycles: int) -> Block:
    pattern = PATTERNS[name]
    scene = np.concatenate(list(patches(np.random.default_rng(9))))
    y = np.arange(len(scene) // PATCH_PX) * PATCH_PX + CENTRE_PX
    x = np.full_like(y, CENTRE_PX)
    sectors, descriptors = describe(scene, scene, x, y, pattern)
    assert not pattern.oriented or set(sectors.tolist()) == set(range(16))
    rings = gather(scene, x, y, [offset for ring in pattern.offsets for offset in ring]).T
    sent = [{"rings": ring.reshape(len(pattern.radii_px), -1).tolist()} for ring in rings]
    answers = [
        {"sector": sector, "descriptor": int.from_bytes(row.tobytes(), "little")}
        for sector, row in zip(sectors.tolist(), descriptors, strict=True)
    ]
    dut = Descriptor(pattern=pattern, spacing_cycles=spacing_cycles)
    return of_stream(dut, "", sent, answers)


CASES = [
    *((name, 2) for name in PATTERNS),
    *((name, each) for name in ("ilbp-128", "thesis-ilbp-2") for each in (1, 4)),
]


test_rows = row_test({f"{name} every {each}": partial(descriptor, name, each) for name, each in CASES})


def test_impossible_spacing_is_refused() -> None:
    with pytest.raises(ValueError, match="spacing_cycles is 3; valid: 1, 2, 4"):
        RingDescriptor(pattern=PATTERNS["ilbp-128"], spacing_cycles=3)
