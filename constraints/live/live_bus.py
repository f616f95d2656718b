"""Registers, memory and the scores' DMA of a live build under PYNQ. Never run, in no test and on no board."""

import time

from pynq import MMIO
from pynq_overlay import OverlayBus, Transfers, load_overlay

REGISTER_BYTES = 4096
TIMEOUT_SECONDS = 5.0


class LiveBus(OverlayBus):
    """Loads an overlay, and accesses the registers of its live build and memory for the rings.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file must be in the same folder.
    address : int
        Address of the registers in the block design.
    """

    def __init__(self, bitstream, address):
        self.overlay = load_overlay(bitstream)
        # By address: a live build is not packaged, so the overlay does not know its name.
        super().__init__(MMIO(address, REGISTER_BYTES))

    def address(self, buffer):
        """Return the address at which the accelerator finds the memory."""
        return buffer.device_address

    def invalidate(self, buffer):
        """Invalidate the memory's lines in the processor's cache."""
        buffer.invalidate()

    def exchange(self, sent, length_bytes, received):
        """Send ``length_bytes`` of hypotheses as a packet, and receive their scores; returns the scores' length.

        The block design has an AXI DMA in simple mode, ``dma_scores``, at the two streams.
        """
        transfers = Transfers(self.overlay, {"hypotheses": "dma_scores"}, {"scores": "dma_scores"})
        transfers.reset()
        transfers.start("scores", received, received.nbytes)
        transfers.start("hypotheses", sent, length_bytes)
        return transfers.wait(TIMEOUT_SECONDS)["scores"]

    def wait(self, seconds):
        """Pause the reader of the rings between two looks."""
        time.sleep(seconds)
