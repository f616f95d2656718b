"""Accesses the accelerator's registers and DMAs under PYNQ, by `pynq_overlay`."""

import skymosaic_map as register_map
from pynq import DefaultIP

from pynq_overlay import OverlayBus, Transfers, find_block, load_overlay
from skymosaic_driver import CHANNELS


class Skymosaic(DefaultIP):
    """The IP core in an overlay; PYNQ binds this class by the core's VLNV."""

    bindto = [register_map.CORE]


class PynqBus(OverlayBus):
    """Loads an overlay, and accesses its registers and DMAs.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file must be in the same folder.

    Raises
    ------
    AcceleratorError
        If a file is missing, another process uses the overlay, or it has other blocks.
    """

    def __init__(self, bitstream):
        overlay = load_overlay(bitstream)
        super().__init__(find_block(overlay, "skymosaic"))
        receiving = {channel: "dma_" + channel for channel in CHANNELS}
        self._transfers = Transfers(overlay, {"video": "dma_video"}, receiving)
        self.wait, self.reset = self._transfers.wait, self._transfers.reset

    def start_send(self, buffer, length_bytes):
        """Start to send a frame from ``buffer``."""
        self._transfers.start("video", buffer, length_bytes)

    def start_receive(self, channel, buffer):
        """Start to receive the next packet of ``channel`` into ``buffer``."""
        self._transfers.start(channel, buffer, buffer.nbytes)
