"""Compares the results of two backends: the first mismatch with its position, and how much was compared."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from golden_model import timing
from golden_model.arrays import Records
from golden_model.config import FrontEndConfig
from golden_model.feature.orientation import SECTORS
from golden_model.front_end import FrontEndTrace, Plane
from golden_model.matching.matcher import ReferenceFrame
from golden_model.timing import FrameWork, Timeline
from hdl.build import Build
from sim.backends.interface import FrameResult, Mismatch, Reference

MIN_LEVEL_0_FEATURES = 1000
MIN_LEVEL_1_FEATURES = 100
MIN_MATCHES = 100
POSITION_UNITS_PER_PX = 16
BLOCKS = {"gray": "{gray,half}", "smoothed": "smooth", "gradient": "sobel", "tensor": "harris", "raw": "harris",
          "response": "{harris,fast}", "candidates": "nms", "smoothed5": "smooth"}  # fmt: skip
"""The module of ``hdl/pixel`` that makes a stage, by the first word of its name."""


def find_mismatch(expected: Sequence[FrameResult], actual: Sequence[FrameResult]) -> Mismatch | None:
    """The first difference in features, matches, homographies or status records, frame by frame, record by record.

    ``cycles`` of the status is left to `find_clock_mismatch`: the golden model's records have no clock.
    """
    for number, (wanted, got) in enumerate(zip(expected, actual, strict=True)):
        mismatch = (
            _compare_records(number, "feature", wanted.features, got.features, ("x", "y"))
            or _compare_records(number, "match", wanted.matches, got.matches, ("left_x", "left_y"))
            or _compare_fields(number, "feature status", wanted.status, got.status, None)
            or _compare_fields(number, "match status", wanted.match_status, got.match_status, None)
            or _compare_homographies(number, wanted.homography, got.homography)
        )
        if mismatch:
            return mismatch
    return None


def predict_timelines(
    golden: Sequence[FrameResult], simulated: Sequence[FrameResult], build: Build, reference: Reference
) -> list[Timeline]:
    """The timeline of each frame, in clocks since reset; it ends at the first frame that cannot be predicted.

    Parameters
    ----------
    golden : sequence of FrameResult
        The prediction follows from its features and matches.
    simulated : sequence of FrameResult
        Only the clock in which the first pixel of each segment was taken is used.
    build : Build
    reference : {"held", "previous"}
    """
    works = list(_measure_works(golden, reference))
    timelines: list[Timeline] = []
    clocks = [result.clocks for result in simulated if result.clocks]
    for _, segment in itertools.groupby(enumerate(clocks), key=lambda item: item[1].segment):
        numbers, (first, *_) = zip(*segment, strict=True)
        # After a frame whose clocks cannot be predicted, those of the next segments cannot be, either.
        if len(timelines) == numbers[0]:
            segment_works = [works[n] for n in numbers]
            pixels = build.pixels_per_clock
            frames = timing.timelines(segment_works, build.config, lanes=build.lanes, pixels_per_clock=pixels)
            timelines += [timeline.delay(first.first_pixel) for timeline in frames]
    return timelines


def _measure_works(golden: Sequence[FrameResult], reference: Reference) -> Iterator[FrameWork]:
    """What the clocks of each frame depend on."""
    references: ReferenceFrame[int] = ReferenceFrame()
    for result in golden:
        good, count = bool(result.status["good"]), len(result.features)
        size_px = int(result.status["width"]), int(result.status["height"])
        left = references.for_frame(count, good=good, held=reference == "held")
        if result.accepted is not None:
            references.judge(accepted=result.accepted)
        counts = (0, 0) if left is None else (left, count)
        estimate_cycles = None if result.homography is None else int(result.homography["cycles"])
        yield FrameWork(*size_px, good, *counts, result.matches["left_index"], estimate_cycles)


def find_clock_mismatch(timelines: Sequence[Timeline], simulated: Sequence[FrameResult]) -> Mismatch | None:
    """The first clock that differs from its prediction, frame by frame."""
    # Predictions may end before the frames do.
    for number, (timeline, result) in enumerate(zip(timelines, simulated, strict=False)):
        if result.clocks is None:
            continue
        for step in ("first_pixel", "features_end", "matches_end", "homography_end"):
            wanted, got = getattr(timeline, step), getattr(result.clocks, step)
            if wanted != got:
                return Mismatch(number, f"clock of {step.replace('_', ' ')}", None, None, wanted, got)
        if timeline.status_cycles != result.status["cycles"]:
            return Mismatch(number, "status, cycles", None, None, timeline.status_cycles, result.status["cycles"])
    return None


def _compare_records(
    frame: int, kind: str, expected: Records, actual: Records, position: tuple[str, str]
) -> Mismatch | None:
    common = min(len(expected), len(actual))
    wrong = np.asarray(expected[:common] != actual[:common])
    if wrong.any():
        row = int(wrong.argmax())
        return _compare_fields(frame, f"{kind} {row}", expected[row], actual[row], position)
    if len(expected) != len(actual):
        extra = max(expected, actual, key=len)[common]
        x, y = (float(extra[axis]) / POSITION_UNITS_PER_PX for axis in position)
        return Mismatch(frame, f"{kind} count", x, y, len(expected), len(actual))
    return None


def _compare_homographies(frame: int, expected: np.void | None, actual: np.void | None) -> Mismatch | None:
    if expected is None or actual is None:
        return None if expected is actual else Mismatch(frame, "homography", None, None, expected, actual)
    # The golden model knows the estimator's clocks.
    return _compare_fields(frame, "homography", expected, actual, None, unknown=())


def _compare_fields(
    frame: int,
    kind: str,
    expected: np.void,
    actual: np.void,
    position: tuple[str, str] | None,
    *,
    unknown: Sequence[str] = ("cycles",),
) -> Mismatch | None:
    for name in expected.dtype.names or ():
        if name not in unknown and not np.array_equal(expected[name], actual[name]):
            x, y = (float(expected[axis]) / POSITION_UNITS_PER_PX for axis in position) if position else (None, None)
            return Mismatch(frame, f"{kind}, {name}", x, y, expected[name], actual[name])
    return None


def find_stage_mismatch(
    golden: FrontEndTrace, planes: Sequence[dict[str, np.ma.MaskedArray]], *, frame: int = 0
) -> Mismatch | None:
    """The first pixel of the first stage, in data-flow order, whose plane differs where the values are specified.

    Parameters
    ----------
    golden : FrontEndTrace
        From `golden_model.front_end.trace`.
    planes : sequence of dict of str to integer masked array
        For each level, the hardware's planes under the golden model's names; pixels without a value are masked, and
        missing stages are not compared.
    """
    for level, (expected, actual) in enumerate(zip(golden.levels, planes, strict=True)):
        for stage in (name for name in expected if name in actual):
            margin_px = expected[stage].margin_px
            differs = expected[stage].specified != Plane(actual[stage], margin_px).specified
            wrong = np.argwhere(np.ma.filled(differs, fill_value=False))
            if len(wrong):
                y, x = (wrong[0] + margin_px).tolist()
                values = int(expected[stage].values[y, x]), int(actual[stage][y, x])
                return Mismatch(
                    frame, f"level {level} {stage} (hdl/pixel/{BLOCKS[stage.partition('_')[0]]}.py)", x, y, *values
                )
    return None


@dataclass(frozen=True)
class Coverage:
    """How much a comparison covered."""

    frames: int
    features: tuple[int, int]
    """On level 0 and on level 1."""
    sectors: int
    """Number of the 16 orientation sectors that occurred."""
    matches: int
    homographies: int = 0

    @classmethod
    def of(cls, results: Sequence[FrameResult]) -> Coverage:
        """Coverage of a comparison with ``results``."""
        levels = np.concatenate([result.features["level"] for result in results])
        sectors = np.concatenate([result.features["sector"] for result in results])
        return cls(
            frames=len(results),
            features=(int(np.count_nonzero(levels == 0)), int(np.count_nonzero(levels == 1))),
            sectors=len(np.unique(sectors)),
            matches=sum(len(result.matches) for result in results),
            homographies=sum(result.homography is not None for result in results),
        )

    def missing(self, config: FrontEndConfig) -> list[str]:
        """Reasons why the comparison covered too little; empty if it covered enough.

        Enough is 1000 features on level 0, 100 matches, and, if the configuration has them, 100 features on level 1 and
        all sectors.
        """
        counts = (
            ("level-0 features", self.features[0], MIN_LEVEL_0_FEATURES),
            ("level-1 features", self.features[1], MIN_LEVEL_1_FEATURES if config.levels == 2 else 0),
            ("sectors", self.sectors, SECTORS if config.pattern.oriented else 0),
            ("matches", self.matches, MIN_MATCHES),
        )
        return [f"{count} {what}, at least {least} needed" for what, count, least in counts if count < least]

    def __str__(self) -> str:
        return (
            f"{self.frames} frames, {self.features[0]} + {self.features[1]} features of levels 0 + 1, "
            f"{self.sectors} of {SECTORS} sectors, {self.matches} matches"
            + (f", {self.homographies} homographies" if self.homographies else "")
        )
