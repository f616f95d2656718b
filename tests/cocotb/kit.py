"""Random accesses to the registers of a kit's top, as it is exported, against a model of the register map."""

from __future__ import annotations

import random
from collections.abc import Coroutine, Iterable
from typing import Any

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, Combine
from cocotbext.axi import AxiResp

from hdl.axi.axi_lite import ADDRESS_BITS
from hdl.registers.register_map import Access, built_constants
from hdl.registers.shell_register_map import list_registers
from tests.cocotb.bench import RESET_CYCLES, Bench
from tests.cocotb.runner import KIT, SEED

ACCESSES, AT_ONCE, BATCHES_A_RESET = 200, 4, 5
BLOCK_BYTES = 1 << ADDRESS_BITS
MAX_BYTES = 9
"""Of one access: three words, if it begins inside of one."""
FROM_HARDWARE = (Access.STATUS, Access.EVENT, Access.REQUEST)


class Registers:
    """The bytes of the whole block: what software has written, and which bits are its to decide."""

    def __init__(self) -> None:
        self.writable, self.known, self.initial = (np.zeros(BLOCK_BYTES // 4, "<u4") for _ in range(3))
        constants = built_constants(KIT)
        for register in list_registers(KIT):
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
async def two_hundred_random_accesses(dut: Any) -> None:
    """Writes of 1 to 9 bytes anywhere, and reads around them; several at once, with pauses, and resets between."""
    bench, rng, registers = await Bench.open(dut), random.Random(SEED), Registers()
    bench.pause_at_random(SEED)
    offsets = [register.offset for register in list_registers(KIT)]
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
