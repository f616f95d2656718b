"""Wall time per stage of a computation."""

import time
from collections.abc import Mapping


class Stopwatch:
    """Measures consecutive stages, which extend earlier ``seconds``."""

    def __init__(self, seconds: Mapping[str, float] | None = None) -> None:
        self.seconds = dict(seconds or {})
        """Wall time of each stage."""
        self._last = time.perf_counter()

    def lap(self, stage: str) -> float:
        """Record the time since the last call, or since construction, as that of ``stage``, and return it."""
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now
        return self.seconds[stage]
