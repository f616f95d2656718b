"""A golden backend with a memory: photographs that come again, with other seeds or efforts, cost only the search."""

from collections.abc import Callable, Hashable, Sequence
from functools import partial
from hashlib import blake2b
from typing import Any

import numpy as np

from golden_model.arrays import Pixels
from golden_model.config import Config
from golden_model.front_end import extract
from golden_model.matching.matcher import match
from golden_model.records import MATCH
from sim.backends.interface import Backend, FrameResult, Reference


class RememberingBackend(Backend):
    """The golden model; features of frames and matches of pairs are kept, the last ``size`` of both together."""

    def __init__(self, size: int = 4000) -> None:
        self._size = size
        self._kept: dict[Hashable, Any] = {}

    def run(self, frames: Sequence[Pixels], config: Config, *, reference: Reference = "held") -> list[FrameResult]:
        """See `sim.backends.interface.Backend.run`; frames are matched with the first one only."""
        if reference != "held":
            raise ValueError(f"reference is {reference!r}; only 'held' is remembered")
        keys = [(blake2b(frame.tobytes(), digest_size=16).digest(), frame.shape, repr(config)) for frame in frames]
        results: list[FrameResult] = []
        for frame, key in zip(frames, keys, strict=True):
            right = self._remembered(key, partial(extract, frame, config.front_end))
            matches = np.zeros(0, MATCH.dtype)
            if results:
                both = results[0].features, right.features
                compute = partial(match, *both, config.front_end.pattern, config.matcher)
                matches = self._remembered((keys[0], key), compute)
            results.append(FrameResult.count_matches(right.features, matches, right.status))
        return results

    def _remembered(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        if key not in self._kept:
            self._kept[key] = compute()
            if len(self._kept) > self._size:
                del self._kept[next(iter(self._kept))]
        return self._kept[key]
