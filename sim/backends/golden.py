"""The golden model as a `sim.backends.interface.Backend`; every other backend is compared with it."""

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import replace
from hashlib import blake2b

import numpy as np

from golden_model.arrays import Pixels, Records
from golden_model.config import Config, FrontEndConfig
from golden_model.front_end import FrameFeatures, extract
from golden_model.geometry.estimator import frame_homography
from golden_model.matching.matcher import ReferenceFrame, match
from golden_model.records import MATCH
from sim.backends.interface import Backend, FrameResult, Reference

REMEMBERED_FRAMES = 8
"""Further passes of a registration take the same reference frames again."""


class GoldenBackend(Backend):
    """`golden_model.front_end.extract` and `golden_model.matching.matcher.match`, frame by frame."""

    def __init__(self) -> None:
        self._extracted: dict[Hashable, FrameFeatures] = {}

    def run(self, frames: Sequence[Pixels], config: Config, *, reference: Reference = "held") -> list[FrameResult]:
        """See `sim.backends.interface.Backend.run`."""
        extracted = (self._extract(image, config.front_end, number) for number, image in enumerate(frames))
        return list(add_matches(extracted, config, reference))

    def _extract(self, image: Pixels, config: FrontEndConfig, number: int) -> FrameFeatures:
        """Extract the features, or take those of the same frame before."""
        key = blake2b(image.tobytes()).digest(), image.shape, repr(config)
        if key not in self._extracted:
            self._extracted[key] = extract(image, config)
            if len(self._extracted) > REMEMBERED_FRAMES:
                del self._extracted[next(iter(self._extracted))]
        features, status = self._extracted[key].features.copy(), self._extracted[key].status.copy()
        features["frame"] = status["frame"] = number
        return FrameFeatures(features, status)


def add_matches(frames: Iterable[FrameFeatures], config: Config, reference: Reference) -> Iterator[FrameResult]:
    """Add the golden matches, and the homography if there is an estimator, to each frame."""
    references: ReferenceFrame[Records] = ReferenceFrame()
    for frame in frames:
        features, status = frame.features, frame.status
        left = references.for_frame(features, good=bool(status["good"]), held=reference == "held")
        matches = np.zeros(0, MATCH.dtype)
        if left is not None:
            matches = match(left, features, config.front_end.pattern, config.matcher)
        result = FrameResult.count_matches(features, matches, status)
        if config.estimator:
            result = replace(result, homography=frame_homography(matches, status, config)[0])
        if result.accepted is not None:
            references.judge(accepted=result.accepted)
        yield result
