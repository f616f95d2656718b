"""A stand-in for the package ``pynq``, in front of the simulated accelerator.

A test puts a module ``pynq`` on the path that imports everything from here: notebook and driver then run unchanged.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.config import PRESETS
from sim.backends.interface import BackendError
from sim.simulators import verilator
from sim.simulators.accelerator_designs import BUILT_SIZES_PX, FEATURES, MATCHES, design_accelerator
from sim.simulators.compiled import Bench
from sim.simulators.recording import END_OF_LINE, Segment

CYCLES_PER_WORD = 200
"""Limit for a frame; one that takes longer is taken to hang."""
DRAIN_CYCLES = 2000


class DefaultIP:
    """Base class of the drivers that PYNQ finds by the core's name."""


def allocate(*, shape: tuple[int, ...], dtype: type[np.generic]) -> NDArray[Any]:
    """Memory that the DMAs can access."""
    return np.zeros(shape, dtype)


class Channel:
    """One direction of an AXI DMA in simple mode; a transfer is done when the frame has passed the accelerator."""

    def __init__(self, overlay: Overlay) -> None:
        self._overlay = overlay
        self.buffer: NDArray[np.uint8] | None = None
        self.transferred = 0
        self.error = False

    def start(self) -> None:
        """Drop the transfer under way."""
        self.buffer = None

    def transfer(self, buffer: NDArray[np.uint8], start: int = 0, nbytes: int = 0) -> None:
        """Start a transfer."""
        assert self.buffer is None, "a transfer is under way"
        self.buffer = buffer[start : start + nbytes] if nbytes else buffer

    @property
    def idle(self) -> bool:
        """Whether no transfer is under way; reading it runs the simulation while one is."""
        if self.buffer is not None:
            self._overlay.advance()
        return self.buffer is None


class Dma:
    """An AXI DMA with the channels of the block design; a reset ends at once."""

    def __init__(self, overlay: Overlay) -> None:
        self.sendchannel = Channel(overlay)
        self.recvchannel = Channel(overlay)

    def read(self, offset: int) -> int:
        """Read a register, which always says that no reset is under way."""
        return 0

    def write(self, offset: int, value: int) -> None:
        """Write a register: a reset, which drops both transfers."""
        self.sendchannel.start()
        self.recvchannel.start()


class Overlay:
    """The block design of `skymosaic export --board`, for the preset ``aerial`` as it is built by default."""

    def __init__(self, bitfile_name: str) -> None:
        design = design_accelerator(PRESETS["aerial"], BUILT_SIZES_PX[0])
        self.skymosaic = Bench(verilator.build_library(design), design.ports)
        self.dma_video, self.dma_features, self.dma_matches = Dma(self), Dma(self), Dma(self)

    def advance(self) -> None:
        """Send the waiting frame and store its packets; without one, drain the accelerator."""
        sender = self.dma_video.sendchannel
        receivers = {FEATURES: self.dma_features.recvchannel, MATCHES: self.dma_matches.recvchannel}
        if sender.buffer is None:
            # Only drains the rest of a packet: an error does not matter here.
            with contextlib.suppress(BackendError):
                self.skymosaic.run(Segment(np.zeros(0, np.uint64), np.zeros(0, np.uint8), 1, DRAIN_CYCLES))
            for channel in receivers.values():
                channel.start()
            return
        data = np.array(sender.buffer).view(np.uint32).astype(np.uint64)
        flags = np.zeros(data.size, np.uint8)
        flags[-1] = END_OF_LINE
        recording = self.skymosaic.run(Segment(data, flags, 1, CYCLES_PER_WORD * data.size))
        for name, channel in receivers.items():
            packet = recording.outputs[name].packets[0].view(np.uint8)
            assert channel.buffer is not None, f"nobody receives {name}"
            channel.buffer[: packet.size] = packet
            channel.transferred = packet.size
            channel.start()
        sender.start()
