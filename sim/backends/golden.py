"""The golden model as a `sim.backends.interface.Backend`; every other backend is compared with it."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from golden_model.arrays import Records
from golden_model.config import Config
from golden_model.front_end import extract
from golden_model.matching.matcher import ReferenceFrame, match
from golden_model.records import MATCH
from sim.backends.interface import Backend, BackendError, FrameResult, Progress, Reference


class GoldenBackend(Backend):
    """`golden_model.front_end.extract` and `golden_model.matching.matcher.match`, frame by frame."""

    def run(
        self, frames: Sequence[NDArray[np.uint8]], config: Config, *, reference: Reference = "held"
    ) -> list[FrameResult]:
        """See `sim.backends.interface.Backend.run`."""
        extracted = (extract(image, config.front_end, frame=number) for number, image in enumerate(frames))
        return list(add_matches(((frame.features, frame.status, None) for frame in extracted), config, reference))


def add_matches(
    frames: Iterable[tuple[NDArray[np.void], np.void, int | None]], config: Config, reference: Reference
) -> Iterator[FrameResult]:
    """Add the golden matches to the features, status and cycles of each frame."""
    references: ReferenceFrame[Records] = ReferenceFrame()
    for features, status, cycles in frames:
        left = references.for_frame(features, good=bool(status["good"]), held=reference == "held")
        matches = np.zeros(0, MATCH.dtype)
        if left is not None:
            matches = match(left, features, config.front_end.pattern, config.matcher)
        yield FrameResult.count_matches(features, matches, status, cycles)


def load(*, progress: Progress, waves: Path | None) -> GoldenBackend:
    """Make this backend for `sim.backends.interface.load_backend`; it builds nothing and has no waves.

    Raises
    ------
    BackendError
        If waves are requested.
    """
    if waves is not None:
        raise BackendError("the golden model cannot write waves; use verilator or pysim")
    return GoldenBackend()
