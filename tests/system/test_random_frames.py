"""Random narrow frames on random small builds: equal results, and every clock that is predicted is the one simulated.

A run has no pauses, so that its clocks can be predicted; or gaps and stalls; or a frame before that a clear or a reset
cuts off.
"""

import contextlib
import dataclasses

import cv2
import numpy as np
import pytest

from golden_model.arrays import Pixels
from golden_model.config import (
    CELL_SIZES_PX,
    DETECTORS,
    MAX_PER_CELL,
    MIN_FRAME_PX,
    Config,
    EstimatorConfig,
    FrontEndConfig,
    MatcherConfig,
)
from golden_model.feature.ilbp import PATTERNS
from hdl.build import Build, pixels_per_clock
from hdl.registers.register_map import register_writes
from hdl.settings import RUNNING
from sim.simulators import verilator
from sim.simulators.accelerator_designs import design_accelerator
from sim.simulators.compiled import Bench
from sim.simulators.hardware import decode_recordings, make_segments
from sim.simulators.recording import NO_PAUSES, Pauses, Segment, flatten_frame
from sim.simulators.scoreboard import find_clock_mismatch, find_mismatch, predict_timelines
from skymosaic.features.backends import load_backend

TEXTURE_PX, BUILT_PX, MAX_FEATURES, RUNS = 440, (200, 321), 256, 25
DRAIN_CYCLES = 20_000


def draw_build(rng: np.random.Generator, video_bits: int) -> Build:
    """What is built: configuration, lanes, and the largest width and height of a frame."""
    smoothed = bool(rng.integers(2))
    smallest = FrontEndConfig(
        levels=int(rng.integers(1, 3)),
        smoothed_gradients=smoothed,
        tensor_window_px=int(rng.choice([3, 5])) if smoothed else 3,
        suppression_radius_px=int(rng.choice([1, 3])),
        border_px=255,
        max_features=MAX_FEATURES,
        descriptor=str(rng.choice(list(PATTERNS))),
    )
    # Also wider than the smallest level is high.
    least_px = max(smallest.min_border_px, smallest.min_hardware_border_px(pixels_per_clock(video_bits)))
    front_end = dataclasses.replace(smallest, border_px=least_px + int(rng.choice([0, 0, 1, 2, 33])))
    width_px, height_px = rng.integers(*BUILT_PX, 2).tolist()
    estimator = EstimatorConfig() if rng.random() < 0.7 else None
    matcher = MatcherConfig(rule_base=str(rng.choice(["aerial", "none"])))
    config = Config(front_end=front_end, matcher=matcher, estimator=estimator)
    lanes = int(rng.choice([2, 4, 8]))
    return Build(config=config, lanes=lanes, max_width_px=width_px, max_height_px=height_px, video_bits=video_bits)


def draw_settings(rng: np.random.Generator, config: Config, width_px: int, height_px: int) -> Config:
    """What is set at run time."""
    detector = str(rng.choice(DETECTORS, p=[0.7, 0.3]))
    cell_px = int(rng.choice(CELL_SIZES_PX))
    fitting = MAX_FEATURES // config.front_end.count_cells(width_px, height_px, cell_px)
    front_end = dataclasses.replace(
        config.front_end,
        detector=detector,
        threshold=int(10 ** rng.uniform(0, 5)) if detector == "harris" else int(rng.integers(1, 80)),
        cell_px=cell_px,
        per_cell=int(rng.integers(1, min(fitting, MAX_PER_CELL) + 1)),
    )
    estimator = config.estimator and EstimatorConfig(
        passes=int(rng.integers(0, 5)),
        seed=int(rng.integers(0, 1 << 32)),
        min_inliers=int(rng.integers(0, 40)),
        min_cells=int(rng.integers(0, 20)),
    )
    return dataclasses.replace(config, front_end=front_end, estimator=estimator)


def draw_frames(rng: np.random.Generator, texture: Pixels, width_px: int, height_px: int) -> list[Pixels]:
    """Three views that wander over the texture, and one with so little of it that few corners have a match."""
    x, y = rng.integers(0, 100, 2)
    views = (texture[y + 2 * n : y + 2 * n + height_px, x + 3 * n : x + 3 * n + width_px] for n in range(4))
    frames = [np.ascontiguousarray(view) for view in views]
    x, y = rng.integers(0, (width_px - 20, height_px - 20))
    plain = np.full_like(frames[3], 128)
    plain[y : y + 20, x : x + 20] = frames[3][y : y + 20, x : x + 20]
    return [*frames[:3], plain]


def cut_off(bench: Bench, segment: Segment, rng: np.random.Generator) -> None:
    """Send some of a segment, then clear or reset."""
    beats = int(rng.integers(1, len(segment.data)))
    begun = dataclasses.replace(segment, data=segment.data[:beats], flags=segment.flags[:beats], packets=0)
    bench.run(begun, Pauses(gaps=30, stalls=30, seed=beats))
    if rng.random() < 0.5:
        bench.reset()
        return
    for address, word in register_writes({**RUNNING, "clear": 1}):
        bench.write(address, word)
    # More packets than can come: it ends at its limit.
    bench.stream(Segment(segment.data[:0], segment.flags[:0], 1 << 32, DRAIN_CYCLES), NO_PAUSES)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "video_bits"), [(1, 32), (2, 48), (3, 16), (4, 24), (5, 48), (6, 8)])
def test_clocks_of_narrow_frames_are_predicted_or_left_out(seed: int, video_bits: int) -> None:
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, 256, (TEXTURE_PX, TEXTURE_PX)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    texture = cv2.normalize(smooth, smooth, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    build = draw_build(rng, video_bits)
    design, built_px = design_accelerator(build), (build.max_width_px, build.max_height_px)
    predicted, features, matches, homographies = 0, 0, 0, 0
    with contextlib.closing(Bench(verilator.build_library(design, progress=print), design.ports)) as bench:
        for run in range(RUNS):
            size_px = [int(rng.integers(MIN_FRAME_PX, side_px + 1)) for side_px in built_px]
            config = draw_settings(rng, build.config, *size_px)
            frames = draw_frames(rng, texture, *size_px)
            # The frames have one size, and make one segment.
            (segment,) = make_segments(frames, config, "previous")
            if build.pixels_per_clock > 1:
                beats = [flatten_frame(frame, pair_bits=video_bits) for frame in frames]
                data, flags = (np.concatenate(parts) for parts in zip(*beats, strict=True))
                segment = dataclasses.replace(segment, data=data, flags=flags)
            bench.reset()
            event = rng.choice(["none", "pauses", "cut off"], p=[0.5, 0.2, 0.3])
            if event == "cut off":
                cut_off(bench, segment, rng)
            pauses = Pauses(*rng.integers(1, 160, 3).tolist()) if event == "pauses" else NO_PAUSES
            results = decode_recordings([bench.run(segment, pauses)], config)
            golden = load_backend("golden").run(frames, config, reference="previous")
            assert find_mismatch(golden, results) is None, (run, event, size_px, config)
            features, matches = (
                total + sum(len(getattr(frame, name)) for frame in golden)
                for total, name in ((features, "features"), (matches, "matches"))
            )
            homographies += sum(bool(each.homography is not None and each.homography["score"]) for each in golden)
            if event != "pauses":
                timelines = predict_timelines(golden, results, dataclasses.replace(build, config=config), "previous")
                predicted += len(timelines)
                assert find_clock_mismatch(timelines, results) is None, (run, event, size_px, config)
    print(predicted, features, matches, homographies, build)
    assert predicted
    assert homographies or not build.config.estimator
    assert min(features, matches) > RUNS
