# amaranth: UnusedElaboratable=no
"""Bytes as levels of a pin, also those of another clock; what is sent is in `test_link`."""

from typing import Any

import pytest
from amaranth.sim import Simulator

from hdl.serial.uart import UartReceiver, UartTransmitter
from tests.hdl.block_bench import CLOCK_S

SENT = [0x00, 0xFF, 0x55, 0xA3, 0x01, 0x80]


def bits(byte: int) -> list[int]:
    """A start bit, the byte from its lowest bit on, and a stop bit."""
    return [0, *(byte >> n & 1 for n in range(8)), 1]


def received(levels: list[tuple[int, float]], clocks_per_bit: int) -> tuple[list[int], int]:
    """The bytes that a pin's levels give, each held for a number of bits, and how many had no stop bit."""
    dut = UartReceiver(clocks_per_bit=clocks_per_bit)
    found: list[int] = []
    broken = [0]

    async def drive(ctx: Any) -> None:
        ctx.set(dut.i_pin, 1)
        await ctx.delay(8.3 * CLOCK_S)
        for level, length_bits in levels:
            ctx.set(dut.i_pin, level)
            await ctx.delay(length_bits * clocks_per_bit * CLOCK_S)
        await ctx.delay(2 * clocks_per_bit * CLOCK_S)

    async def watch(ctx: Any) -> None:
        async for *_, valid, byte, is_broken in ctx.tick().sample(dut.o_valid, dut.o_byte, dut.o_broken):
            broken[0] += is_broken
            if valid:
                found.append(byte)

    simulator = Simulator(dut)
    simulator.add_clock(CLOCK_S)
    simulator.add_testbench(drive)
    simulator.add_testbench(watch, background=True)
    simulator.run()
    return found, broken[0]


@pytest.mark.parametrize("rate", [0.98, 1.0, 1.02])
@pytest.mark.parametrize("clocks_per_bit", [16, 25])
def test_bytes_of_a_clock_that_differs_by_two_percent_arrive_without_a_pause(clocks_per_bit: int, rate: float) -> None:
    levels = [(bit, 1 / rate) for byte in SENT for bit in bits(byte)]
    assert received(levels, clocks_per_bit) == (SENT, 0)


def test_a_byte_without_stop_bit_is_dropped_and_a_glitch_is_no_byte() -> None:
    whole = [(bit, 1.0) for bit in bits(0x5A)]
    broken = [*((bit, 1.0) for bit in bits(0x0F)[:-1]), (0, 1.0), (1, 3.0)]
    assert received([(0, 0.3), (1, 12.0), *broken, *whole], 16) == ([0x5A], 1)


@pytest.mark.parametrize("block", [UartReceiver, UartTransmitter])
def test_too_few_clocks_for_a_bit_are_refused(block: type[UartReceiver] | type[UartTransmitter]) -> None:
    with pytest.raises(ValueError, match="clocks_per_bit is 3"):
        block(clocks_per_bit=3)
