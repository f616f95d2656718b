"""The top of the ULX3S simulated at its pins, as a serial port of the host."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from hdl.build import Build
from hdl.serial.ulx3s import CLOCKS_PER_BIT
from sim.backends.interface import Progress, silent
from sim.simulators import verilator
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.compiled import Model

HARNESS = Path(__file__).with_name("serial.cpp")
PATIENCE_BYTES = 100
"""A read ends after a pause as long as this many bytes."""


class SerialPort:
    """The board behind a serial port, with the methods of ``serial.Serial`` that `serial_bus.SerialBus` uses.

    Parameters
    ----------
    build : Build
        With the shell ``serial``.
    progress : callable
        Receives lines of text about a first build.
    """

    def __init__(self, build: Build, *, progress: Progress = silent) -> None:
        library = verilator.build_library(design_accelerator(build), progress=progress, harness=HARNESS)
        self.model = Model(library, "serial", _FUNCTIONS, CLOCKS_PER_BIT)
        self._patience = PATIENCE_BYTES * 10 * CLOCKS_PER_BIT

    def write(self, data: bytes) -> None:
        """Queue bytes; they pass the pin during reads, when the simulation runs."""
        self.model.call("send", data, len(data))

    def read(self, count: int) -> bytes:
        """Read up to ``count`` bytes, fewer if no more come."""
        there = min(count, self.model.call("run", count, self._patience))
        taken = np.zeros(there, np.uint8)
        self.model.call("take", taken.ctypes.data, there)
        return taken.tobytes()

    @property
    def in_waiting(self) -> int:
        """Number of bytes received and not yet read."""
        return int(self.model.call("run", 0, 0))

    @property
    def broken(self) -> int:
        """Number of bytes received without a stop bit."""
        return int(self.model.call("broken"))


_WIDE = ctypes.c_uint64
_FUNCTIONS = {
    "open": (ctypes.c_void_p, ctypes.c_uint32),
    "close": (None,),
    "send": (None, ctypes.c_char_p, _WIDE),
    "run": (_WIDE, _WIDE, _WIDE),
    "take": (None, ctypes.c_void_p, _WIDE),
    "cycle": (_WIDE,),
    "broken": (_WIDE,),
}
"""The functions of serial.cpp."""
