# amaranth: UnusedElaboratable=no
"""Orientation sector and descriptor equal the golden model."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.feature.ilbp import PATTERNS, describe, gather
from hdl.feature.ilbp import RingDescriptor
from tests.hdl.block_bench import BlockBench
from tests.hdl.drivers import run_clocks

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


def run_descriptor(
    dut: RingDescriptor, rings: NDArray[np.uint8], *, pause_cycles: int
) -> tuple[list[int], list[tuple[int, int, int]]]:
    """Offer (N, rings * angles) pixels, with random ones in between.

    Returns the cycles of the candidates, and ``(cycle, sector, descriptor)`` of each answer.
    """
    pixels = [pixel for ring in dut.i_pixels for pixel in ring]
    waits = [dut.groups + (candidate % 3) * pause_cycles for candidate in range(len(rings))]
    offered = np.cumsum([0, *waits[:-1]]).tolist()
    # The pixels come a clock after their candidate; in the other clocks they are random.
    shown = np.random.default_rng(8).integers(0, 256, (offered[-1] + dut.latency_cycles + 2, len(pixels)))
    shown[np.array(offered) + 1] = rings
    starts = set(offered)
    inputs = [
        [(dut.i_candidate, cycle in starts), *zip(pixels, values, strict=True)]
        for cycle, values in enumerate(shown.tolist())
    ]
    outputs = run_clocks(dut, inputs, [dut.o_valid, dut.o_sector, dut.o_descriptor])
    return offered, [(cycle, *outcomes) for cycle, (valid, *outcomes) in enumerate(outputs) if valid]


@pytest.mark.parametrize(
    ("name", "spacing_cycles", "pause_cycles"),
    [
        *((name, 2, 1) for name in PATTERNS),
        *((name, *cycles) for name in ("ilbp-128", "thesis-ilbp-2") for cycles in ((1, 0), (4, 1))),
    ],
)
def test_sector_and_descriptor_equal_the_golden_model(name: str, spacing_cycles: int, pause_cycles: int) -> None:
    pattern = PATTERNS[name]
    scene = np.concatenate(list(patches(np.random.default_rng(9))))
    y = np.arange(len(scene) // PATCH_PX) * PATCH_PX + CENTRE_PX
    x = np.full_like(y, CENTRE_PX)
    sectors, descriptors = describe(scene, scene, x, y, pattern)
    assert not pattern.oriented or set(sectors.tolist()) == set(range(16))

    rings = gather(scene, x, y, [offset for ring in pattern.offsets for offset in ring]).T
    dut = RingDescriptor(pattern=pattern, spacing_cycles=spacing_cycles)
    offered, outcomes = run_descriptor(dut, rings, pause_cycles=pause_cycles)
    assert [cycle - dut.latency_cycles for cycle, _, _ in outcomes] == offered
    assert [sector for _, sector, _ in outcomes] == sectors.tolist()
    assert [value for *_, value in outcomes] == [int.from_bytes(row.tobytes(), "little") for row in descriptors]


def test_reset_drops_the_candidates_in_the_pipeline() -> None:
    dut = RingDescriptor(pattern=PATTERNS["ilbp-128"], spacing_cycles=4)
    bench = BlockBench(dut)
    valids = []

    async def testbench(ctx: Any) -> None:
        for cycle in range(3 * dut.latency_cycles):
            ctx.set(dut.i_candidate, cycle % 4 == 0 and cycle <= 2 * dut.latency_cycles)
            ctx.set(bench.reset, cycle == dut.latency_cycles)
            *_, valid = await ctx.tick().sample(dut.o_valid)
            valids.append(valid)

    bench.run(testbench)
    after = range(dut.latency_cycles + 1, 3 * dut.latency_cycles)
    offered = {cycle for cycle in after if cycle % 4 == 0 and cycle <= 2 * dut.latency_cycles}
    assert {cycle for cycle in after if valids[cycle]} == {cycle + dut.latency_cycles for cycle in offered}


def test_impossible_spacing_is_refused() -> None:
    with pytest.raises(ValueError, match="spacing_cycles is 3; valid: 1, 2, 4"):
        RingDescriptor(pattern=PATTERNS["ilbp-128"], spacing_cycles=3)
