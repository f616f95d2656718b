"""Access to the accelerator's registers and DMAs under PYNQ 3.1."""

import time

import numpy as np
from pynq import DefaultIP, Overlay, allocate

from skymosaic_driver import CHANNELS, AcceleratorError

POLL_SECONDS = 0.0002


class Skymosaic(DefaultIP):
    """The IP core in an overlay; PYNQ finds this class by the core's VLNV."""

    bindto = ["skymosaic:vision:skymosaic:1.0"]


class PynqBus:
    """Loads an overlay and gives access to its registers and DMAs.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file must be in the same folder.
    """

    def __init__(self, bitstream):
        overlay = Overlay(bitstream)
        self._registers = overlay.skymosaic
        self._send = overlay.dma_video.sendchannel
        self._receive = {channel: getattr(overlay, "dma_" + channel).recvchannel for channel in CHANNELS}

    def read(self, offset):
        """Read a register."""
        return self._registers.read(offset)

    def write(self, offset, value):
        """Write a register."""
        self._registers.write(offset, value)

    def allocate(self, length_bytes):
        """Allocate memory that the DMAs can access."""
        return allocate(shape=(length_bytes,), dtype=np.uint8)

    def start_send(self, buffer, length_bytes):
        """Start to send a frame from ``buffer``."""
        self._send.transfer(buffer, 0, length_bytes)

    def start_receive(self, channel, buffer):
        """Start to receive the next packet of ``channel`` into ``buffer``."""
        self._receive[channel].transfer(buffer)

    def wait(self, timeout_seconds):
        """Wait until the frame is sent and both packets are received; return their lengths in bytes."""
        channels = {"video": self._send, **self._receive}
        end = time.monotonic() + timeout_seconds
        while not all(channel.idle for channel in channels.values()):
            for name, channel in channels.items():
                if channel.error:
                    raise AcceleratorError(f"the DMA of the {name} reports an error; reload the overlay")
            if time.monotonic() > end:
                busy = ", ".join(name for name, channel in channels.items() if not channel.idle)
                raise AcceleratorError(f"no answer within {timeout_seconds:g} s; still busy: {busy}")
            time.sleep(POLL_SECONDS)
        return {name: channel.transferred for name, channel in self._receive.items()}

    def stop(self):
        """Abort transfers in progress, so that the next ones start cleanly."""
        for channel in (self._send, *self._receive.values()):
            channel.stop()
            channel.start()
