"""Registers: the behaviour of each kind of field, accesses to none, and the interrupt."""

from typing import Any

import cocotb
from cocotb.triggers import ClockCycles, RisingEdge
from cocotbext.axi import AxiResp

from golden_model.version import VERSION
from hdl.registers.register_map import IDENTITY, REGISTERS, Access, Register, built_constants
from sim.simulators.accelerator_designs import FEATURES, MATCHES
from tests.cocotb.bench import REGISTER_BYTES, Bench, render_scene
from tests.cocotb.runner import BUILD

KNOWN_ADDRESSES = {register.offset for register in REGISTERS}
UNKNOWN_ADDRESSES = sorted({*range(0, max(KNOWN_ADDRESSES) + 8, 4), 0x200, 0xFFC} - KNOWN_ADDRESSES)
"""Addresses between and after the registers."""
SMALL_PX = (64, 64)
READ_ONLY = (Access.CONSTANT, Access.STATUS)
EVENTS = ("frame_done", "matches_done", "frame_bad")


def _mask_settings(register: Register) -> int:
    """The bits of a register that can be written and read back."""
    return sum(field.mask for field in register.fields if field.access == Access.SETTING)


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def the_build_can_be_read(dut: Any) -> None:
    """Identity, version and the built configuration."""
    bench = await Bench.open(dut)
    assert await bench.read_word(0) == (AxiResp.OKAY, IDENTITY)
    assert await bench.read_word(4) == (AxiResp.OKAY, int.from_bytes(map(int, VERSION.split(".")), "big"))
    for name, value in built_constants(BUILD).items():
        assert await bench.read(name) == value, name


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def settings_are_kept_byte_by_byte(dut: Any) -> None:
    """Every setting, with pauses on all channels: from its initial value to all ones, one byte strobe after another."""
    bench = await Bench.open(dut)
    bench.pause_at_random(300)
    for register in REGISTERS:
        bits = _mask_settings(register)
        if not bits:
            continue
        expected = sum(field.init << field.low for field in register.fields)
        assert await bench.read_word(register.offset) == (AxiResp.OKAY, expected), register.name
        for byte, ones in enumerate(bits.to_bytes(REGISTER_BYTES, "little")):
            assert await bench.write_word(register.offset + byte, bytes([ones])) == AxiResp.OKAY
            expected |= ones << 8 * byte
            assert await bench.read_word(register.offset) == (AxiResp.OKAY, expected), register.name
        assert await bench.write_word(register.offset, bytes(REGISTER_BYTES)) == AxiResp.OKAY
        assert await bench.read_word(register.offset) == (AxiResp.OKAY, 0), register.name


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def other_accesses_read_0_and_change_nothing(dut: Any) -> None:
    """Writes to read-only registers, and all accesses to other addresses; none is answered with an error."""
    bench = await Bench.open(dut)
    before = {register.offset: await bench.read_word(register.offset) for register in REGISTERS}
    for address in UNKNOWN_ADDRESSES:
        assert await bench.write_word(address, bytes([0xFF] * REGISTER_BYTES)) == AxiResp.OKAY, hex(address)
        assert await bench.read_word(address) == (AxiResp.OKAY, 0), hex(address)
    for register in REGISTERS:
        if all(field.access in READ_ONLY for field in register.fields):
            assert await bench.write_word(register.offset, bytes([0xFF] * REGISTER_BYTES)) == AxiResp.OKAY
    assert before == {register.offset: await bench.read_word(register.offset) for register in REGISTERS}


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def the_interrupt_is_high_while_a_masked_event_is_set(dut: Any) -> None:
    """Events are set even if they are masked; writing 1 to an event clears it and no other."""
    bench = await Bench.open(dut)
    image = render_scene(SMALL_PX, gray=True)[0]
    await bench.configure(image, memory_mode=1)
    await bench.send_memory(image)
    await bench.receive_frames(1)
    assert await _read_events(bench) == [1, 1, 0]
    assert not dut.interrupt.value
    await bench.write(frame_bad_mask=1)
    assert not dut.interrupt.value
    await bench.write(matches_done_mask=1)
    assert dut.interrupt.value
    await bench.write(frame_done=1)
    assert await _read_events(bench) == [0, 1, 0]
    assert dut.interrupt.value
    await bench.write(frame_bad=1)
    assert await _read_events(bench) == [0, 1, 0]
    await bench.write(matches_done=1)
    assert await _read_events(bench) == [0, 0, 0]
    assert not dut.interrupt.value


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def the_interrupt_marks_the_end_of_a_packet(dut: Any) -> None:
    """The interrupt rises when the last word of the frame has been taken, not before."""
    bench = await Bench.open(dut)
    image = render_scene(SMALL_PX, gray=True)[0]
    matches = bench.sinks[MATCHES]
    matches.pause = True
    await bench.configure(image, memory_mode=1, matches_done_mask=1)
    await bench.send_memory(image)
    await bench.receive_packet(FEATURES)
    while not await bench.read("matches_waiting"):
        await ClockCycles(dut.aclk, 100)
    assert not dut.interrupt.value
    matches.pause = False
    await RisingEdge(dut.interrupt)
    assert not matches.empty()


async def _read_events(bench: Bench) -> list[int]:
    return [await bench.read(name) for name in EVENTS]
