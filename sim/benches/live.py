"""The live build in a simulation: a camera with its own clock, a memory that waits and fails, a bus for the host."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdl.build import Build
from hdl.settings import PAGE_BYTES
from hdl.shell.live import LiveTop
from sim.backends.interface import Progress, silent
from sim.simulators import verilator
from sim.simulators.accelerator_designs import CONTROL, strip_settings
from sim.simulators.compiled import load_library
from sim.simulators.design import Design, Ports
from sim.simulators.recording import check_access

BASE = 0x8_4000_0000
"""Address of the memory: beyond what 32 bits reach."""
WAIT_CLOCKS = 20_000
POLL_CLOCKS = 500
MAX_SCORING_CLOCKS = 5_000_000
HARNESS = verilator.HARNESS / "live.cpp"


@dataclass(frozen=True)
class CameraTiming:
    """How a camera delivers its frames.

    Parameters
    ----------
    line_blank, frame_blank : int
        Pauses after each line and after each frame, in clocks of the camera.
    jitter : int
        Upper bound, exclusive, of the random clocks by which each line's pause is longer.
    steps, period : int
        Camera edges per ``period`` clocks of the design.
    """

    line_blank: int = 280
    frame_blank: int = 20_000
    jitter: int = 0
    steps: int = 1
    period: int = 2


@dataclass(frozen=True)
class MemoryRules:
    """How the memory behaves, at random.

    Parameters
    ----------
    waits : int
        0..255: probability per clock, in 1/256, that address or data are not accepted.
    latency_clocks : int
        Upper bound, exclusive, of a response's delay.
    failures : int
        0..255: probability, in 1/256, that a burst is answered by SLVERR.
    seed : int
    """

    waits: int = 0
    latency_clocks: int = 0
    failures: int = 0
    seed: int = 0


def design_live_accelerator(build: Build) -> Design:
    """The accelerator in a camera's shell."""
    build = strip_settings(build)
    return Design(
        "the live accelerator",
        Ports(outputs=(), control=CONTROL, writers=tuple(f"m_axi_{ring}" for ring in build.outputs)),
        lambda: LiveTop(build),
        str(build),
    )


class LiveBench:
    """A running simulation, and the bus of `constraints/live/skymosaic_live.py`.

    Parameters
    ----------
    build : Build
        With the shell ``camera`` and gray frames.
    length_bytes : int
        Size of the memory.
    camera : CameraTiming
    rules : MemoryRules
    progress : callable
        Receives lines of text about a first build.
    """

    def __init__(
        self,
        build: Build,
        *,
        length_bytes: int,
        camera: CameraTiming | None = None,
        rules: MemoryRules | None = None,
        progress: Progress = silent,
    ) -> None:
        camera, rules = camera or CameraTiming(), rules or MemoryRules()
        self.memory = np.zeros(length_bytes, np.uint8)
        design = design_live_accelerator(build)
        self._library = load_library(verilator.build_library(design, progress=progress, harness=HARNESS), _FUNCTIONS)
        self._bench = self._library.live_open()
        self._used = 0
        self._frames: list[NDArray[np.uint8]] = []
        self._library.live_memory(self._bench, self.memory.ctypes.data, BASE, length_bytes)
        self._library.live_rules(self._bench, rules.waits, rules.latency_clocks, rules.failures, rules.seed)
        self._library.live_camera(
            self._bench,
            *(camera.line_blank, camera.frame_blank, camera.jitter, camera.steps, camera.period),
        )

    def close(self) -> None:
        """End the simulation."""
        self._library.live_close(self._bench)

    def show(self, frames: Sequence[NDArray[np.uint8]]) -> None:
        """Queue gray frames of any size for the camera."""
        for frame in frames:
            self._frames.append(np.ascontiguousarray(frame, np.uint8))
            self._library.live_frame(self._bench, self._frames[-1].ctypes.data, frame.shape[1], frame.shape[0])

    def run(self, clocks: int) -> None:
        """Run for a number of clocks."""
        self._library.live_run(self._bench, clocks)

    def reset(self) -> None:
        """Assert ``aresetn`` for a moment; an offer that is withdrawn by it is a violation."""
        self._library.live_reset(self._bench)

    @property
    def open_bursts(self) -> int:
        """Number of addresses, words and responses of bursts that have begun and not ended."""
        return int(self._library.live_open_bursts(self._bench))

    @property
    def cycle(self) -> int:
        """Clocks since reset."""
        return int(self._library.live_cycle(self._bench))

    @property
    def violations(self) -> int:
        """How often the design broke AXI's rules: withdrew or changed an offer, or sent an invalid burst."""
        return int(self._library.live_violations(self._bench))

    @property
    def errors(self) -> int:
        """Number of bursts answered by SLVERR."""
        return int(self._library.live_errors(self._bench))

    @property
    def last_pixels(self) -> list[int]:
        """Clock in which the camera sent each frame's last pixel."""
        cycles = ctypes.POINTER(ctypes.c_uint64)()
        count = self._library.live_last_pixels(self._bench, ctypes.byref(cycles))
        return [int(cycles[n]) for n in range(count)]

    def read(self, offset: int) -> int:
        """Read a register."""
        value = ctypes.c_uint32()
        check_access("read", offset, self._library.live_read(self._bench, offset, ctypes.byref(value)))
        return value.value

    def write(self, offset: int, value: int) -> None:
        """Write a register."""
        check_access("write", offset, self._library.live_write(self._bench, offset, value))

    def allocate(self, length_bytes: int) -> NDArray[np.uint8]:
        """Take the next free pages of the memory."""
        start, self._used = self._used, self._used + -(-length_bytes // PAGE_BYTES) * PAGE_BYTES
        return self.memory[start : start + length_bytes]

    def address(self, buffer: NDArray[np.uint8]) -> int:
        """The bus address of memory from `allocate`."""
        return int(BASE + buffer.ctypes.data - self.memory.ctypes.data)

    def invalidate(self, buffer: NDArray[np.uint8]) -> None:
        """Do nothing: the simulated memory has no cache."""

    def exchange(self, sent: NDArray[np.uint8], length_bytes: int, received: NDArray[np.uint8]) -> int:
        """Send ``length_bytes`` of hypotheses as a packet, and receive their scores; returns the length of the scores.

        Raises
        ------
        TimeoutError
            If the scores do not come.
        """
        self.send_hypotheses(np.array(sent[:length_bytes]).view(np.uint64))
        for _ in range(MAX_SCORING_CLOCKS // POLL_CLOCKS):
            self.run(POLL_CLOCKS)
            scores = self.take_scores()
            if scores is not None:
                received[: scores.size] = scores
                return int(scores.size)
        raise TimeoutError(f"no scores in {MAX_SCORING_CLOCKS} clocks")

    def send_hypotheses(self, words: NDArray[np.uint64], *, ends: bool = True) -> None:
        """Send words of hypotheses, the last of which may end their packet."""
        self._library.live_hypotheses(self._bench, words.ctypes.data, words.size, ends)

    def take_scores(self) -> NDArray[np.uint8] | None:
        """The oldest packet of scores that has come whole."""
        words = ctypes.POINTER(ctypes.c_uint64)()
        count = self._library.live_scores(self._bench, ctypes.byref(words))
        return np.ctypeslib.as_array(words, (count,)).view(np.uint8).copy() if count else None

    def wait(self, seconds: float) -> None:
        """Run for a while, whatever ``seconds`` says: simulated time is not that of the host."""
        self.run(WAIT_CLOCKS)


_BENCH, _WORD, _WIDE = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
_WORDS = ctypes.POINTER(ctypes.POINTER(_WIDE))
_FUNCTIONS = {
    "live_open": (_BENCH,),
    "live_close": (None, _BENCH),
    "live_memory": (None, _BENCH, ctypes.c_void_p, _WIDE, _WIDE),
    "live_rules": (None, _BENCH, _WORD, _WORD, _WORD, _WIDE),
    "live_camera": (None, _BENCH, *[_WORD] * 5),
    "live_frame": (None, _BENCH, ctypes.c_void_p, _WORD, _WORD),
    "live_run": (None, _BENCH, _WIDE),
    "live_write": (ctypes.c_int, _BENCH, _WORD, _WORD),
    "live_read": (ctypes.c_int, _BENCH, _WORD, ctypes.POINTER(_WORD)),
    "live_reset": (None, _BENCH),
    "live_hypotheses": (None, _BENCH, ctypes.c_void_p, _WIDE, ctypes.c_int),
    "live_scores": (_WIDE, _BENCH, _WORDS),
    "live_last_pixels": (_WIDE, _BENCH, _WORDS),
    "live_cycle": (_WIDE, _BENCH),
    "live_open_bursts": (_WIDE, _BENCH),
    "live_violations": (_WIDE, _BENCH),
    "live_errors": (_WIDE, _BENCH),
}
"""The functions of live.cpp."""
