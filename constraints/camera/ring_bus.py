"""Registers, memory and the scores' DMA of a camera build under PYNQ. Not yet run on a board."""

import time

import numpy as np
import skymosaic_map as register_map
from pynq import MMIO
from pynq_overlay import OverlayBus, Transfers, load_overlay

REGISTER_BYTES = 4096
TIMEOUT_SECONDS = 5.0
END_NUMBER = 0xFFFF
"""Number of the record that ends a broken packet; no hypothesis has it."""


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
        overlay = load_overlay(bitstream)
        # By address: a camera build is not packaged, so the overlay does not know its name.
        super().__init__(MMIO(address, REGISTER_BYTES))
        self._transfers = Transfers(overlay, {"hypotheses": "dma_scores"}, {"scores": "dma_scores"})
        self._is_ready = False
        self._end = self.allocate(register_map.HYPOTHESIS.itemsize)
        self._end[:] = 0xFF

    def address(self, buffer):
        """Return the address at which the accelerator finds the memory."""
        return buffer.device_address

    def invalidate(self, buffer):
        """Invalidate the memory's lines in the processor's cache."""
        buffer.invalidate()

    def flush(self, buffer):
        """Write the memory's lines in the processor's cache back, so that the accelerator sees them."""
        buffer.flush()

    def exchange(self, sent, length_bytes, received):
        """Send ``length_bytes`` of hypotheses as a packet, and receive their scores; returns the scores' length.

        The block design has an AXI DMA in simple mode, ``dma_scores``, at the two streams.
        """
        if not self._is_ready:
            self._recover(received)
        self._is_ready = False
        length = self._exchange(sent, length_bytes, received)
        self._is_ready = True
        return length

    def _exchange(self, sent, length_bytes, received):
        self._transfers.start("scores", received, received.nbytes)
        self._transfers.start("hypotheses", sent, length_bytes)
        return self._transfers.wait(TIMEOUT_SECONDS)["scores"]

    def _recover(self, received):
        """End a packet that an error has cut, and take the scores that are left of it."""
        self._transfers.reset()
        # A record of ones is answered by its number, also where its words complete the one that was cut.
        length = self._exchange(self._end, self._end.nbytes, received)
        while not _is_end(received[:length]):
            self._transfers.start("scores", received, received.nbytes)
            length = self._transfers.wait(TIMEOUT_SECONDS)["scores"]

    def wait(self, seconds):
        """Pause the reader of the rings between two looks."""
        time.sleep(seconds)


def _is_end(packet):
    """Whether the last answer of a packet is that to the record that `RingBus` ends packets with."""
    last = np.array(packet[-register_map.SCORE.itemsize :])
    return last.nbytes == register_map.SCORE.itemsize and last.view(register_map.SCORE)["number"][0] == END_NUMBER
