"""Registers, memory and the scores' DMA of a live build under PYNQ 3.1. Not yet run on a board."""

import time

import numpy as np
from pynq import MMIO, Overlay, allocate
from skymosaic_registers import AcceleratorError

REGISTER_BYTES = 4096
POLL_SECONDS = 0.0002
TIMEOUT_SECONDS = 5.0


class LiveBus:
    """Loads an overlay, and accesses the registers of its live build and memory for the rings.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file must be in the same folder.
    address : int
        Address of the registers in the block design.
    """

    def __init__(self, bitstream, address):
        self.overlay = Overlay(bitstream)
        self._registers = MMIO(address, REGISTER_BYTES)

    def read(self, offset):
        """Read a register."""
        return self._registers.read(offset)

    def write(self, offset, value):
        """Write a register."""
        self._registers.write(offset, value)

    def allocate(self, length_bytes):
        """Allocate memory that the accelerator can write; it starts at a page."""
        return allocate(shape=(length_bytes,), dtype=np.uint8)

    def address(self, buffer):
        """The memory's address for the accelerator."""
        return buffer.device_address

    def invalidate(self, buffer):
        """Invalidate the memory's lines in the processor's cache."""
        buffer.invalidate()

    def exchange(self, sent, length_bytes, received):
        """Send ``length_bytes`` of hypotheses as a packet, and receive their scores; returns the scores' length.

        The block design has an AXI DMA in simple mode, ``dma_scores``, at the two streams.
        """
        dma = self.overlay.dma_scores
        dma.recvchannel.transfer(received)
        dma.sendchannel.transfer(sent, 0, length_bytes)
        end = time.monotonic() + TIMEOUT_SECONDS
        while not (dma.sendchannel.idle and dma.recvchannel.idle):
            if dma.sendchannel.error or dma.recvchannel.error:
                raise AcceleratorError("the DMA of the scores reports an error; reload the overlay")
            if time.monotonic() > end:
                raise AcceleratorError(f"no scores within {TIMEOUT_SECONDS:g} s; reload the overlay")
            time.sleep(POLL_SECONDS)
        received.invalidate()
        return dma.recvchannel.transferred

    def wait(self, seconds):
        """Wait for some time."""
        time.sleep(seconds)
