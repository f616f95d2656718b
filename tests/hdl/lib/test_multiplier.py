"""Products that are wider than a technology's multiplier."""

from typing import Any

import numpy as np
import pytest
from amaranth import Module, Signal, signed, unsigned
from amaranth.sim import Simulator

from hdl.lib.ecp5 import Ecp5
from hdl.lib.multiplier import multiply_wide

WIDE, NARROW = signed(25), unsigned(16)


@pytest.mark.parametrize("platform", [None, Ecp5()])
def test_a_wide_product_takes_two_clocks_on_every_technology(platform: object) -> None:
    m = Module()
    wide, narrow = Signal(WIDE), Signal(NARROW)
    product = multiply_wide(m, platform, wide, narrow)
    largest, rng = 1 << WIDE.width - 1, np.random.default_rng(1)
    pairs = [(a, b) for a in (-largest, -1, 0, (1 << 17) - 1, 1 << 17, largest - 1) for b in (0, 1, (1 << 16) - 1)]
    pairs += rng.integers((-largest, 0), (largest, 1 << NARROW.width), (300, 2)).tolist()

    async def run(context: Any) -> None:
        for number in range(len(pairs) + 2):
            a, b = pairs[min(number, len(pairs) - 1)]
            context.set(wide, a)
            context.set(narrow, b)
            if number >= 2:
                before, other = pairs[number - 2]
                assert context.get(product) == before * other
            await context.tick()

    simulator = Simulator(m)
    simulator.add_clock(1e-6)
    simulator.add_testbench(run)
    simulator.run()
