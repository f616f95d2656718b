# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from numpy.typing import NDArray

from golden_model.feature import subpixel
from golden_model.formats import encode_response
from hdl.feature.subpixel import SubPixel
from tests.hdl.drivers import run_clocks

CANDIDATES = 200
LAG_PX = 17
NEIGHBOURS = {"left": (-1, 0), "right": (1, 0), "up": (0, -1), "down": (0, 1)}


def neighbourhoods(rng: np.random.Generator) -> dict[str, NDArray[np.int64]]:
    """Codes of candidates and of neighbours that are equal, a little smaller, much smaller or 0; and exact halves."""
    largest = int(encode_response(np.array((1 << 30) - 1)))
    centre = rng.integers(1, largest + 1, CANDIDATES)
    centre[:40] = [1, 2, 1023, 1024, 1025, largest, largest - 1, 2047] * 5
    codes = {"code": centre}
    for name in NEIGHBOURS:
        near = centre - rng.integers(0, 1500, CANDIDATES)
        any_smaller = rng.integers(0, centre + 1)
        codes[name] = np.choose(rng.integers(0, 4, CANDIDATES), [centre, near.clip(0), any_smaller, 0])
    for name in NEIGHBOURS:
        codes[name][40:48] = centre[40:48]
    # Vertices halfway between two sixteenths: u + v = 32 and |v - u| = 2, 6, 10 ...
    falls = np.arange(1, 32, 2)
    zeros = np.zeros_like(falls)
    for name, fall in {"code": zeros, "left": falls, "right": 32 - falls, "up": 32 - falls, "down": falls}.items():
        codes[name][48:64] = 1000 - fall
    return codes


def golden_positions(
    codes: dict[str, NDArray[np.int64]], x: NDArray[np.int64], y: NDArray[np.int64], level: int
) -> list[tuple[int, int]]:
    """Positions from the golden model, with each candidate alone in its plane."""
    positions = []
    for candidate in range(CANDIDATES):
        plane = np.zeros((y[candidate] + 2, x[candidate] + 2), np.uint16)
        plane[y[candidate], x[candidate]] = codes["code"][candidate]
        for name, (dx, dy) in NEIGHBOURS.items():
            plane[y[candidate] + dy, x[candidate] + dx] = codes[name][candidate]
        at = np.array([x[candidate]]), np.array([y[candidate]])
        refined_x, refined_y = subpixel.refine(plane, *at, level)
        positions.append((int(refined_x[0]), int(refined_y[0])))
    return positions


@pytest.mark.parametrize(("level", "spacing_cycles"), [(0, 1), (1, 2), (0, 3)])
def test_positions_equal_the_golden_model(level: int, spacing_cycles: int) -> None:
    rng = np.random.default_rng(21 + level)
    codes = neighbourhoods(rng)
    x, y = rng.integers(1, 200, (2, CANDIDATES))
    x[0] = y[1] = (4095 >> level) - LAG_PX
    dut = SubPixel(level=level, lag_px=LAG_PX, spacing_cycles=spacing_cycles)
    garbage = rng.integers(0, 1 << 15, (CANDIDATES, len(codes)))
    inputs, offered = [], []
    for cycle in range(CANDIDATES * spacing_cycles + dut.latency_cycles + 1):
        candidate, pause = divmod(cycle, spacing_cycles)
        here = pause == 0 and candidate < CANDIDATES
        # Between candidates: beats without a corner, and clocks without a beat.
        values = codes if here else dict(zip(codes, garbage[candidate % CANDIDATES][:, np.newaxis], strict=True))
        fields = {name: int(column[candidate if here else 0]) for name, column in values.items()}
        if here:
            fields |= {"x": int(x[candidate]) + LAG_PX, "y": int(y[candidate]) + LAG_PX}
            offered.append(cycle)
        inputs.append([(dut.i, {"valid": pause < 2, "present": here, **fields})])
    outputs = run_clocks(dut, inputs, [dut.o_x, dut.o_y])
    positions = [outputs[cycle + dut.latency_cycles] for cycle in offered]
    assert positions == golden_positions(codes, x, y, level)
