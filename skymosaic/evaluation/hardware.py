"""Compares hardware with the golden model on a pair: whether it is equal, what was compared, and how fast it ran."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from golden_model.arrays import Pixels
from golden_model.config import EstimatorConfig
from golden_model.timing import Timeline
from hdl.build import Build
from sim.backends.interface import Mismatch, silent
from sim.simulators.scoreboard import Coverage, find_clock_mismatch, find_mismatch, predict_timelines
from skymosaic.common.stopwatch import Stopwatch
from skymosaic.features.backends import load_backend
from skymosaic.imagery.images import load, reduce_for_front_end
from skymosaic.registration.extraction import extract_within_capacity
from skymosaic.registration.options import PhotographOptions


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison."""

    mismatch: Mismatch | None
    """The first difference; None if everything is equal. If a simulation differs, this is the first wrong pixel of the
    first wrong stage of the front end, or a record's field if the difference arises after these stages."""
    coverage: Coverage
    """How many frames, features and matches were compared."""
    cycles_per_frame: tuple[int, ...]
    """Clock cycles from a frame's first pixel to its last word."""
    seconds: float
    """Wall time of the simulation, without builds."""
    golden_seconds: float
    """Wall time of the golden model, for both frames."""
    size: tuple[int, int]
    """Size of the larger frame, px."""
    notes: tuple[str, ...]
    """Parts of the design that the pair did not exercise; empty if it exercised all."""
    timelines: tuple[Timeline, ...]
    """The predicted clocks of each frame, equal to the simulated ones unless there is a mismatch; empty for a board,
    and for a configuration whose clocks are not predicted."""
    rules: dict[str, str]
    """Name and digest of the rules that decided matches."""
    stages: dict[str, float] = dataclasses.field(default_factory=dict)
    """Wall time of each stage; of a simulation, ``building`` includes a first run."""

    @property
    def cycles_per_second(self) -> float:
        """Simulated clock cycles per second of wall time."""
        return sum(self.cycles_per_frame) / self.seconds

    def summary(self) -> dict[str, Any]:
        """Collect what ``compare --json`` prints."""
        return {
            "equal": self.mismatch is None,
            "frames": self.coverage.frames,
            "features": list(self.coverage.features),
            "sectors": self.coverage.sectors,
            "matches": self.coverage.matches,
            "homographies": self.coverage.homographies,
            "cycles_per_frame": list(self.cycles_per_frame),
            "cycles_per_second": round(self.cycles_per_second),
            "mismatch": str(self.mismatch) if self.mismatch else None,
            "notes": list(self.notes),
            **self.rules,
            "timelines": [dict(timeline.steps()) for timeline in self.timelines],
        }


def compare(
    left: str | Path | Pixels,
    right: str | Path | Pixels,
    options: PhotographOptions,
    *,
    homography: bool = False,
    waves: Path | None = None,
    progress: Callable[[str], None] = silent,
) -> Comparison:
    """Run a pair through the golden model and the backend of ``options``, and compare the results.

    Parameters
    ----------
    homography : bool
        Whether to take the hardware that also estimates homographies.
    waves : Path or None
        File for the waves (VCD) of a simulation: tens of kilobytes per clock cycle, so for small frames only.
    progress : callable
        Receives lines about a first build.

    Raises
    ------
    InputError
        For an unusable photograph or option.
    """
    options.check()
    clock = Stopwatch()
    photographs = [
        load(image, name, keep_damaged=options.keeps_damaged)
        for image, name in ((left, "left image"), (right, "right image"))
    ]
    frames = [reduce_for_front_end(each.pixels, options.working_width_px, each.name)[0] for each in photographs]
    config = dataclasses.replace(options.base_config, estimator=EstimatorConfig() if homography else None)
    clock.lap("reading")
    golden, config = extract_within_capacity(load_backend("golden"), frames, config)
    golden_seconds = clock.lap("golden model")
    hardware = load_backend(options.backend_name, progress=progress, waves=waves)
    if waves is None:
        # The first run may build the simulator, so only the second one is timed.
        hardware.run(frames, config)
    clock.lap("building")
    results = hardware.run(frames, config)
    seconds = clock.lap("simulating")
    timelines = predict_timelines(golden, results, Build(config=config), "held")
    mismatch = find_mismatch(golden, results)
    if mismatch:
        # A wrong record says little about the cause; the first stage that went wrong says more.
        mismatch = hardware.locate(frames[mismatch.frame], config, frame=mismatch.frame) or mismatch
    clock.lap("comparing")
    mismatch = mismatch or find_clock_mismatch(timelines, results)
    return Comparison(
        mismatch=mismatch,
        coverage=Coverage.of(golden),
        cycles_per_frame=tuple(result.cycles or 0 for result in results),
        seconds=seconds,
        golden_seconds=golden_seconds,
        size=max(((frame.shape[1], frame.shape[0]) for frame in frames), key=math.prod),
        notes=tuple(Coverage.of(golden).missing(config.front_end)),
        timelines=tuple(timelines),
        rules=config.rules_summary(),
        stages=clock.seconds,
    )
