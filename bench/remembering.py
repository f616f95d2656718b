"""A golden backend that remembers: seeds, efforts and photographs that come again cost their search only."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from hashlib import blake2b
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from golden_model.config import Config
from golden_model.front_end import FrameFeatures, extract
from golden_model.matching.matcher import match
from golden_model.records import MATCH
from sim.backends.interface import FrameResult, Reference

Value = TypeVar("Value")


class RememberingBackend:
    """The golden model; features of the last ``frames`` frames and matches of the last ``pairs`` pairs are kept."""

    def __init__(self, frames: int = 4000, pairs: int = 100) -> None:
        self._features: OrderedDict[Hashable, FrameFeatures] = OrderedDict()
        self._matches: OrderedDict[Hashable, NDArray[np.void]] = OrderedDict()
        self._frames, self._pairs = frames, pairs

    def run(
        self, frames: Sequence[NDArray[np.uint8]], config: Config, *, reference: Reference = "held"
    ) -> list[FrameResult]:
        """See `sim.backends.interface.Backend.run`; only a held reference is known here."""
        if reference != "held":
            raise ValueError(f"reference is {reference!r}; only 'held' is remembered")
        results: list[FrameResult] = []
        keys = [(blake2b(frame.tobytes(), digest_size=16).digest(), frame.shape, repr(config)) for frame in frames]
        found = [
            self._kept(self._features, self._frames, key, partial(extract, frame, config.front_end))
            for key, frame in zip(keys, frames, strict=True)
        ]
        for key, right in zip(keys, found, strict=True):
            matches = np.zeros(0, MATCH.dtype)
            if results:
                both = found[0].features, right.features
                compute = partial(match, *both, config.front_end.pattern, config.matcher)
                matches = self._kept(self._matches, self._pairs, (keys[0], key), compute)
            results.append(FrameResult(right.features, matches, right.status, right.status, None))
        return results

    @staticmethod
    def _kept(store: OrderedDict[Hashable, Value], limit: int, key: Hashable, compute: Callable[[], Value]) -> Value:
        if key not in store:
            store[key] = compute()
            if len(store) > limit:
                store.popitem(last=False)
        return store[key]
