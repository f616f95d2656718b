"""AMD's AXI DMA at the level of its registers, in direct register mode, by its product guide (PG021, version 7.1).

Each sentence of the guide that the exported driver relies on has a test in `tests/system/board/test_axi_dma.py`.
"""

from __future__ import annotations

import enum
from typing import Protocol

import numpy as np

from golden_model.arrays import Pixels
from golden_model.records import WORD_BYTES

CONTROL, STATUS, ADDRESS_LOW, ADDRESS_HIGH, LENGTH = 0x00, 0x04, 0x18, 0x1C, 0x28
RECEIVE_OFFSET = 0x30
"""The channel from stream to memory has the same registers from here on."""
RUN, RESET = 1 << 0, 1 << 2
CONTROL_DEFAULT = 0x0001_0002
"""After a reset: an interrupt threshold of 1, and a reserved bit that reads 1."""
CONTROL_WRITABLE = 0xFFFF_7019
MAX_LENGTH_BITS = 26
MIN_ADDRESS_BITS = 32
"""What the core is built with if nobody asks for more (``c_addr_width``)."""
RESET_READS = 2
"""Reads of a control register until a reset has ended; the guide gives no time."""
PREFETCH_WORDS = 4
"""Words that a receiving channel takes before a transfer is requested. Not in PG021; seen on hardware."""


class Status(enum.IntFlag):
    """Bits of DMASR."""

    HALTED = 1 << 0
    IDLE = 1 << 1
    INTERNAL_ERROR = 1 << 4
    SLAVE_ERROR = 1 << 5
    DECODE_ERROR = 1 << 6
    IOC_IRQ = 1 << 12
    ERR_IRQ = 1 << 14


class MemoryFaultError(Exception):
    """The memory answers by an error: ``status`` is the bit that the DMA shows, ``data`` what was read before."""

    def __init__(self, status: Status, data: Pixels) -> None:
        super().__init__(status)
        self.status, self.data = status, data


class Memory(Protocol):
    """What a DMA accesses; both raise `MemoryFaultError`."""

    def load(self, address: int, length_bytes: int) -> Pixels:
        """Read bytes."""

    def store(self, address: int, data: Pixels) -> None:
        """Write bytes."""


class Channel:
    """What both directions have: registers, and a transfer that LENGTH starts.

    Parameters
    ----------
    memory : Memory
    length_bits : int
        Width of LENGTH, 8 to 26.
    address_bits : int
        Width of addresses, 32 to 64; further bits that are written are lost.
    """

    def __init__(
        self, memory: Memory, length_bits: int = MAX_LENGTH_BITS, address_bits: int = MIN_ADDRESS_BITS
    ) -> None:
        self.memory, self.length_bits, self.address_bits = memory, length_bits, address_bits
        self.reset()

    def reset(self) -> None:
        """Put all registers into their reset state; a transfer in progress is over."""
        self.control, self.status = CONTROL_DEFAULT, Status.HALTED
        self.address = self.length = 0
        self.is_busy = False

    def read(self, offset: int) -> int:
        """Read a register."""
        values = {
            CONTROL: self.control,
            STATUS: int(self.status),
            ADDRESS_LOW: self.address & 0xFFFF_FFFF,
            ADDRESS_HIGH: self.address >> 32,
            LENGTH: self.length,
        }
        return values[offset]

    def write(self, offset: int, value: int) -> None:
        """Write a register."""
        if offset == CONTROL:
            self._control(value)
        elif offset == STATUS:
            self.status &= ~Status(value & (Status.IOC_IRQ | Status.ERR_IRQ))
        elif offset == ADDRESS_LOW:
            self.address = self.address >> 32 << 32 | value
        elif offset == ADDRESS_HIGH:
            self.address = (value << 32 | self.address & 0xFFFF_FFFF) & (1 << self.address_bits) - 1
        elif offset == LENGTH and not self.is_busy:
            self.length = value & (1 << self.length_bits) - 1
            if self.length and Status.HALTED not in self.status:
                self.status &= ~Status.IDLE
                self.is_busy = True
                self._begin()

    def _control(self, value: int) -> None:
        self.control = value & CONTROL_WRITABLE | CONTROL_DEFAULT & ~CONTROL_WRITABLE
        failed = self.status & (Status.INTERNAL_ERROR | Status.SLAVE_ERROR | Status.DECODE_ERROR)
        # After an error only a reset helps: the run bit has no effect.
        if value & RUN and not failed:
            self.status &= ~Status.HALTED
        elif not self.is_busy:
            self.status = self.status & ~Status.IDLE | Status.HALTED

    def _begin(self) -> None:
        """Start the transfer that LENGTH asks for."""

    def _end(self) -> None:
        self.is_busy = False
        self.status |= Status.IOC_IRQ | Status.IDLE
        if not self.control & RUN:
            self.status = self.status & ~Status.IDLE | Status.HALTED

    def _fail(self, error: Status) -> None:
        """Halt with an error; the run bit goes to 0."""
        self.is_busy = False
        self.control &= ~RUN
        self.status = self.status & ~Status.IDLE | Status.HALTED | Status.ERR_IRQ | error


class SendChannel(Channel):
    """From memory to stream (MM2S): bytes in ``outgoing`` wait to be sent."""

    def reset(self) -> None:
        """See `Channel.reset`; a packet on its way ends early."""
        super().reset()
        self.outgoing: Pixels = np.zeros(0, np.uint8)
        self._fault: Status | None = None

    def _begin(self) -> None:
        self._fault = None
        try:
            self.outgoing = self.memory.load(self.address, self.length)
        except MemoryFaultError as fault:
            # What was read before the fault is sent.
            self._fault, self.outgoing = fault.status, fault.data
            self.sent(0)

    @property
    def ends_packet(self) -> bool:
        """Whether the last byte of ``outgoing`` is that of the packet."""
        return self._fault is None

    def sent(self, count_bytes: int) -> None:
        """Bytes have left."""
        self.outgoing = self.outgoing[count_bytes:]
        if self.is_busy and not self.outgoing.size:
            if self._fault is None:
                self._end()
            else:
                self._fail(self._fault)


class ReceiveChannel(Channel):
    """From stream to memory (S2MM)."""

    def reset(self) -> None:
        """See `Channel.reset`; words taken before their transfer was requested are lost."""
        super().reset()
        self._early: list[tuple[Pixels, bool]] = []
        self._received = 0

    @property
    def room_words(self) -> int:
        """Words that the stream's side takes at the moment."""
        if self.is_busy:
            return -(-(self.length - self._received) // WORD_BYTES)
        return PREFETCH_WORDS - sum(data.size // WORD_BYTES for data, _ in self._early)

    def _begin(self) -> None:
        self._received = 0
        early, self._early = self._early, []
        for data, last in early:
            self.receive(data, last=last)

    def receive(self, data: Pixels, *, last: bool) -> None:
        """Take bytes of a packet, the last of which may end it."""
        if not self.is_busy:
            self._early.append((data, last))
            return
        try:
            self.memory.store(self.address + self._received, data[: self.length - self._received])
        except MemoryFaultError as fault:
            # "Flagged if any error occurs during Memory write", besides the bit of the error itself.
            self._fail(fault.status | Status.INTERNAL_ERROR)
            return
        self._received += data.size
        if self._received > self.length or (self._received == self.length and not last):
            self._fail(Status.INTERNAL_ERROR)
        elif last:
            self.length = self._received
            self._end()


class Dma:
    """The registers of an AXI DMA with one or both channels.

    Parameters
    ----------
    send : SendChannel or None
    receive : ReceiveChannel or None

    Attributes
    ----------
    is_stuck : bool
        While it is set, no reset ends.
    """

    def __init__(self, send: SendChannel | None = None, receive: ReceiveChannel | None = None) -> None:
        self.send, self.receive = send, receive
        self.restart()

    def restart(self) -> None:
        """The state of a design that has just been loaded."""
        self.is_stuck, self._reset_reads = False, 0
        for channel in filter(None, (self.send, self.receive)):
            channel.reset()

    @property
    def address_bits(self) -> int:
        """Width of addresses, which both channels have in common."""
        return next(channel.address_bits for channel in (self.send, self.receive) if channel)

    def read(self, offset: int) -> int:
        """Read a register; one of a channel that is not built reads 0."""
        channel = self._channel(offset)
        value = channel.read(offset % RECEIVE_OFFSET) if channel else 0
        if self._reset_reads and offset % RECEIVE_OFFSET == CONTROL:
            self._reset_reads -= not self.is_stuck
            return value | RESET
        return value

    def write(self, offset: int, value: int) -> None:
        """Write a register; a reset of either channel resets both, and writes meanwhile have no effect."""
        if self._reset_reads:
            return
        if offset % RECEIVE_OFFSET == CONTROL and value & RESET:
            self._reset_reads = RESET_READS
            for channel in filter(None, (self.send, self.receive)):
                channel.reset()
            return
        addressed = self._channel(offset)
        if addressed:
            addressed.write(offset % RECEIVE_OFFSET, value)

    def _channel(self, offset: int) -> Channel | None:
        return self.receive if offset >= RECEIVE_OFFSET else self.send
