"""The registers and DMAs of the accelerator under PYNQ 3.1."""

import time

import numpy as np
from pynq import DefaultIP, Overlay, allocate

from skymosaic_driver import CHANNELS, AcceleratorError

POLL_SECONDS = 0.0002


class Skymosaic(DefaultIP):
    """The IP core in an overlay: PYNQ binds this class to it by its VLNV."""

    bindto = ["skymosaic:vision:skymosaic:1.0"]


class PynqBus:
    """Registers and DMAs of an overlay, which is loaded.

    Parameters
    ----------
    bitstream : str
        Path of the .bit file; the .hwh file lies beside it.
    """

    def __init__(self, bitstream):
        overlay = Overlay(bitstream)
        self._registers = overlay.skymosaic
        self._send = overlay.dma_video.sendchannel
        self._receive = {channel: getattr(overlay, "dma_" + channel).recvchannel for channel in CHANNELS}

    def read(self, offset):
        """A register."""
        return self._registers.read(offset)

    def write(self, offset, value):
        """Set a register."""
        self._registers.write(offset, value)

    def allocate(self, length_bytes):
        """Memory that the DMAs reach."""
        return allocate(shape=(length_bytes,), dtype=np.uint8)

    def start_send(self, buffer, length_bytes):
        """Stream a frame from ``buffer``."""
        self._send.transfer(buffer, 0, length_bytes)

    def start_receive(self, channel, buffer):
        """Let the next packet of ``channel`` into ``buffer``."""
        self._receive[channel].transfer(buffer)

    def wait(self, timeout_seconds):
        """Until the frame went in and both packets came out; the packets' lengths in bytes."""
        channels = {"video": self._send, **self._receive}
        end = time.monotonic() + timeout_seconds
        while not all(channel.idle for channel in channels.values()):
            for name, channel in channels.items():
                if channel.error:
                    raise AcceleratorError(f"the DMA of the {name} reports an error; load the overlay again")
            if time.monotonic() > end:
                busy = ", ".join(name for name, channel in channels.items() if not channel.idle)
                raise AcceleratorError(f"no answer within {timeout_seconds:g} s; still busy: {busy}")
            time.sleep(POLL_SECONDS)
        return {name: channel.transferred for name, channel in self._receive.items()}

    def stop(self):
        """Forget transfers under way, so that the next ones start afresh."""
        for channel in (self._send, *self._receive.values()):
            channel.stop()
            channel.start()
