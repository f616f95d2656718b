# amaranth: UnusedElaboratable=no
"""Events, requests and commands that meet in a clock; each kind of field is in `tests/cocotb/access.py`."""

from collections.abc import Callable
from typing import Any

import pytest

from hdl.axi.axi_lite import Response
from hdl.build import Build
from hdl.registers.register_file import RegisterFile
from hdl.registers.register_map import REGISTERS, Access, built_constants, fields
from tests.hdl.axi.manager import read, write
from tests.hdl.block_bench import BlockBench

CONSTANTS = built_constants(Build())
OFFSETS = {register.name: register.offset for register in REGISTERS}


def simulate(testbench: Callable[..., Any]) -> None:
    registers = RegisterFile(constants=CONSTANTS)

    async def bench(ctx: Any) -> None:
        await testbench(ctx, registers)

    BlockBench(registers).run(bench)


def test_a_constant_beyond_its_field_is_refused() -> None:
    """Otherwise the board would read it without its upper bits, and no driver would accept it."""
    constants = built_constants(Build()) | {"built_lanes": 256}
    with pytest.raises(ValueError, match="built_lanes is 256; its register holds at most 255"):
        RegisterFile(constants=constants)


@pytest.mark.parametrize("event", [field.name for field in fields(Access.EVENT)])
def test_each_event_interrupts_under_its_own_mask_until_it_is_cleared(event: str) -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        for field in fields(Access.EVENT):
            ctx.set(getattr(registers, f"i_{field.name}"), 1)
        await ctx.tick()
        for field in fields(Access.EVENT):
            ctx.set(getattr(registers, f"i_{field.name}"), 0)
        bit = 1 << next(field.low for field in fields(Access.EVENT) if field.name == event)
        for mask in (bit, 7):
            await write(ctx, registers.bus, OFFSETS["IRQ_MASK"], mask)
            assert ctx.get(registers.o_interrupt)
            await write(ctx, registers.bus, OFFSETS["IRQ_STATUS"], bit)
            assert (await read(ctx, registers.bus, OFFSETS["IRQ_STATUS"]))[0] == 7 & ~bit
            # The others are set, and interrupt only under their own masks.
            assert ctx.get(registers.o_interrupt) == (mask == 7)

    simulate(testbench)


def test_a_byte_without_strobe_clears_no_event_and_commands_nothing() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        bus = registers.bus
        await BlockBench.pulse(ctx, registers.i_frame_done)
        await write(ctx, bus, OFFSETS["IRQ_STATUS"], 0b111, strobe=0b1110)
        assert await read(ctx, bus, OFFSETS["IRQ_STATUS"]) == [0b001, Response.OKAY]
        await write(ctx, bus, OFFSETS["REFERENCE"], 1, strobe=0b1110)
        assert await read(ctx, bus, OFFSETS["REFERENCE"]) == [0, Response.OKAY]

    simulate(testbench)


def test_an_event_in_the_clock_that_clears_it_is_kept() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        ctx.set(registers.i_frame_bad, 1)  # in every clock, the clearing one included
        await write(ctx, registers.bus, OFFSETS["IRQ_STATUS"], 0b111)
        ctx.set(registers.i_frame_bad, 0)
        assert (await read(ctx, registers.bus, OFFSETS["IRQ_STATUS"]))[0] == 0b100

    simulate(testbench)


def test_a_request_in_the_clock_that_obeys_the_one_before_is_kept() -> None:
    registers = RegisterFile(constants=CONSTANTS)
    pending: list[int] = []

    async def request(ctx: Any) -> None:
        ctx.set(registers.i_take_reference, 1)  # in every clock, that of the write included
        await write(ctx, registers.bus, OFFSETS["REFERENCE"], 1)
        await ctx.tick().repeat(3)

    async def watch(ctx: Any) -> None:
        async for *_, requested in ctx.tick().sample(registers.o_take_reference):
            pending.append(requested)

    BlockBench(registers).run(request, background=[watch])
    assert sum(pending) == 1


def test_clear_is_a_pulse_of_one_clock() -> None:
    registers = RegisterFile(constants=CONSTANTS)
    clocks: list[int] = []

    async def clear_registers(ctx: Any) -> None:
        await write(ctx, registers.bus, OFFSETS["CONTROL"], 1 << 8, strobe=0b1101)
        await write(ctx, registers.bus, OFFSETS["CONTROL"], 1 << 8)
        await ctx.tick().repeat(5)

    async def watch(ctx: Any) -> None:
        async for _, _, clear in ctx.tick().sample(registers.o_clear):
            clocks.append(clear)

    BlockBench(registers).run(clear_registers, background=[watch])
    assert sum(clocks) == 1
