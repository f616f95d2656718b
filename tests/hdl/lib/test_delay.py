"""Delays, whose registers hold one or several stages, against what was sent."""

from typing import Any

import numpy as np
import pytest
from amaranth import Module, Signal, signed, unsigned
from amaranth.hdl import Fragment, ResetInserter, Shape
from amaranth.lib import data
from amaranth.sim import Simulator

from hdl.lib.delay import MIN_SHARED_STAGES, WORD_BITS, check_aligned, delayed, wait_cycles

CLOCKS = 160


def simulated(m: Module, run: Any) -> None:
    """Run a testbench."""
    simulator = Simulator(Fragment.get(m, None))
    simulator.add_clock(1e-6)
    simulator.add_testbench(run)
    simulator.run()


@pytest.mark.parametrize("shape", [unsigned(1), signed(3), unsigned(9), signed(WORD_BITS), unsigned(70)])
def test_a_value_comes_a_number_of_clocks_later_and_its_initial_value_before_it(shape: Shape) -> None:
    m = Module()
    first = -1 if shape.signed else 1
    value = Signal(shape, init=first)
    delays = [0, 1, 2, MIN_SHARED_STAGES, MIN_SHARED_STAGES + 1, 64, 66, 130]
    results = [delayed(m, value, cycles, reset_less=cycles > 1) for cycles in delays]
    rng, sent = np.random.default_rng(1), list[int]()

    async def run(context: Any) -> None:
        for clock in range(CLOCKS):
            low = -(1 << shape.width - 1) if shape.signed else 0
            sent.append(int.from_bytes(rng.bytes(9), "little") % (1 << shape.width) + low)
            context.set(value, sent[-1])
            before = [first] * max(delays) + sent
            expected = [before[-1 - cycles] for cycles in delays]
            assert [context.get(result) for result in results] == expected, f"clock {clock}"
            await context.tick()

    simulated(m, run)


@pytest.mark.parametrize("cycles", [3, 20, 100])
def test_a_reset_empties_every_stage_of_a_valid_bit_and_none_of_its_data(cycles: int) -> None:
    m = Module()
    reset, source = Signal(), Signal(data.StructLayout({"valid": 1, "payload": 4}))
    valid = delayed(m, source.valid, cycles, reset_less=False)
    payload = delayed(m, source.payload, cycles)

    async def run(context: Any) -> None:
        context.set(source, {"valid": 1, "payload": 9})
        await context.tick().repeat(cycles)
        assert (context.get(valid), context.get(payload)) == (1, 9)
        context.set(reset, 1)
        await context.tick()
        context.set(reset, 0)
        for clock in range(cycles):
            assert (context.get(valid), context.get(payload)) == (0, 9), f"clock {clock}"
            await context.tick()
        assert context.get(valid) == 1

    simulated(ResetInserter(reset)(m), run)


@pytest.mark.usefixtures("unused_blocks")
def test_a_view_keeps_its_layout() -> None:
    m = Module()
    value = Signal(data.StructLayout({"x": 3, "y": signed(4)}))
    assert delayed(m, value, 12).shape() == value.shape()


@pytest.mark.usefixtures("unused_blocks")
def test_a_negative_delay_is_refused() -> None:
    with pytest.raises(ValueError, match="cycles is -1"):
        delayed(Module(), Signal(), -1)


def test_paths_that_meet_are_compared() -> None:
    check_aligned("lag_px", harris=4, fast=4)
    with pytest.raises(ValueError, match="lag_px must be equal where paths meet: harris has 5, fast has 4"):
        check_aligned("lag_px", harris=5, fast=4)


def test_a_path_waits_for_a_longer_one_only() -> None:
    assert wait_cycles("marks", 3, until=5) == 2
    assert wait_cycles("marks", 3, until=3) == 0
    with pytest.raises(ValueError, match="marks take 3 clocks, but the path that they meet only 2"):
        wait_cycles("marks", 3, until=2)
