# amaranth: UnusedElaboratable=no
import random
from collections.abc import Callable
from typing import Any

import pytest
from amaranth.lib.wiring import FlippedInterface

from hdl.axi.axi_lite import Response
from hdl.build import Build
from hdl.registers.live_register_map import ALL_REGISTERS
from hdl.registers.register_file import RegisterFile
from hdl.registers.register_map import REGISTERS, Access, built_constants, fields
from tests.hdl.block_bench import BlockBench

CYCLE_LIMIT = 200
CONSTANTS = built_constants(Build())
OFFSETS = {register.name: register.offset for register in REGISTERS}


def offset_of(field_name: str) -> int:
    return next(r.offset for r in REGISTERS for f in r.fields if f.name == field_name)


async def write(
    ctx: Any, bus: FlippedInterface, address: int, data: int, *, strobe: int = 15, rng: random.Random | None = None
) -> int:
    """Write a register; ``rng`` chooses the order of address and data and delays the response."""
    waits = [rng.randrange(4) for _ in range(3)] if rng else [0, 0, 0]
    ctx.set(bus.awaddr, address)
    ctx.set(bus.wdata, data)
    ctx.set(bus.wstrb, strobe)
    pending = {"aw": waits[0], "w": waits[1]}
    for _ in range(CYCLE_LIMIT):
        for channel, wait in pending.items():
            ctx.set(getattr(bus, f"{channel}valid"), wait <= 0)
        accepted = [c for c, wait in pending.items() if wait <= 0 and ctx.get(getattr(bus, f"{c}ready"))]
        pending = {c: wait - 1 for c, wait in pending.items() if c not in accepted}
        await ctx.tick()
        for channel in accepted:
            ctx.set(getattr(bus, f"{channel}valid"), 0)
        if not pending:
            break
    for _ in range(waits[2]):
        await ctx.tick()
    return await response(ctx, bus, "b", "bresp")


async def response(ctx: Any, bus: FlippedInterface, channel: str, field: str) -> int:
    ctx.set(getattr(bus, f"{channel}ready"), 1)
    for _ in range(CYCLE_LIMIT):
        valid, value = ctx.get(getattr(bus, f"{channel}valid")), ctx.get(getattr(bus, field))
        await ctx.tick()
        if valid:
            ctx.set(getattr(bus, f"{channel}ready"), 0)
            return value
    raise AssertionError(f"no {field} within {CYCLE_LIMIT} clocks")


async def read(ctx: Any, bus: FlippedInterface, address: int) -> tuple[int, int]:
    ctx.set(bus.araddr, address)
    ctx.set(bus.arvalid, 1)
    for _ in range(CYCLE_LIMIT):
        ready = ctx.get(bus.arready)
        await ctx.tick()
        if ready:
            break
    ctx.set(bus.arvalid, 0)
    ctx.set(bus.rready, 1)
    for _ in range(CYCLE_LIMIT):
        valid, data, resp = ctx.get(bus.rvalid), ctx.get(bus.rdata), ctx.get(bus.rresp)
        await ctx.tick()
        if valid:
            ctx.set(bus.rready, 0)
            return data, resp
    raise AssertionError(f"no rdata within {CYCLE_LIMIT} clocks")


def simulate(testbench: Callable[..., Any]) -> None:
    registers = RegisterFile(constants=CONSTANTS)

    async def bench(ctx: Any) -> None:
        await testbench(ctx, registers)

    BlockBench(registers).run(bench)


def test_names_and_offsets_are_unique_and_fields_do_not_overlap() -> None:
    names = [field.name for register in ALL_REGISTERS for field in register.fields]
    assert len(set(names)) == len(names)
    assert [r.offset for r in ALL_REGISTERS] == sorted({r.offset for r in ALL_REGISTERS})
    for register in ALL_REGISTERS:
        assert sum(field.mask for field in register.fields) == sum({f.mask for f in register.fields})
        assert sum(field.bits for field in register.fields) == sum(f.mask for f in register.fields).bit_count()
        assert all(field.low + field.bits <= 32 for field in register.fields)


def test_every_constant_is_read_back() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        for field in fields(Access.CONSTANT):
            data, resp = await read(ctx, registers.bus, offset_of(field.name))
            assert resp == Response.OKAY
            assert (data & field.mask) >> field.low == CONSTANTS[field.name], field.name

    simulate(testbench)


@pytest.mark.parametrize("seed", range(3))
def test_settings_keep_what_was_written_whatever_the_order_of_channels(seed: int) -> None:
    rng = random.Random(seed)

    async def testbench(ctx: Any, registers: Any) -> None:
        for field in fields(Access.SETTING):
            assert ctx.get(getattr(registers, f"o_{field.name}")) == field.init
        for register in REGISTERS:
            settings = [field for field in register.fields if field.access is Access.SETTING]
            if not settings:
                continue
            data = rng.getrandbits(32) & sum(field.mask for field in settings)
            assert await write(ctx, registers.bus, register.offset, data, rng=rng) == Response.OKAY
            assert await read(ctx, registers.bus, register.offset) == (data, Response.OKAY)
            for field in settings:
                assert ctx.get(getattr(registers, f"o_{field.name}")) == (data & field.mask) >> field.low

    simulate(testbench)


def test_byte_strobes_are_obeyed() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        await write(ctx, registers.bus, OFFSETS["SIZE"], 0x03FF_02FF)
        await write(ctx, registers.bus, OFFSETS["SIZE"], 0x0155_0155, strobe=0b0101)
        assert await read(ctx, registers.bus, OFFSETS["SIZE"]) == (0x0355_0255, Response.OKAY)

    simulate(testbench)


@pytest.mark.parametrize("address", [0x1C, 0x3C, 0x68, 0x100, 0xFFC])
def test_an_unknown_address_reads_0_and_keeps_nothing(address: int) -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        assert await write(ctx, registers.bus, address, 0xFFFF_FFFF) == Response.OKAY
        assert await read(ctx, registers.bus, address) == (0, Response.OKAY)
        for field in fields(Access.SETTING):
            assert ctx.get(getattr(registers, f"o_{field.name}")) == field.init

    simulate(testbench)


def test_a_constant_beyond_its_field_is_refused() -> None:
    """Otherwise the board would read it without its upper bits, and no driver would accept it."""
    constants = built_constants(Build()) | {"built_lanes": 256}
    with pytest.raises(ValueError, match="built_lanes is 256; its register holds at most 255"):
        RegisterFile(constants=constants)


def test_a_constant_cannot_be_written() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        assert await write(ctx, registers.bus, OFFSETS["ID"], 0) == Response.OKAY
        assert (await read(ctx, registers.bus, OFFSETS["ID"]))[0] == int.from_bytes(b"SKYM", "big")

    simulate(testbench)


def test_events_stay_until_cleared_and_interrupt_where_masked_in() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        bus = registers.bus
        ctx.set(registers.i_frame_done, 1)
        await ctx.tick()
        ctx.set(registers.i_frame_done, 0)
        await ctx.tick()
        assert ctx.get(registers.o_interrupt) == 0
        await write(ctx, bus, OFFSETS["IRQ_MASK"], 0b001)
        assert ctx.get(registers.o_interrupt) == 1
        await write(ctx, bus, OFFSETS["IRQ_STATUS"], 0b110)
        assert ctx.get(registers.o_interrupt) == 1
        await write(ctx, bus, OFFSETS["IRQ_STATUS"], 0b001)
        assert ctx.get(registers.o_interrupt) == 0
        assert await read(ctx, bus, OFFSETS["IRQ_STATUS"]) == (0, Response.OKAY)

    simulate(testbench)


def test_an_event_in_the_clock_that_clears_it_is_kept() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        ctx.set(registers.i_frame_bad, 1)  # in every clock, the clearing one included
        await write(ctx, registers.bus, OFFSETS["IRQ_STATUS"], 0b111)
        ctx.set(registers.i_frame_bad, 0)
        assert (await read(ctx, registers.bus, OFFSETS["IRQ_STATUS"]))[0] == 0b100

    simulate(testbench)


def test_a_request_stands_until_it_is_obeyed_and_a_command_is_one_clock() -> None:
    async def testbench(ctx: Any, registers: Any) -> None:
        await write(ctx, registers.bus, OFFSETS["REFERENCE"], 1)
        assert (await read(ctx, registers.bus, OFFSETS["REFERENCE"]))[0] == 1
        ctx.set(registers.i_take_reference, 1)
        await ctx.tick()
        ctx.set(registers.i_take_reference, 0)
        await ctx.tick()
        assert (await read(ctx, registers.bus, OFFSETS["REFERENCE"]))[0] == 0

    simulate(testbench)


def test_clear_is_a_pulse_of_one_clock() -> None:
    registers = RegisterFile(constants=CONSTANTS)
    clocks: list[int] = []

    async def clear_registers(ctx: Any) -> None:
        await write(ctx, registers.bus, OFFSETS["CONTROL"], 1 << 8)
        await ctx.tick().repeat(5)

    async def watch(ctx: Any) -> None:
        async for _, _, clear in ctx.tick().sample(registers.o_clear):
            clocks.append(clear)

    BlockBench(registers).run(clear_registers, background=[watch])
    assert sum(clocks) == 1
