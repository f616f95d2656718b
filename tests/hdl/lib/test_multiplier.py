"""Products that are wider than a technology's multiplier."""

from typing import Any

import numpy as np
from amaranth import Module, Signal, signed, unsigned
from amaranth.sim import Simulator

from hdl.lib.multiplier import multiply_wide

WIDE, NARROW = signed(25), unsigned(16)
LARGEST = 1 << WIDE.width - 1
FACTORS = [(a, b) for a in (-LARGEST, -1, 0, (1 << 17) - 1, 1 << 17, LARGEST - 1) for b in (0, 1, (1 << 16) - 1)]
FACTORS += np.random.default_rng(1).integers((-LARGEST, 0), (LARGEST, 1 << NARROW.width), (300, 2)).tolist()


def test_a_wide_product_takes_two_clocks() -> None:
    """As on the ECP5, in `test_ecp5`."""
    m = Module()
    wide, narrow = Signal(WIDE), Signal(NARROW)
    product = multiply_wide(m, None, wide, narrow)

    async def run(context: Any) -> None:
        for number in range(len(FACTORS) + 2):
            a, b = FACTORS[min(number, len(FACTORS) - 1)]
            context.set(wide, a)
            context.set(narrow, b)
            if number >= 2:
                before, other = FACTORS[number - 2]
                assert context.get(product) == before * other
            await context.tick()

    simulator = Simulator(m)
    simulator.add_clock(1e-6)
    simulator.add_testbench(run)
    simulator.run()
