"""Runs designs that are compiled to shared libraries.

``harness/harness.cpp`` streams whole frames through a design in one loop; `Bench` calls that loop through ctypes.
"""

import ctypes
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.simulators.design import Ports
from sim.simulators.recording import NO_PAUSES, Output, Pauses, Recording, Segment, check_access

ADDRESS, WORD, WIDE = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
WORDS = ctypes.POINTER(ctypes.POINTER(WIDE))
"""Types of arguments of C functions; for `WORDS` see `Model.words`."""
COMMON_FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "close": (None,),
    "reset": (None,),
    "cycle": (WIDE,),
    "write": (ctypes.c_int, WORD, WORD),
    "read": (ctypes.c_int, WORD, ctypes.POINTER(WORD)),
}
"""What harnesses with registers have in common, for `Model`."""


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
            *(prefix_macros("WRITER", ports.writers) + prefix_macros("READER", ports.readers) if ports.writers else []),
            *([f"#define CONTROL(member) {ports.control}_##member"] if ports.control else []),
            f"#define SETTINGS(X) {' '.join(f'X({i}, {name})' for i, name in enumerate(ports.settings))}\n",
        ]
    )


class Model:
    """A running model of a compiled design; it starts just after a reset.

    The names of the harness's functions begin with ``prefix``. ``functions`` has the type of each one's result, then
    those of its arguments, before which comes the model itself; those of ``open`` are given as ``opening``.
    """

    def __init__(self, library: Path, prefix: str, functions: Mapping[str, tuple[Any, ...]], *opening: Any) -> None:
        loaded = ctypes.CDLL(str(library))
        self._functions: dict[str, Any] = {}
        for name, (result, *arguments) in functions.items():
            self._functions[name] = function = getattr(loaded, f"{prefix}_{name}")
            function.restype, function.argtypes = result, arguments if name == "open" else [ADDRESS, *arguments]
        self._model = self._functions["open"](*opening)

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a function of the harness."""
        return self._functions[name](self._model, *arguments)

    def words(self, function: str, *arguments: Any, each: int = 1) -> NDArray[np.uint64]:
        """Copy what a function of the harness sets its last argument to; it returns how many of ``each`` words."""
        values = ctypes.POINTER(WIDE)()
        size = each * self.call(function, *arguments, ctypes.byref(values))
        return np.ctypeslib.as_array(values, (size,)).copy() if size else np.empty(0, np.uint64)

    def close(self) -> None:
        """End the simulation, and close the wave file; raises OSError if that could not be written."""
        if error := self.call("close"):
            raise OSError(error, os.strerror(error))

    def reset(self) -> None:
        """Reset the design, whatever its state."""
        self.call("reset")

    @property
    def cycle(self) -> int:
        """Clocks since the last reset."""
        return int(self.call("cycle"))

    def write(self, address: int, value: int) -> None:
        """Write a register.

        Raises
        ------
        BackendError
            If the design refuses the access or does not answer.
        """
        check_access("write", address, self.call("write", address, value))

    def read(self, address: int) -> int:
        """Read a register; raises the same errors as `write`."""
        value = WORD()
        check_access("read", address, self.call("read", address, ctypes.byref(value)))
        return value.value


class _Request(ctypes.Structure):
    """``struct Request`` of harness.cpp."""

    _fields_ = (
        ("data", ADDRESS),
        ("flags", ADDRESS),
        ("beats", WIDE),
        ("packets", WIDE),
        ("cycle_limit", WIDE),
        ("gaps", WORD),
        ("stalls", WORD),
        ("seed", WORD),
        ("rooms", ADDRESS),
    )


class Bench(Model):
    """A model in the harness that streams frames; for ``waves``, the library must have been compiled with them."""

    def __init__(self, library: Path, ports: Ports, waves: Path | None = None):
        self.ports = ports
        super().__init__(library, "bench", _FUNCTIONS, os.fsencode(waves or ""))

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

    def stream(
        self, segment: Segment, pauses: Pauses, rooms: NDArray[np.uint64] | None = None
    ) -> tuple[bool, Recording]:
        """As `run`, but at the cycle limit it returns what has come so far, and whether that was all.

        With ``rooms``, each output takes at most so many words, and the first end of a packet ends the run; the
        harness's ``sent`` has the beats that went in.
        """
        self.ports.check(segment.settings)
        if segment.reset:
            self.reset()
        for index, name in enumerate(self.ports.settings):
            if name in segment.settings:
                self.call("set", index, segment.settings[name])
        for address, value in segment.writes:
            self.write(address, value)
        data, flags = np.ascontiguousarray(segment.data, np.uint64), np.ascontiguousarray(segment.flags, np.uint8)
        request = _Request(
            data.ctypes.data, flags.ctypes.data, data.size, segment.packets, segment.cycle_limit,
            pauses.gaps, pauses.stalls, pauses.seed, None if rooms is None else rooms.ctypes.data,
        )  # fmt: skip
        is_done = bool(self.call("run", ctypes.byref(request)))
        return is_done, self._copy_recording()

    def _copy_recording(self) -> Recording:
        names = (*self.ports.outputs, *self.ports.taps)
        words = {name: self.words("words", index) for index, name in enumerate(names)}
        return Recording(
            self.words("starts"),
            {
                name: Output(words[name], self.words("ends", index, each=2).reshape(-1, 2))
                for index, name in enumerate(self.ports.outputs)
            },
            {name: words[name] for name in self.ports.taps},
        )


_FUNCTIONS = {
    **COMMON_FUNCTIONS,
    "open": (ADDRESS, ctypes.c_char_p),
    "close": (ctypes.c_int,),
    "set": (None, ctypes.c_int, WIDE),
    "run": (ctypes.c_bool, ctypes.POINTER(_Request)),
    "sent": (WIDE,),
    "starts": (WIDE, WORDS),
    "words": (WIDE, ctypes.c_int, WORDS),
    "ends": (WIDE, ctypes.c_int, WORDS),
}
"""The functions of harness.cpp."""
