"""An overlay under PYNQ 3.1: its registers, memory for its DMAs, and transfers with a time limit."""

import time

import numpy as np
from pynq import allocate
from skymosaic_registers import AcceleratorError

POLL_SECONDS = 0.0002


class OverlayBus:
    """Registers and memory of a loaded overlay.

    Parameters
    ----------
    registers : object
        What PYNQ has for them: an IP core's driver, or ``MMIO``.
    """

    def __init__(self, registers):
        self.read, self.write = registers.read, registers.write

    def allocate(self, length_bytes):
        """Allocate memory that the accelerator and its DMAs can access; it starts at a page."""
        return allocate(shape=(length_bytes,), dtype=np.uint8)


def wait_until_idle(channels, timeout_seconds):
    """Wait until the transfers of all DMA channels, a dictionary by name, have ended."""
    # Polled, because PYNQ's `wait` has no time limit.
    end = time.monotonic() + timeout_seconds
    while not all(channel.idle for channel in channels.values()):
        for name, channel in channels.items():
            if channel.error:
                raise AcceleratorError(f"the DMA of the {name} reports an error; reload the overlay")
        if time.monotonic() > end:
            busy = ", ".join(name for name, channel in channels.items() if not channel.idle)
            raise AcceleratorError(f"no answer within {timeout_seconds:g} s; still busy: {busy}")
        time.sleep(POLL_SECONDS)
