"""The top of the ULX3S simulated at its pins, as a serial port of the host."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from hdl.build import Build
from hdl.serial.ulx3s import CLOCKS_PER_BIT, Ulx3s
from sim.backends.interface import Progress, silent
from sim.simulators import verilator
from sim.simulators.accelerator_designs import strip_settings
from sim.simulators.compiled import load_library
from sim.simulators.design import Design, Ports

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
        build = strip_settings(build)
        ports = Ports(outputs=(), video="ftdi")
        design = Design("the top of the ULX3S", ports, lambda: Ulx3s(build), str(build))
        library = verilator.build_library(design, progress=progress, harness=HARNESS)
        self._library = load_library(library, _FUNCTIONS)
        self._patience = PATIENCE_BYTES * 10 * CLOCKS_PER_BIT
        self._board = self._library.serial_open(CLOCKS_PER_BIT)

    def close(self) -> None:
        """End the simulation."""
        self._library.serial_close(self._board)

    def write(self, data: bytes) -> None:
        """Queue bytes; they pass the pin during reads, when the simulation runs."""
        self._library.serial_send(self._board, data, len(data))

    def read(self, count: int) -> bytes:
        """Read up to ``count`` bytes, fewer if no more come."""
        there = min(count, self._library.serial_run(self._board, count, self._patience))
        taken = np.zeros(there, np.uint8)
        self._library.serial_take(self._board, taken.ctypes.data, there)
        return taken.tobytes()

    @property
    def in_waiting(self) -> int:
        """Number of bytes received and not yet read."""
        return int(self._library.serial_run(self._board, 0, 0))

    @property
    def cycle(self) -> int:
        """Clocks since the start."""
        return int(self._library.serial_cycle(self._board))

    @property
    def broken(self) -> int:
        """Number of bytes received without a stop bit."""
        return int(self._library.serial_broken(self._board))


_BOARD, _WIDE = ctypes.c_void_p, ctypes.c_uint64
_FUNCTIONS = {
    "serial_open": (_BOARD, ctypes.c_uint32),
    "serial_close": (None, _BOARD),
    "serial_send": (None, _BOARD, ctypes.c_char_p, _WIDE),
    "serial_run": (_WIDE, _BOARD, _WIDE, _WIDE),
    "serial_take": (None, _BOARD, ctypes.c_void_p, _WIDE),
    "serial_cycle": (_WIDE, _BOARD),
    "serial_broken": (_WIDE, _BOARD),
}
"""The functions of serial.cpp."""
