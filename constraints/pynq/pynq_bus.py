"""Access to the accelerator's registers and DMAs under PYNQ 3.1."""

import time

import skymosaic_map as register_map
from pynq import DefaultIP, Overlay

from pynq_overlay import POLL_SECONDS, OverlayBus, wait_until_idle
from skymosaic_driver import CHANNELS
from skymosaic_registers import AcceleratorError

RESET_SECONDS = 1.0
# The control registers of an AXI DMA (PG021), for its channel from memory and its channel to memory.
SEND_CONTROL, RECEIVE_CONTROL = 0x00, 0x30
CONTROL_RESET = 1 << 2


class Skymosaic(DefaultIP):
    """The IP core in an overlay; PYNQ binds this class by the core's VLNV."""

    bindto = [register_map.CORE]


class PynqBus(OverlayBus):
    """Loads an overlay, and accesses its registers and DMAs.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file must be in the same folder.
    """

    def __init__(self, bitstream):
        overlay = Overlay(bitstream)
        super().__init__(overlay.skymosaic)
        dmas = {channel: getattr(overlay, "dma_" + channel) for channel in CHANNELS}
        self._send = overlay.dma_video.sendchannel
        self._receive = {channel: dma.recvchannel for channel, dma in dmas.items()}
        self._controls = {"video": (overlay.dma_video, SEND_CONTROL)}
        self._controls |= {channel: (dma, RECEIVE_CONTROL) for channel, dma in dmas.items()}

    def start_send(self, buffer, length_bytes):
        """Start to send a frame from ``buffer``."""
        self._send.transfer(buffer, 0, length_bytes)

    def start_receive(self, channel, buffer):
        """Start to receive the next packet of ``channel`` into ``buffer``."""
        self._receive[channel].transfer(buffer)

    def wait(self, timeout_seconds):
        """Wait until every started transfer has ended; returns the lengths of the packets in bytes."""
        wait_until_idle({"video": self._send, **self._receive}, timeout_seconds)
        return {name: channel.transferred for name, channel in self._receive.items()}

    def reset(self):
        """Reset the DMAs, whatever they are doing, and start them again."""
        # Not by PYNQ's `stop`, which waits without a limit for a transfer that never ends.
        for dma, control in self._controls.values():
            dma.write(control, CONTROL_RESET)
        end = time.monotonic() + RESET_SECONDS
        for name, (dma, control) in self._controls.items():
            while dma.read(control) & CONTROL_RESET:
                if time.monotonic() > end:
                    raise AcceleratorError(f"the DMA of the {name} does not reset; reload the overlay")
                time.sleep(POLL_SECONDS)
        for channel in (self._send, *self._receive.values()):
            channel.start()
