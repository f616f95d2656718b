"""Registers and memory of a camera build under PYNQ. Not yet run on a board."""

import time

from pynq import MMIO
from pynq_overlay import OverlayBus, load_overlay

REGISTER_BYTES = 4096


class RingBus(OverlayBus):
    """Loads an overlay, and accesses the registers of its camera build and memory for the rings.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file must be in the same folder.
    address : int
        Address of the registers in the block design.
    """

    def __init__(self, bitstream, address):
        load_overlay(bitstream)
        # By address: a camera build is not packaged, so the overlay does not know its name.
        super().__init__(MMIO(address, REGISTER_BYTES))

    def address(self, buffer):
        """Return the address at which the accelerator finds the memory."""
        return buffer.device_address

    def invalidate(self, buffer):
        """Invalidate the memory's lines in the processor's cache."""
        buffer.invalidate()

    def flush(self, buffer):
        """Write the memory's lines in the processor's cache back, so that the accelerator sees them."""
        buffer.flush()

    def wait(self, seconds):
        """Pause the reader of the rings between two looks."""
        time.sleep(seconds)
