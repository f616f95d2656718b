# amaranth: UnusedElaboratable=no
"""Sums, differences, products and counts against the numbers that they are."""

import itertools
from functools import partial

import numpy as np
import pytest
from amaranth import Module, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from hdl.blocks.vectors import Block, of_stream
from hdl.lib.add_subtract import add_or_subtract
from hdl.lib.delay import delayed
from hdl.lib.multiplier import multiply_wide
from hdl.lib.popcount import Popcount
from hdl.lib.views import view_signal
from tests.hdl.rows import Clocked, row_test

WIDE, NARROW = signed(25), unsigned(16)
LARGEST = 1 << WIDE.width - 1
FACTORS = [(a, b) for a in (-LARGEST, -1, 0, (1 << 17) - 1, 1 << 17, LARGEST - 1) for b in (0, 1, (1 << 16) - 1)]
FACTORS += np.random.default_rng(1).integers((-LARGEST, 0), (LARGEST, 1 << NARROW.width), (300, 2)).tolist()


class WideProduct(wiring.Component):
    """A product that is cut in two, with its valid bit."""

    i: In(data.StructLayout({"valid": 1, "wide": WIDE, "narrow": NARROW}))
    o: Out(data.StructLayout({"valid": 1, "product": signed(41)}))
    latency_cycles = 2

    def elaborate(self, platform: object) -> Module:
        m = Module()
        product = multiply_wide(m, platform, self.i.wide, self.i.narrow)
        valid = delayed(m, self.i.valid, self.latency_cycles, reset_less=False)
        m.d.comb += [self.o.product.eq(product), self.o.valid.eq(valid)]
        return m


def wide_product() -> Block:
    """As on the ECP5, in `test_ecp5`."""
    factors = [{"wide": wide, "narrow": narrow} for wide, narrow in FACTORS]
    return of_stream(WideProduct(), "A wide product.", factors, [{"product": a * b} for a, b in FACTORS])


class Sum(wiring.Component):
    """The result in more bits than it needs."""

    latency_cycles = 1

    def __init__(self, a_bits: int, b_bits: int) -> None:
        super().__init__(
            {"i_a": In(signed(a_bits)), "i_b": In(signed(b_bits)), "i_subtract": In(1), "o_sum": Out(signed(8))}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.sync += self.o_sum.eq(add_or_subtract(self.i_a, self.i_b, self.i_subtract))
        return m


def sums(*widths: int) -> Block:
    cases = list(itertools.product(*(range(-(1 << bits - 1), 1 << bits - 1) for bits in widths), (0, 1)))
    sent = [{"a": a, "b": b, "subtract": subtract} for a, b, subtract in cases]
    return of_stream(Clocked(Sum(*widths)), "", sent, [{"sum": a - b if each else a + b} for a, b, each in cases])


def popcount(bits: int, lanes: int) -> Block:
    """The ones of each lane."""
    rng = np.random.default_rng(bits)
    inputs = rng.random((25, bits, lanes)) < rng.random((25, 1, lanes))
    inputs[0], inputs[1] = 0, 1
    planes = (inputs << np.arange(lanes)).sum(axis=2).tolist()
    answers = [{"counts": each} for each in inputs.sum(axis=1).tolist()]
    return of_stream(Clocked(Popcount(bits=bits, lanes=lanes)), "", [{"planes": each} for each in planes], answers)


test_rows = row_test({
    "wide product": wide_product,
    **{f"sum of {a} and {b} bits": partial(sums, a, b) for a, b in ((3, 3), (4, 2), (2, 4))},
    **{f"popcount of {a} in {b}": partial(popcount, a, b) for a, b in ((3, 2), (8, 3), (24, 2), (256, 1))},
})  # fmt: skip


def test_a_view_has_the_name_of_its_variable_or_the_one_that_was_given() -> None:
    layout = data.StructLayout({"x": 4, "y": 4})
    position = view_signal(layout)
    assert position.as_value().name == "position"
    assert view_signal(layout, name="other").as_value().name == "other"


def test_popcount_refuses_too_few_bits() -> None:
    with pytest.raises(ValueError, match="bits is 2"):
        Popcount(bits=2, lanes=1)
