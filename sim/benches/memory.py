"""A memory that waits and fails, and what benches of designs that use it share."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.simulators.compiled import ADDRESS, COMMON_FUNCTIONS, WIDE, WORD, Model

BASE = 0x8_4000_0000
"""Address of the memory: beyond what 32 bits reach."""


@dataclass(frozen=True)
class MemoryRules:
    """How the memory behaves, at random."""

    waits: int = 0
    """0..255: probability per clock, in 1/256, that address or data are not accepted."""
    latency_clocks: int = 0
    """Upper bound, exclusive, of a response's delay."""
    failures: int = 0
    """0..255: probability, in 1/256, that a burst is answered by SLVERR."""
    seed: int = 0


class MemoryBench(Model):
    """A running design that a camera feeds and that uses the memory of `sim/harness/memory.hpp`.

    Parameters
    ----------
    library : Path
        The compiled design, whose functions begin with ``prefix``; ``functions`` are those that only it has.
    memory : uint8 ndarray, shape (N,)
        Stands at `BASE`.
    rules
        How it behaves.
    """

    def __init__(
        self,
        library: Path,
        prefix: str,
        functions: Mapping[str, tuple[Any, ...]],
        memory: NDArray[np.uint8],
        rules: MemoryRules,
    ) -> None:
        super().__init__(library, prefix, {**_FUNCTIONS, **functions})
        self.memory = memory
        self._frames: list[NDArray[np.uint8]] = []
        self.call("memory", memory.ctypes.data, BASE, memory.size)
        self.follow(rules)

    def follow(self, rules: MemoryRules) -> None:
        """Change how the memory behaves."""
        self.call("rules", rules.waits, rules.latency_clocks, rules.failures, rules.seed)

    def show(self, *frames: NDArray[np.uint8]) -> None:
        """Queue frames of any size for the camera."""
        for frame in frames:
            self._frames.append(np.ascontiguousarray(frame, np.uint8))
            self.call("frame", self._frames[-1].ctypes.data, frame.shape[1], frame.shape[0])

    @property
    def violations(self) -> int:
        """How often the design broke AXI's rules: withdrew or changed an offer, or sent an invalid burst."""
        return int(self.call("violations"))

    @property
    def errors(self) -> int:
        """Number of bursts answered by SLVERR."""
        return int(self.call("errors"))


_FUNCTIONS = {
    **{name: COMMON_FUNCTIONS[name] for name in ("close", "reset", "cycle")},
    "open": (ADDRESS,),
    "memory": (None, ADDRESS, WIDE, WIDE),
    "rules": (None, WORD, WORD, WORD, WIDE),
    "frame": (None, ADDRESS, WORD, WORD),
    "violations": (WIDE,),
    "errors": (WIDE,),
}
