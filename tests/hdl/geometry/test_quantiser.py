"""The hypotheses that the quantiser makes of the elements of both lanes equal the golden model's."""

from typing import Any

import numpy as np

from golden_model.geometry.estimator import quantise
from golden_model.geometry.floating import MANTISSA_BITS, Floats
from golden_model.geometry.program import LANES
from golden_model.geometry.programs import ELEMENTS, FIRST_ELEMENT, LANE_REGISTERS
from hdl.geometry.quantiser import Quantiser
from hdl.lib.line_memory import LineMemory
from tests.hdl.block_bench import BlockBench


def test_hypotheses_equal_the_golden_model() -> None:
    """Exponents close together and far apart; a second start replaces the first result."""
    rng, dut = np.random.default_rng(7), Quantiser()
    shape = (2, ELEMENTS, LANES)
    mantissas = rng.integers(1 << MANTISSA_BITS - 1, 1 << MANTISSA_BITS, shape)
    exponents = rng.integers(-3, 4, shape) * rng.choice([1, 1, 9], shape)
    negative = rng.random(shape) < 0.5
    mantissas[0, 4] = 0
    results = []

    async def run(ctx: Any) -> None:
        for each in zip(mantissas, exponents, negative, strict=True):
            numbers = Floats(*each)
            for lane in range(LANES):
                ctx.set(dut.i_exponents[lane], int(numbers.exponent[:, lane].max()))
            registers = [0] * LineMemory.latency_cycles
            ctx.set(dut.i_start, 1)
            for _ in range(dut.latency_cycles):
                lane, element = divmod(registers.pop(0) - FIRST_ELEMENT, LANE_REGISTERS)
                if lane >= 0 and element < ELEMENTS:
                    number = {name: int(values[element, lane]) for name, values in vars(numbers).items()}
                    ctx.set(dut.i_number, number)
                registers.append(ctx.get(dut.o_register))
                await ctx.tick()
                ctx.set(dut.i_start, 0)
            results.append([[ctx.get(dut.o[lane][n]) for n in range(ELEMENTS)] for lane in range(LANES)])

    BlockBench(dut, cycle_limit=4 * dut.latency_cycles).run(run)
    for result, m, e, n in zip(results, mantissas, exponents, negative, strict=True):
        rows = [[Floats(m[k], e[k], n[k]) for k in range(3 * row, 3 * row + 3)] for row in range(3)]
        np.testing.assert_array_equal(np.reshape(result, (LANES, 3, 3)), quantise(rows))
