"""Loads an overlay for this process alone, and moves data by its AXI DMAs in simple mode. Needs PYNQ 3.0 or newer.

Every wait ends after a number of looks, which takes at least as long as its limit: by a clock, it would end although
nothing is wrong where other programs hold the processor. PYNQ's own `wait`, `start` and `stop` have no limit: they are
called only where they return at once.
"""

import fcntl
import math
import os
import pathlib
import tempfile
import time

import numpy as np
from pynq import Overlay, allocate
from skymosaic_map import MAX_TRANSFER_BYTES
from skymosaic_registers import AcceleratorError

POLL_SECONDS = 0.0002
MIN_BUFFER_BYTES = 8192
"""XRT 2.17 puts smaller buffers of a 64-bit processor beyond 32 address bits (PYNQ's pull request 1500)."""
RESET_SECONDS = 1.0
LOCK = pathlib.Path(tempfile.gettempdir()) / "skymosaic.lock"
# The registers of an AXI DMA (PG021), from the offset of its channel from memory, or of its channel to memory, on.
SEND, RECEIVE = 0x00, 0x30
CONTROL, STATUS = 0x00, 0x04
RUN, RESET = 1 << 0, 1 << 2
HALTED = 1 << 0
# The most precise first: a write that fails sets the last bit as well.
ERRORS = {
    1 << 6: "a decode error: there is no memory at the buffer's address",
    1 << 5: "a slave error: the memory refuses the buffer's address",
    1 << 4: "an internal error: a packet is longer than its buffer, or the memory failed",
}

_locks = []


def load_overlay(bitstream):
    """Load a bitstream, whose .hwh file must be in the same folder; no other process may use the overlay.

    Raises
    ------
    AcceleratorError
        If one does, or if the files are missing.
    """
    _lock_overlay()
    try:
        return Overlay(str(bitstream))
    except OSError as error:
        raise AcceleratorError(f"{bitstream}: {error}; copy the .bit and the .hwh file there") from None


def find_block(overlay, name):
    """Return the driver of a block of the overlay."""
    try:
        return getattr(overlay, name)
    except AttributeError:
        raise AcceleratorError(f"the overlay has no block {name}; load the bitstream of the same export") from None


def _lock_overlay():
    """Take a lock, which the system releases when the process ends, however it does."""
    if _locks:
        return
    try:
        # Everyone can write to the folder, and could put a link there.
        lock = os.open(LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        raise AcceleratorError(f"{LOCK}: {error.strerror}; remove it") from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        owner = os.read(lock, 20).decode() or "?"
        os.close(lock)
        raise AcceleratorError(f"process {owner} uses the overlay; end it first") from None
    os.ftruncate(lock, 0)
    os.write(lock, str(os.getpid()).encode())
    _locks.append(lock)


class OverlayBus:
    """Registers, as an IP core's driver or ``MMIO`` has them, and memory of a loaded overlay."""

    def __init__(self, registers):
        self.read, self.write = registers.read, registers.write

    def allocate(self, length_bytes):
        """Allocate memory that the accelerator and its DMAs can access; it starts at a page."""
        return allocate(shape=(max(length_bytes, MIN_BUFFER_BYTES),), dtype=np.uint8)[:length_bytes]


class Transfers:
    """Transfers of several DMA channels: for the name of each, the DMA that sends or receives in the overlay."""

    def __init__(self, overlay, sending, receiving):
        sends = {name: find_block(overlay, dma) for name, dma in sending.items()}
        receives = {name: find_block(overlay, dma) for name, dma in receiving.items()}
        self._dmas = {name: (dma, SEND) for name, dma in sends.items()}
        self._dmas |= {name: (dma, RECEIVE) for name, dma in receives.items()}
        self._channels = {name: dma.sendchannel for name, dma in sends.items()}
        self._channels |= {name: dma.recvchannel for name, dma in receives.items()}
        self._started = []

    def start(self, name, buffer, length_bytes):
        """Start to send the first ``length_bytes`` of a buffer, or to receive at most as many."""
        if not 1 <= length_bytes <= MAX_TRANSFER_BYTES:
            raise AcceleratorError(f"{length_bytes} bytes of {name}; a DMA transfers 1 to {MAX_TRANSFER_BYTES}")
        self._check(name)
        self._check_address(name, buffer.device_address, length_bytes)
        try:
            self._channels[name].transfer(buffer, 0, length_bytes)
        except (RuntimeError, ValueError) as error:
            raise AcceleratorError(f"the DMA of the {name} does not start: {error}") from None
        self._started.append(name)

    def wait(self, timeout_seconds):
        """Wait until every started transfer has ended; returns the lengths of received packets in bytes."""
        for _ in _looks(timeout_seconds):
            busy = [name for name in self._started if not self._is_done(name)]
            if not busy:
                break
        else:
            raise AcceleratorError(f"no answer within {timeout_seconds:g} s; still busy: {', '.join(busy)}")
        lengths = {}
        for name in self._started:
            # Returns at once; it invalidates the cache, and reads the length of what has come.
            self._channels[name].wait()
            if self._dmas[name][1] == RECEIVE:
                lengths[name] = self._channels[name].transferred
        self._started = []
        return lengths

    def reset(self):
        """Reset the DMAs, whatever they are doing, and start them again."""
        self._started = []
        for dma, offset in self._dmas.values():
            dma.write(offset + CONTROL, RESET)
        for name in self._dmas:
            self._await(name, CONTROL, RESET)
        for name, (dma, offset) in self._dmas.items():
            dma.write(offset + CONTROL, RUN)
            self._await(name, STATUS, HALTED)
            # It runs already; PYNQ has to know that the next transfer is the first.
            self._channels[name].start()

    def _is_done(self, name):
        self._check(name)
        return self._channels[name].idle

    def _check(self, name):
        dma, offset = self._dmas[name]
        status = dma.read(offset + STATUS)
        for bit, cause in ERRORS.items():
            if status & bit:
                raise AcceleratorError(f"the DMA of the {name} reports {cause}; send the frame again")
        if status & HALTED:
            raise AcceleratorError(f"the DMA of the {name} is halted: something has stopped it; send the frame again")

    def _check_address(self, name, address, length_bytes):
        """A DMA drops the address bits that it does not have, and would access other memory."""
        bits = int(self._dmas[name][0].description["parameters"].get("c_addr_width", 32))
        if address + length_bytes > 1 << bits:
            raise AcceleratorError(
                f"the buffer of the {name} lies at {address:#x}, beyond the {bits} address bits of its DMA; "
                "set c_addr_width of the DMA to 40 in the block design"
            )

    def _await(self, name, register, bit):
        """Wait until a bit of a register is 0."""
        dma, offset = self._dmas[name]
        if all(dma.read(offset + register) & bit for _ in _looks(RESET_SECONDS)):
            raise AcceleratorError(f"the DMA of the {name} does not reset; load the overlay again")


def _looks(seconds):
    """Yield at once, and then after each `POLL_SECONDS`, for at least so long."""
    yield
    for _ in range(math.ceil(seconds / POLL_SECONDS)):
        time.sleep(POLL_SECONDS)
        yield
