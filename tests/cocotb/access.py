"""Registers: random accesses against a model of their map, what was built, and the interrupt."""

from __future__ import annotations

import random
from collections.abc import Coroutine, Iterable
from typing import Any

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, Combine, RisingEdge
from cocotbext.axi import AxiResp

from golden_model.version import VERSION
from hdl.axi.axi_lite import ADDRESS_BITS
from hdl.registers.register_map import IDENTITY, REGISTERS, Access, built_constants
from sim.simulators.accelerator_designs import FEATURES, MATCHES
from tests.cocotb.bench import RESET_CYCLES, Bench, render_scene
from tests.cocotb.runner import BUILD, SEED

SMALL_PX = (64, 64)
ACCESSES, AT_ONCE, BATCHES_A_RESET = 400, 4, 10
BLOCK_BYTES = 1 << ADDRESS_BITS
MAX_BYTES = 9
"""Of one access: three words, if it begins inside of one."""
FROM_HARDWARE = (Access.STATUS, Access.EVENT, Access.REQUEST)


class Registers:
    """The bytes of the whole block: what software has written, and which bits are its to decide."""

    def __init__(self) -> None:
        self.writable, self.known, self.initial = (np.zeros(BLOCK_BYTES // 4, "<u4") for _ in range(3))
        constants = built_constants(BUILD)
        for register in REGISTERS:
            word = register.offset // 4
            for field in register.fields:
                value = constants[field.name] if field.access is Access.CONSTANT else field.init
                self.initial[word] |= value << field.low
                self.writable[word] |= field.mask if field.access is Access.SETTING else 0
                self.known[word] |= field.mask if field.access in FROM_HARDWARE else 0
        self.known = ~self.known
        self.reset()

    def reset(self) -> None:
        """Every field has its first value."""
        self.bytes = self.initial.view(np.uint8).copy()

    def write(self, address: int, data: bytes) -> None:
        """Settings keep what is written."""
        there = slice(address, address + len(data))
        mask = self.writable.view(np.uint8)[there]
        self.bytes[there] = self.bytes[there] & ~mask | np.frombuffer(data, np.uint8) & mask

    def check(self, address: int, data: bytes) -> None:
        """Whatever hardware does not decide is as it was written."""
        there = slice(address, address + len(data))
        wrong = (self.bytes[there] ^ np.frombuffer(data, np.uint8)) & self.known.view(np.uint8)[there]
        assert not wrong.any(), f"{address:#x}: {data.hex()} is not {self.bytes[there].tobytes().hex()}"


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def the_build_can_be_read(dut: Any) -> None:
    """Identity, version and the built configuration."""
    bench = await Bench.open(dut)
    assert await bench.read_word(0) == (AxiResp.OKAY, IDENTITY)
    assert await bench.read_word(4) == (AxiResp.OKAY, int.from_bytes(map(int, VERSION.split(".")), "big"))
    for name, value in built_constants(BUILD).items():
        assert await bench.read(name) == value, name


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def four_hundred_random_accesses(dut: Any) -> None:
    """Writes of 1 to 9 bytes anywhere, and reads around them; several at once, with pauses, and resets between."""
    bench, rng, registers = await Bench.open(dut), random.Random(SEED), Registers()
    bench.pause_at_random(SEED)
    offsets = [register.offset for register in REGISTERS]
    for batch in range(ACCESSES // (2 * AT_ONCE)):
        # Every third one wherever it may be.
        starts = [
            rng.choice((rng.choice(offsets) + rng.randint(0, 5), rng.choice(offsets), rng.randrange(BLOCK_BYTES)))
            for _ in range(AT_ONCE)
        ]
        places = [(start, min(rng.randint(1, MAX_BYTES), BLOCK_BYTES - start)) for start in starts]
        await _all_at_once(_write(bench, registers, start, rng.randbytes(length)) for start, length in places)
        await _all_at_once(_read(bench, registers, start & ~3, length + 3) for start, length in places)
        if batch % BATCHES_A_RESET == 0:
            dut.aresetn.value = 0
            await ClockCycles(dut.aclk, RESET_CYCLES)
            dut.aresetn.value = 1
            await ClockCycles(dut.aclk, RESET_CYCLES)
            registers.reset()


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


async def _all_at_once(accesses: Iterable[Coroutine[Any, Any, None]]) -> None:
    """Start accesses one after the other, without waiting for an answer; the registers get them in this order."""
    await Combine(*[cocotb.start_soon(each) for each in accesses])


async def _write(bench: Bench, registers: Registers, address: int, data: bytes) -> None:
    registers.write(address, data)
    assert await bench.write_word(address, data) == AxiResp.OKAY, hex(address)


async def _read(bench: Bench, registers: Registers, address: int, length: int) -> None:
    answer = await bench.registers.read(address, min(length, BLOCK_BYTES - address))
    assert answer.resp == AxiResp.OKAY, hex(address)
    registers.check(address, bytes(answer.data))
