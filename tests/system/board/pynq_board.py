"""A board for PYNQ's own classes: its memory behind a cache, its block design, and the simulated accelerator in it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from hdl.build import BUILDS, Build
from hdl.export.ip_xact import VLNV
from hdl.settings import PAGE_BYTES
from sim.benches.camera import CameraBench
from sim.benches.memory import BASE
from sim.simulators import verilator
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.compiled import Bench
from sim.simulators.recording import END_OF_LINE, NO_PAUSES, Segment
from tests.system.board.axi_dma import Dma, MemoryFaultError, ReceiveChannel, SendChannel, Status
from tests.system.board.pynq_package import NEWEST, import_pynq

POLL_CLOCKS = 2000
"""Simulated time of a read of a DMA's register."""
BEAT_BYTES = 4
REGISTER_RANGE = 0x1_0000
DMA_TYPE = "xilinx.com:ip:axi_dma:7.1"
ACCELERATOR_ADDRESS, DMA_ADDRESS = 0x43C0_0000, 0x4040_0000
DRAM_BASE, DRAM_BYTES = 0x6800_0000, 256 << 20
HIGH_BASE, HIGH_BYTES = 0x8_7000_0000, 1 << 20
"""A Kria's memory beyond 32 address bits; without those bits, 0x7000_0000 is other memory that is there."""
SMALL_BYTES = 4096
"""XRT 2.17 puts buffers up to this size there (PYNQ's pull request 1500)."""


class Block(Protocol):
    """Registers of the block design."""

    def read(self, offset: int, /) -> int:
        """Read a register."""

    def write(self, offset: int, value: int, /) -> None:
        """Write a register."""


class Window:
    """The registers of a block as PYNQ's MMIO sees them: an array of words."""

    def __init__(self, block: Block) -> None:
        self._block = block

    def __getitem__(self, index: int) -> int:
        return self._block.read(4 * index)

    def __setitem__(self, index: int, value: int) -> None:
        self._block.write(4 * index, int(value))


class Board:
    """The device of PYNQ's classes: registers at their addresses, and memory of which the processor has a cached copy.

    What a DMA writes, software sees only after ``invalidate``; what software writes, a DMA sees only after ``flush``.
    As on a Kria with XRT 2.17, small buffers lie beyond 32 address bits.

    Parameters
    ----------
    dram : uint8 ndarray
        The memory itself, without what is at `HIGH_BASE`.
    base : int
        Its address.

    Attributes
    ----------
    bad_address : int or None
        Reads and writes of this address are answered by SLVERR.
    on_download : callable
        Called when a bitstream is loaded.
    """

    name = "board"

    def __init__(self, dram: Pixels, base: int) -> None:
        self.dram, self.base = dram, base
        self._banks = {base: dram, HIGH_BASE: np.zeros(HIGH_BYTES, np.uint8)}
        self._free = {bank: bank for bank in self._banks}
        self.bad_address: int | None = None
        self.on_download: Callable[[], None] = lambda: None
        self.bitfile_name = self.timestamp = ""
        self._cached: dict[int, Pixels] = {}
        self._windows: dict[int, Window] = {}
        self.parser = SimpleNamespace(
            ip_dict={}, gpio_dict={}, interrupt_controllers={}, interrupt_pins={}, hierarchy_dict={}, mem_dict={},
            clock_dict={},
        )  # fmt: skip

    def add(self, name: str, address: int, vlnv: str, block: Block, parameters: Mapping[str, str]) -> None:
        """Add a block to the design, as PYNQ reads it from the .hwh file."""
        self._windows[address] = Window(block)
        self.parser.ip_dict[name] = {
            "fullpath": name,
            "type": vlnv,
            "phys_addr": address,
            "addr_range": REGISTER_RANGE,
            "parameters": dict(parameters),
            "interrupts": {},
            "gpio": {},
        }

    def add_dma(self, name: str, address: int, dma: Dma, block: Block) -> None:
        """Add an AXI DMA with the parameters that build.tcl gives it."""
        self.add(name, address, DMA_TYPE, block, {
            "c_include_sg": "0",
            "c_sg_length_width": "26",
            "c_addr_width": str(dma.address_bits),
            "c_include_mm2s": str(int(dma.send is not None)),
            "c_include_s2mm": str(int(dma.receive is not None)),
            "c_m_axi_mm2s_data_width": "64",
            "c_m_axi_s2mm_data_width": "64",
        })  # fmt: skip

    def has_capability(self, name: str) -> bool:
        """The processor maps registers into memory."""
        return name == "MEMORY_MAPPED"

    def mmap(self, base: int, length: int) -> Window:
        """Map registers; stands for /dev/mem."""
        return self._windows[base]

    def set_bitfile_name(self, name: str) -> None:
        """Called by the overlay, which has loaded the metadata."""

    def download(self, name: str) -> None:
        """Load a bitstream; stands for the FPGA manager."""
        self.bitfile_name = name
        self.on_download()

    def allocate(self, shape: tuple[int, ...], dtype: Any, **_: Any) -> NDArray[Any]:
        """A PynqBuffer at the next free pages; stands for the kernel's contiguous memory."""
        # Arrays of NumPy 2 have a read-only attribute of this name, which PYNQ's buffer sets.
        settable = type("PynqBuffer", (sys.modules["pynq.buffer"].PynqBuffer,), {"device": None})
        length = int(np.prod(shape)) * np.dtype(dtype).itemsize
        bank = HIGH_BASE if length <= SMALL_BYTES else self.base
        address = self._free[bank]
        self._free[bank] += -(-length // PAGE_BYTES) * PAGE_BYTES
        assert address + length <= bank + self._banks[bank].size, "the board's memory is too small"
        self._cached[address] = np.zeros(length, np.uint8)
        buffer: NDArray[Any] = settable(
            shape, dtype, buffer=self._cached[address], device=self, device_address=address, bo=address
        )
        return buffer

    def flush(self, bo: int, offset: int, _: int, length: int) -> None:
        """Write the cache back."""
        self._memory(bo + offset, length)[:] = self._cached[bo][offset:][:length]

    def invalidate(self, bo: int, offset: int, _: int, length: int) -> None:
        """Drop the cache's lines: software sees what is in the memory."""
        self._cached[bo][offset:][:length] = self._memory(bo + offset, length)

    def load(self, address: int, length_bytes: int) -> Pixels:
        """See `tests.system.board.axi_dma.Memory`."""
        return self._accessed(address, length_bytes).copy()

    def store(self, address: int, data: Pixels) -> None:
        """See `tests.system.board.axi_dma.Memory`."""
        self._accessed(address, data.size)[:] = data

    def _accessed(self, address: int, length_bytes: int) -> Pixels:
        """The memory at an address, unless it answers a DMA by an error."""
        there = self._memory(address, length_bytes)
        if self.bad_address is not None and address <= self.bad_address < address + length_bytes:
            raise MemoryFaultError(Status.SLAVE_ERROR, there[: self.bad_address - address].copy())
        return there

    def _memory(self, address: int, length_bytes: int) -> Pixels:
        for base, bank in self._banks.items():
            if base <= address and address + length_bytes <= base + bank.size:
                return bank[address - base :][:length_bytes]
        raise MemoryFaultError(Status.DECODE_ERROR, np.zeros(0, np.uint8))


class _Polled:
    """Registers; time passes when one is read."""

    def __init__(self, block: Block, system: AcceleratorSystem | CameraSystem) -> None:
        self._block, self._system = block, system

    def read(self, offset: int) -> int:
        self._system.advance()
        return self._block.read(offset)

    def write(self, offset: int, value: int) -> None:
        self._block.write(offset, value)


class AcceleratorSystem:
    """The block design of `skymosaic export board` around the simulated accelerator.

    Parameters
    ----------
    bench : Bench
        The compiled accelerator with a video input of 32 bits.
    """

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.board = board = Board(np.zeros(DRAM_BYTES, np.uint8), DRAM_BASE)
        self.video = Dma(send=SendChannel(board))
        self.receiving = {output: Dma(receive=ReceiveChannel(board)) for output in bench.ports.outputs}
        board.add("skymosaic", ACCELERATOR_ADDRESS, VLNV, bench, {})
        dmas = {port.replace("m_axis", "dma"): dma for port, dma in self.receiving.items()}
        for number, (name, dma) in enumerate([("dma_video", self.video), *dmas.items()]):
            board.add_dma(name, DMA_ADDRESS + number * REGISTER_RANGE, dma, _Polled(dma, self))

        board.on_download = self._start

    def _start(self) -> None:
        """The state of a design that has just been loaded."""
        self.bench.reset()
        for dma in (self.video, *self.receiving.values()):
            dma.restart()

    def advance(self) -> None:
        """Run the simulation for `POLL_CLOCKS`, between the channels as they are."""
        send = self.video.send
        assert send is not None
        end = self.bench.cycle + POLL_CLOCKS
        while (clocks := end - self.bench.cycle) > 0:
            data = send.outgoing.view(np.uint32).astype(np.uint64)
            flags = np.zeros(data.size, np.uint8)
            if data.size and send.ends_packet:
                flags[-1] = END_OF_LINE
            channels = {port: dma.receive for port, dma in self.receiving.items()}
            rooms = np.array([channel.room_words for channel in channels.values() if channel], np.uint64)
            _, recording = self.bench.stream(Segment(data, flags, 1, clocks), NO_PAUSES, rooms)
            for name, channel in channels.items():
                output = recording.outputs[name]
                if channel and output.words.size:
                    channel.receive(output.words.view(np.uint8), last=bool(len(output.ends)))
            send.sent(self.bench.call("sent") * BEAT_BYTES)


class CameraSystem:
    """A camera build around a `CameraBench` whose memory is the board's.

    Parameters
    ----------
    bench : CameraBench
    """

    def __init__(self, bench: CameraBench) -> None:
        self.bench = bench
        self.board = board = Board(bench.memory, BASE)
        registers = _Polled(bench, self)
        board.add("skymosaic_camera", ACCELERATOR_ADDRESS, "skymosaic:vision:skymosaic_camera:1.0", registers, {})

    def advance(self) -> None:
        """Run the simulation for `POLL_CLOCKS`."""
        self.bench.run(POLL_CLOCKS)


def open_board(build: Build = BUILDS["pynq_z2"], version: str = NEWEST) -> AcceleratorSystem:
    """Start a build, and put PYNQ's package ``pynq`` in front of it."""
    design = design_accelerator(build)
    system = AcceleratorSystem(Bench(verilator.build_library(design), design.ports))
    import_pynq(version, system.board)
    return system
