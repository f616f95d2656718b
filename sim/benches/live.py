"""The live build in a simulation: a camera with its own clock, a memory that waits and fails, a bus for the host."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from golden_model.config import Config
from hdl.settings import PAGE_BYTES
from hdl.shell.live import LiveAccelerator, LiveTop
from sim.backends.interface import Progress, silent
from sim.simulators import verilator
from sim.simulators.accelerator_designs import CONTROL, LANES, as_built, source_key
from sim.simulators.design import Design, Ports
from sim.simulators.recording import check_access

BASE = 0x8_4000_0000
"""Address of the memory: beyond what 32 bits reach."""
CLOCKS_OF_A_WAIT = 20_000
CLOCKS_OF_A_LOOK = 500
LONGEST_SCORING_CLOCKS = 5_000_000
HARNESS = "live.cpp"


@dataclass(frozen=True)
class CameraTiming:
    """How a camera delivers its frames.

    Parameters
    ----------
    line_blank, frame_blank : int
        Pauses behind each line and each frame, in clocks of the camera.
    jitter : int
        Each line's pause is longer by fewer clocks than this, at random.
    steps, period : int
        The camera's clock has so many edges in ``period`` clocks of the design.
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
        0..255: how often, in 1/256, address or data are not accepted in a clock.
    latency_clocks : int
        Responses take fewer clocks than this.
    failures : int
        0..255: how often, in 1/256, a burst is answered by SLVERR.
    seed : int
    """

    waits: int = 0
    latency_clocks: int = 0
    failures: int = 0
    seed: int = 0


def live_accelerator(config: Config, max_size_px: tuple[int, int], *, lanes: int = LANES) -> Design:
    """The live build with an 8-bit video input, for frames up to a width and height."""
    config = as_built(config)
    size: dict[str, Any] = {"max_width_px": max_size_px[0], "max_height_px": max_size_px[1]}
    return Design(
        "the live accelerator",
        Ports(outputs=(), control=CONTROL),
        lambda: LiveTop(LiveAccelerator(config=config, lanes=lanes, video_bits=8, **size)),
        f"live {config} {lanes} {size} {source_key()}",
    )


class LiveBench:
    """A running simulation, and the bus of `constraints/live/skymosaic_live.py`.

    Parameters
    ----------
    config : Config
    size_px : tuple of int
        Width and height of the frames, and of the build.
    length_bytes : int
        Size of the memory.
    camera : CameraTiming
    rules : MemoryRules
    progress : callable
        Receives lines of text about a first build.
    """

    def __init__(
        self,
        config: Config,
        size_px: tuple[int, int],
        *,
        length_bytes: int,
        camera: CameraTiming | None = None,
        rules: MemoryRules | None = None,
        progress: Progress = silent,
    ) -> None:
        camera, rules = camera or CameraTiming(), rules or MemoryRules()
        self.memory = np.zeros(length_bytes, np.uint8)
        self._library = _load(
            verilator.shared_library(live_accelerator(config, size_px), progress=progress, harness=HARNESS)
        )
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
        """Let the camera show gray frames of any size after those that it shows already."""
        for frame in frames:
            self._frames.append(np.ascontiguousarray(frame, np.uint8))
            self._library.live_frame(self._bench, self._frames[-1].ctypes.data, frame.shape[1], frame.shape[0])

    def run(self, clocks: int) -> None:
        """Run for a number of clocks."""
        self._library.live_run(self._bench, clocks)

    @property
    def cycle(self) -> int:
        """Clocks since reset."""
        return int(self._library.live_cycle(self._bench))

    @property
    def violations(self) -> int:
        """How often an offer was withdrawn or changed, a burst crossed 4 KiB, left the memory or ended wrongly."""
        return int(self._library.live_violations(self._bench))

    @property
    def errors(self) -> int:
        """Bursts that were answered by SLVERR."""
        return int(self._library.live_errors(self._bench))

    @property
    def last_pixels(self) -> list[int]:
        """Clock of each frame's last pixel, in the order of the camera."""
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
        """The next pages of the memory."""
        start, self._used = self._used, self._used + -(-length_bytes // PAGE_BYTES) * PAGE_BYTES
        return self.memory[start : start + length_bytes]

    def address(self, buffer: NDArray[np.uint8]) -> int:
        """Where the design finds memory that `allocate` gave."""
        return int(BASE + buffer.ctypes.data - self.memory.ctypes.data)

    def invalidate(self, buffer: NDArray[np.uint8]) -> None:
        """The simulated memory has no cache."""

    def exchange(self, sent: NDArray[np.uint8], length_bytes: int, received: NDArray[np.uint8]) -> int:
        """Send ``length_bytes`` of hypotheses as a packet, and receive their scores; returns the bytes of these.

        Raises
        ------
        TimeoutError
            If the scores do not come.
        """
        hypotheses = np.array(sent[:length_bytes]).view(np.uint64)
        self._library.live_hypotheses(self._bench, hypotheses.ctypes.data, hypotheses.size)
        for _ in range(LONGEST_SCORING_CLOCKS // CLOCKS_OF_A_LOOK):
            self.run(CLOCKS_OF_A_LOOK)
            if self._library.live_score_packets(self._bench):
                words = ctypes.POINTER(ctypes.c_uint64)()
                count = self._library.live_scores(self._bench, ctypes.byref(words))
                scores = np.ctypeslib.as_array(words, (count,)).view(np.uint8)
                received[: scores.size] = scores
                return int(scores.size)
        raise TimeoutError(f"no scores in {LONGEST_SCORING_CLOCKS} clocks")

    def wait(self, seconds: float) -> None:
        """Let the simulation go on; its time is not that of the host."""
        self.run(CLOCKS_OF_A_WAIT)


def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    pointer, word, wide = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64
    signatures: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "live_open": (pointer, ()),
        "live_close": (None, (pointer,)),
        "live_memory": (None, (pointer, pointer, wide, wide)),
        "live_rules": (None, (pointer, word, word, word, wide)),
        "live_camera": (None, (pointer, *(word,) * 5)),
        "live_frame": (None, (pointer, pointer, word, word)),
        "live_run": (None, (pointer, wide)),
        "live_write": (ctypes.c_int, (pointer, word, word)),
        "live_read": (ctypes.c_int, (pointer, word, ctypes.POINTER(word))),
        "live_hypotheses": (None, (pointer, pointer, wide)),
        "live_score_packets": (wide, (pointer,)),
        "live_scores": (wide, (pointer, ctypes.POINTER(ctypes.POINTER(wide)))),
        "live_last_pixels": (wide, (pointer, ctypes.POINTER(ctypes.POINTER(wide)))),
        **{f"live_{name}": (wide, (pointer,)) for name in ("cycle", "violations", "errors")},
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
