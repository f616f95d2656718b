"""Registers and memory of a live build under PYNQ 3.1. Not yet run on a board."""

import time

import numpy as np
from pynq import MMIO, Overlay, allocate

REGISTER_BYTES = 4096


class LiveBus:
    """Loads an overlay and gives access to the registers of its live build, and to memory for the rings.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file must be in the same folder.
    address : int
        Of the registers in the block design.
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
        """Where the accelerator finds the memory."""
        return buffer.device_address

    def invalidate(self, buffer):
        """Forget what the processor's cache holds of the memory."""
        buffer.invalidate()

    def wait(self, seconds):
        """Do nothing for a while."""
        time.sleep(seconds)
