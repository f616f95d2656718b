"""The top of the ULX3S simulated at its pins, as a serial port of the host."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from golden_model.config import Config
from hdl.export.accelerator import Build
from hdl.export.ulx3s import DEFAULT_BUILD, ulx3s_top
from sim.backends.interface import Progress, silent
from sim.simulators import verilator
from sim.simulators.accelerator_designs import as_built, source_key
from sim.simulators.design import Design, Ports

HARNESS = "serial.cpp"
PATIENCE_BYTES = 100
"""A read ends after a pause of so many bytes."""


class SerialPort:
    """The board behind a serial port, with the methods of ``serial.Serial`` that `serial_bus.SerialBus` uses.

    Parameters
    ----------
    config : Config
    build : Build
        What is left out is as in `hdl.export.ulx3s.DEFAULT_BUILD`.
    progress : callable
        Receives lines of text about a first build.
    """

    def __init__(self, config: Config, build: Build | None = None, *, progress: Progress = silent) -> None:
        whole, config = DEFAULT_BUILD | (build or {}), as_built(config)
        top = ulx3s_top(config, **whole)
        design = Design(
            "the top of the ULX3S",
            Ports(outputs=(), video="ftdi"),
            lambda: top,
            f"ulx3s {config} {whole} {source_key()}",
        )
        self._library = _load(str(verilator.shared_library(design, progress=progress, harness=HARNESS)))
        self._patience = PATIENCE_BYTES * 10 * top.clocks_per_bit
        self._board = self._library.serial_open(top.clocks_per_bit)

    def close(self) -> None:
        """End the simulation."""
        self._library.serial_close(self._board)

    def write(self, data: bytes) -> None:
        """Send bytes; they pass the pin while bytes are read."""
        self._library.serial_send(self._board, data, len(data))

    def read(self, count: int) -> bytes:
        """Up to ``count`` bytes, fewer where no more come."""
        there = min(count, self._library.serial_run(self._board, count, self._patience))
        taken = np.zeros(there, np.uint8)
        self._library.serial_take(self._board, taken.ctypes.data, there)
        return taken.tobytes()

    @property
    def in_waiting(self) -> int:
        """Bytes that have come and have not been read."""
        return int(self._library.serial_run(self._board, 0, 0))

    @property
    def cycle(self) -> int:
        """Clocks since the start."""
        return int(self._library.serial_cycle(self._board))

    @property
    def broken(self) -> int:
        """Bytes without a stop bit."""
        return int(self._library.serial_broken(self._board))


def _load(path: str) -> ctypes.CDLL:
    library = ctypes.CDLL(path)
    pointer, wide = ctypes.c_void_p, ctypes.c_uint64
    signatures: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "serial_open": (pointer, (ctypes.c_uint32,)),
        "serial_close": (None, (pointer,)),
        "serial_send": (None, (pointer, ctypes.c_char_p, wide)),
        "serial_run": (wide, (pointer, wide, wide)),
        "serial_take": (None, (pointer, pointer, wide)),
        "serial_cycle": (wide, (pointer,)),
        "serial_broken": (wide, (pointer,)),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
