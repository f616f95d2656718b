"""Input and output of a simulated design, the same for every simulator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Pixels
from sim.backends.errors import BackendError

START_OF_FRAME = 1
END_OF_LINE = 2


@dataclass(frozen=True)
class Pauses:
    """Seeded pauses of the streams around a design."""

    gaps: int = 0
    """0..255: probability per clock, in 1/256, that no new beat is offered to the design."""
    stalls: int = 0
    """0..255: probability per clock, in 1/256, that an output of the design is not taken."""
    seed: int = 0
    """Below 2**24."""

    def __post_init__(self) -> None:
        for name, limit in (("gaps", 256), ("stalls", 256), ("seed", 1 << 24)):
            if not 0 <= getattr(self, name) < limit:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be 0 to {limit - 1}")

    def gap(self, cycle: int, stream: int = 0) -> bool:
        """Whether input ``stream`` gets no beat in ``cycle``."""
        return self._hash(cycle, stream) < self.gaps

    def stall(self, cycle: int, stream: int) -> bool:
        """Whether output ``stream`` is not taken in ``cycle``; inputs and outputs are numbered together."""
        return self._hash(cycle, stream) < self.stalls

    def _hash(self, cycle: int, stream: int) -> int:
        """0..255; ``pauses`` of harness.cpp computes the same."""
        # A hash instead of a generator: each simulator asks for clocks and streams in an order of its own.
        mixed = ((self.seed ^ (stream << 24) ^ cycle) & 0xFFFFFFFF) * 2654435761 & 0xFFFFFFFF
        mixed = (mixed ^ (mixed >> 15)) * 2246822519 & 0xFFFFFFFF
        return (mixed ^ (mixed >> 13)) & 255


NO_PAUSES = Pauses()


@dataclass(frozen=True, eq=False)
class Segment:
    """Beats to stream in one run, and the settings to make before."""

    data: NDArray[np.uint64]
    """One word per beat."""
    flags: NDArray[np.uint8]
    """START_OF_FRAME and END_OF_LINE of each beat."""
    packets: int
    """Packets that every output must have completed before the segment ends."""
    cycle_limit: int
    """A segment that takes longer is an error."""
    settings: Mapping[str, int] = field(default_factory=dict)
    """Static inputs to set; they keep their values afterwards."""
    writes: Sequence[tuple[int, int]] = ()
    """Addresses and values of registers to write."""
    reset: bool = False
    """Reset the design first, in whatever state it is."""

    def timeout_error(self, cycle: int) -> BackendError:
        """The error of a design that has not finished by its cycle limit."""
        return BackendError(
            f"the simulated design did not end {self.packets} packets within {self.cycle_limit} cycles "
            f"(stopped in cycle {cycle})"
        )


def check_access(kind: str, address: int, response: int) -> None:
    """Raise BackendError if the response to a register access is an error, or -1 for none."""
    if response:
        reason = "got no answer" if response < 0 else f"was refused (response {response})"
        raise BackendError(f"the {kind} of register 0x{address:03x} {reason}")


@dataclass(frozen=True, eq=False)
class Output:
    """The words of one output stream during a segment."""

    words: NDArray[np.uint64]
    ends: NDArray[np.uint64]
    """For each packet (N, 2): the number of words up to its end, and the cycle of its last word."""

    @property
    def packets(self) -> list[NDArray[np.uint64]]:
        """The words of each whole packet."""
        return np.split(self.words, self.ends[:, 0].astype(np.intp))[:-1]


@dataclass(frozen=True, eq=False)
class Recording:
    """The outputs of a design during a segment; cycles are counted from the end of the reset."""

    starts: NDArray[np.uint64]
    """Cycle in which each start of frame was admitted."""
    outputs: dict[str, Output]
    """By port prefix."""
    taps: dict[str, NDArray[np.uint64]]
    """Words of the debugging outputs, by port prefix."""


def flatten_frame(image: Pixels, *, pair_bits: int = 0) -> tuple[NDArray[np.uint64], NDArray[np.uint8]]:
    """Turn a frame into beats in raster order: data and flags for a `Segment`.

    Parameters
    ----------
    image : uint8 ndarray, shape (H, W) or (H, W, 3) BGR
        Gray goes into bits 7..0; colour as AXI4-Stream video has it: G in bits 7..0, B in 15..8, R in 23..16.
    pair_bits : {0, 16, 48}
        Width of an input that takes two pixels per beat, the left one in the lower half; 0: one pixel per beat. The
        last beat of an odd line is filled with ones.
    """
    if image.ndim == 2:
        data: NDArray[np.uint64] = image.astype(np.uint64)
    else:
        blue, green, red = np.moveaxis(image.astype(np.uint64), -1, 0)
        data = green | blue << 8 | red << 16
    if pair_bits:
        ones = (1 << pair_bits // 2) - 1
        padded = np.pad(data, ((0, 0), (0, data.shape[1] % 2)), constant_values=ones)
        data = padded[:, 0::2] | padded[:, 1::2] << np.uint64(pair_bits // 2)
    flags = np.zeros(data.shape, np.uint8)
    flags[:, -1] = END_OF_LINE
    flags[0, 0] |= START_OF_FRAME
    return data.ravel(), flags.ravel()
