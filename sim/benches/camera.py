"""The camera build in a simulation: a camera with its own clock, a memory that waits and fails, a bus for the host."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdl.build import Build
from hdl.settings import PAGE_BYTES
from sim.backends.interface import Progress, silent
from sim.benches.memory import BASE, MemoryBench, MemoryRules
from sim.simulators import verilator
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.compiled import COMMON_FUNCTIONS, WIDE, WORD, WORDS

WAIT_CLOCKS = 20_000
HARNESS = verilator.HARNESS / "camera.cpp"


@dataclass(frozen=True)
class CameraTiming:
    """How a camera delivers its frames."""

    line_blank: int = 280
    frame_blank: int = 20_000
    """Pauses after each line and after each frame, in clocks of the camera."""
    jitter: int = 0
    """Upper bound, exclusive, of the random clocks by which each line's pause is longer."""
    steps: int = 1
    """Camera edges per ``period`` clocks of the design."""
    period: int = 2


class CameraBench(MemoryBench):
    """A running simulation, and the bus of `constraints/camera/skymosaic_rings.py`.

    Parameters
    ----------
    build : Build
        With the shell ``camera``; its frames are gray (H, W), or (H, W, 3) blue, green, red, by its ``video_bits``.
    length_bytes : int
        Size of the memory.
    camera, rules
        How camera and memory behave.
    progress : callable
        Receives lines of text about a first build.
    """

    def __init__(
        self, build: Build, *, length_bytes: int, camera: CameraTiming, rules: MemoryRules, progress: Progress = silent
    ) -> None:
        library = verilator.build_library(design_accelerator(build), progress=progress, harness=HARNESS)
        super().__init__(library, "camera", _FUNCTIONS, np.zeros(length_bytes, np.uint8), rules)
        self._used = 0
        self.call("timing", camera.line_blank, camera.frame_blank, camera.jitter, camera.steps, camera.period)

    def run(self, clocks: int) -> None:
        """Run for a number of clocks."""
        self.call("run", clocks)

    @property
    def open_bursts(self) -> int:
        """Number of addresses, words and responses of bursts that have begun and not ended."""
        return int(self.call("open_bursts"))

    @property
    def last_pixels(self) -> list[int]:
        """Clock in which the camera sent each frame's last pixel."""
        cycles: list[int] = self.words("last_pixels").tolist()
        return cycles

    @property
    def pixels(self) -> NDArray[np.int64]:
        """What a display has got of the painter's pictures: 24 bits of data, then first, then last."""
        return self.words("pixels").astype(np.int64)

    def allocate(self, length_bytes: int) -> NDArray[np.uint8]:
        """Take the next free pages of the memory."""
        start, self._used = self._used, self._used + -(-length_bytes // PAGE_BYTES) * PAGE_BYTES
        return self.memory[start : start + length_bytes]

    def address(self, buffer: NDArray[np.uint8]) -> int:
        """The bus address of memory from `allocate`."""
        return int(BASE + buffer.ctypes.data - self.memory.ctypes.data)

    def invalidate(self, buffer: NDArray[np.uint8]) -> None:
        """Do nothing: the simulated memory has no cache."""

    flush = invalidate

    def wait(self, seconds: float) -> None:
        """Run for a while, whatever ``seconds`` says: simulated time is not that of the host."""
        self.run(WAIT_CLOCKS)


_FUNCTIONS = {
    **COMMON_FUNCTIONS,
    "timing": (None, *[WORD] * 5),
    "run": (None, WIDE),
    **dict.fromkeys(("last_pixels", "pixels"), (WIDE, WORDS)),
    "open_bursts": (WIDE,),
}
"""The functions that only camera.cpp has."""
