"""Runs designs that are compiled to shared libraries.

``harness/harness.cpp`` streams whole frames through a design in one loop; `Bench` calls that loop through ctypes.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.simulators.design import Ports
from sim.simulators.recording import NO_PAUSES, Output, Pauses, Recording, Segment, check_access


def format_ports(ports: Ports) -> str:
    """Return the text of ``ports.hpp``, which names a design's ports for the harness."""

    def prefix_macros(kind: str, prefixes: Sequence[str]) -> list[str]:
        macros = [f"#define {kind}_{i}(member) {prefix}_##member" for i, prefix in enumerate(prefixes)]
        return [*macros, f"#define {kind}S(X) " + " ".join(f"X({i}, {kind}_{i})" for i in range(len(prefixes)))]

    return "\n".join(
        [
            f"#define VIDEO(member) {ports.video}_##member",
            *prefix_macros("OUTPUT", ports.outputs),
            *prefix_macros("TAP", ports.taps),
            *(prefix_macros("WRITER", ports.writers) if ports.writers else []),
            *([f"#define CONTROL(member) {ports.control}_##member"] if ports.control else []),
            f"#define SETTINGS(X) {' '.join(f'X({i}, {name})' for i, name in enumerate(ports.settings))}\n",
        ]
    )


def load_library(library: Path, functions: Mapping[str, tuple[Any, ...]]) -> ctypes.CDLL:
    """Load a shared library; ``functions`` has the type of each one's result, then those of its arguments."""
    loaded = ctypes.CDLL(str(library))
    for name, (result, *arguments) in functions.items():
        function = getattr(loaded, name)
        function.restype, function.argtypes = result, arguments
    return loaded


class _Request(ctypes.Structure):
    """``struct Request`` of harness.cpp."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("flags", ctypes.c_void_p),
        ("beats", ctypes.c_uint64),
        ("packets", ctypes.c_uint64),
        ("cycle_limit", ctypes.c_uint64),
        ("gaps", ctypes.c_uint32),
        ("stalls", ctypes.c_uint32),
        ("seed", ctypes.c_uint32),
        ("rooms", ctypes.c_void_p),
    )


class Bench:
    """A running model of a compiled design; it starts just after a reset.

    Parameters
    ----------
    library : Path
        The shared library.
    ports : Ports
        The ports that it was compiled for.
    waves : Path or None
        VCD file to write; the library must have been compiled for waves.
    """

    def __init__(self, library: Path, ports: Ports, waves: Path | None = None):
        self.ports = ports
        self._library = load_library(library, _FUNCTIONS)
        self._bench = self._library.bench_open(os.fsencode(waves or ""))

    def close(self) -> None:
        """End the simulation and close the wave file."""
        self._library.bench_close(self._bench)

    def reset(self) -> None:
        """Reset the design, whatever its state."""
        self._library.bench_reset(self._bench)

    def write(self, address: int, value: int) -> None:
        """Write a register.

        Raises
        ------
        BackendError
            If the design refuses the access or does not answer.
        """
        check_access("write", address, self._library.bench_write(self._bench, address, value))

    def read(self, address: int) -> int:
        """Read a register; raises the same errors as `write`."""
        value = ctypes.c_uint32()
        check_access("read", address, self._library.bench_read(self._bench, address, ctypes.byref(value)))
        return value.value

    def run(self, segment: Segment, pauses: Pauses = NO_PAUSES) -> Recording:
        """Stream a segment through the design.

        Raises
        ------
        ValueError
            For a setting that does not exist or whose value has too many bits.
        BackendError
            If the design does not finish within the segment's cycle limit.
        """
        is_done, recording = self.stream(segment, pauses)
        if not is_done:
            raise segment.timeout_error(self.cycle)
        return recording

    @property
    def cycle(self) -> int:
        """Clocks since the last reset."""
        return int(self._library.bench_cycle(self._bench))

    def run_to_packet(self, segment: Segment, rooms: Sequence[int]) -> tuple[int, Recording]:
        """Stream a segment up to the first end of a packet or the cycle limit; each output takes at most its room.

        Returns
        -------
        int
            Beats that went in.
        Recording
            What came out.
        """
        _, recording = self.stream(segment, NO_PAUSES, np.array(rooms, np.uint64))
        return int(self._library.bench_sent(self._bench)), recording

    def stream(
        self, segment: Segment, pauses: Pauses, rooms: NDArray[np.uint64] | None = None
    ) -> tuple[bool, Recording]:
        """As `run`, but at the cycle limit it returns what has come so far, and whether that was all."""
        self.ports.check(segment.settings)
        if segment.reset:
            self.reset()
        for index, name in enumerate(self.ports.settings):
            if name in segment.settings:
                self._library.bench_set(self._bench, index, segment.settings[name])
        for address, value in segment.writes:
            self.write(address, value)
        data, flags = np.ascontiguousarray(segment.data, np.uint64), np.ascontiguousarray(segment.flags, np.uint8)
        request = _Request(
            data.ctypes.data, flags.ctypes.data, data.size, segment.packets, segment.cycle_limit,
            pauses.gaps, pauses.stalls, pauses.seed, None if rooms is None else rooms.ctypes.data,
        )  # fmt: skip
        is_done = bool(self._library.bench_run(self._bench, ctypes.byref(request)))
        return is_done, self._copy_recording()

    def _copy_recording(self) -> Recording:
        names = (*self.ports.outputs, *self.ports.taps)
        words = {name: self._copy("bench_words", index) for index, name in enumerate(names)}
        return Recording(
            self._copy("bench_starts"),
            {
                name: Output(words[name], self._copy("bench_ends", index).reshape(-1, 2))
                for index, name in enumerate(self.ports.outputs)
            },
            {name: words[name] for name in self.ports.taps},
        )

    def _copy(self, function: str, *stream: int) -> NDArray[np.uint64]:
        values = ctypes.POINTER(ctypes.c_uint64)()
        count = getattr(self._library, function)(self._bench, *stream, ctypes.byref(values))
        size = count * (2 if function == "bench_ends" else 1)
        return np.ctypeslib.as_array(values, (size,)).copy() if size else np.empty(0, np.uint64)


_POINTER, _VALUES = ctypes.c_void_p, ctypes.POINTER(ctypes.POINTER(ctypes.c_uint64))
_FUNCTIONS = {
    "bench_open": (_POINTER, ctypes.c_char_p),
    "bench_close": (None, _POINTER),
    "bench_reset": (None, _POINTER),
    "bench_set": (None, _POINTER, ctypes.c_int, ctypes.c_uint64),
    "bench_write": (ctypes.c_int, _POINTER, ctypes.c_uint32, ctypes.c_uint32),
    "bench_read": (ctypes.c_int, _POINTER, ctypes.c_uint32, ctypes.POINTER(ctypes.c_uint32)),
    "bench_run": (ctypes.c_bool, _POINTER, ctypes.POINTER(_Request)),
    "bench_sent": (ctypes.c_uint64, _POINTER),
    "bench_cycle": (ctypes.c_uint64, _POINTER),
    "bench_starts": (ctypes.c_uint64, _POINTER, _VALUES),
    "bench_words": (ctypes.c_uint64, _POINTER, ctypes.c_int, _VALUES),
    "bench_ends": (ctypes.c_uint64, _POINTER, ctypes.c_int, _VALUES),
}
"""The functions of harness.cpp."""
